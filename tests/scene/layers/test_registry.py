"""The registry of layers: a layer that is new to it takes part in everything that a scene does."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv
import trimesh

from mbstudio.scene import DARK, LAYERS, LIGHT, Layer, Scene, switched_layers
from mbstudio.scene.layers.picking import to_display
from mbstudio.scene.layers.registry import Layers
from mbstudio.scene.surfaces import surface_of
from mbstudio.scene.theme import rgb


class Beacon(Layer[tuple]):
    """A ball in the theme's ink, of a centre and a radius: all that a layer has to write itself."""

    title = "Beacon"
    icon = "ph.lighthouse"
    tip = "A ball to look for"

    def __init__(self, name, stage):
        super().__init__(name, stage)
        self._actor = None

    @property
    def actors(self):
        return [] if self._actor is None else [self._actor]

    def set(self, content, unit=None):
        if self._actor is not None:
            self.stage.remove(self._actor)
            self._actor = None
        if content is not None:
            self.stage.set_unit(unit)
            centre, radius = content
            self._actor = self.stage.plotter.add_mesh(
                pv.Sphere(radius=radius, center=centre), color=self.stage.theme.ink, lighting=False,
                reset_camera=False, render=False,
            )  # fmt: skip
        self.stage.update()

    def recolour(self, theme):
        if self._actor is not None:
            self._actor.prop.color = theme.ink


@pytest.fixture
def scene(plotter, monkeypatch):
    monkeypatch.setitem(LAYERS, "beacon", Beacon)
    scene = Scene(plotter, LIGHT)
    scene.look_from("front")
    return scene


def covered(scene, colour):
    """Return which pixels have a colour."""
    return np.abs(scene.screenshot().astype(int) - rgb(colour)).max(axis=2) < 6


def test_a_new_layer_is_set_shown_and_hidden(scene):
    beacon = scene.layers["beacon"]
    nothing = covered(scene, LIGHT.ink).sum()
    beacon.set(((0, 0, 0), 100.0), "mm")
    assert scene.unit == "mm"
    scene.fit()
    # A ball fills 1 / 1.14 of the picture's height.
    full = np.pi / 4 * (300 / 1.14) ** 2
    assert covered(scene, LIGHT.ink).sum() == pytest.approx(full, rel=0.05)
    beacon.show(False)
    assert covered(scene, LIGHT.ink).sum() <= nothing
    scene.show_layers({"beacon"})
    assert covered(scene, LIGHT.ink).sum() == pytest.approx(full, rel=0.05)
    scene.show_layers({"grain"})
    assert covered(scene, LIGHT.ink).sum() <= nothing
    beacon.show(True)
    beacon.set(None)
    assert covered(scene, LIGHT.ink).sum() <= nothing
    assert not beacon.holds_something


def test_a_new_layer_takes_theme_and_opacity(scene):
    scene.layers["beacon"].set(((0, 0, 0), 100.0))
    scene.fit()
    scene.set_theme(DARK)
    assert covered(scene, DARK.ink)[150, 200]
    scene.layers["beacon"].set_opacity(0.5)
    assert not covered(scene, DARK.ink)[150, 200]
    scene.layers["beacon"].set_opacity(0.0)
    assert scene.pick(200, 150) is None


def test_a_new_layer_is_picked_where_it_is_foremost(scene):
    scene.layers.avatar.set(surface_of(trimesh.creation.icosphere(subdivisions=3, radius=100)))
    scene.layers["beacon"].set(((50, -90, 0), 20.0))
    scene.fit()
    scene.screenshot()
    places = np.array([[50.0, -110, 0], [-50, -80, 0]])
    (x, y), (u, v) = to_display(scene.plotter.renderer, places)
    hit = scene.pick(x, y)
    assert hit.layer == "beacon"
    np.testing.assert_allclose(hit.point, places[0], atol=1.0)
    assert hit.label is None
    assert scene.pick(u, v).layer == "avatar"


def test_the_camera_and_the_clipping_box_take_a_new_layer_in(scene):
    scene.layers["beacon"].set(((700, 0, 0), 10.0))
    scene.layers.avatar.set(surface_of(trimesh.creation.icosphere(subdivisions=3, radius=10)))
    points = scene.points()
    np.testing.assert_allclose([points[:, 0].min(), points[:, 0].max()], [-10, 710], atol=0.1)
    scene.clip.span(points)
    scene.clip.switch(True)
    assert scene.layers["beacon"].actors[0].mapper.GetClippingPlanes().GetNumberOfItems() == 6


def test_a_new_layer_is_closed_with_its_scene(scene):
    scene.layers["beacon"].set(((0, 0, 0), 100.0))
    actor = scene.layers["beacon"].actors[0]
    assert scene.plotter.renderer.HasViewProp(actor)
    scene.close()
    assert not scene.plotter.renderer.HasViewProp(actor)


def test_a_new_layer_with_a_title_has_a_switch(scene):
    assert switched_layers()["beacon"] is Beacon
    assert not any(name in switched_layers() for name in ("outline", "tray", "side_by_side"))


def test_every_line_of_the_registry_is_a_layer_under_its_name(plotter):
    scene = Scene(plotter)
    assert list(scene.layers) == list(LAYERS) == list(Layers.__annotations__)
    for name, kind in LAYERS.items():
        layer = scene.layers[name]
        assert type(layer) is kind
        assert getattr(scene.layers, name) is layer
        assert layer.name == name
        assert not layer.holds_something
        assert layer.points() is None
        assert layer.pick(200, 150) is None
        assert bool(kind.title) == bool(kind.icon) == bool(kind.tip)
    scene.close()


def test_a_layer_that_is_not_there_is_named(plotter):
    with pytest.raises(KeyError, match="no layer avatarr"):
        Scene(plotter).show_layers({"grain", "avatarr"})


def test_see_through_layers_are_drawn_after_what_comes_later(plotter):
    scene = Scene(plotter)
    for name, radius in (("envelope", 9), ("grain", 10), ("avatar", 8), ("live", 7)):
        scene.layers[name].set(surface_of(trimesh.creation.icosphere(subdivisions=2, radius=radius)))
    props = scene.plotter.renderer.GetViewProps()
    order = [props.GetItemAsObject(place) for place in range(props.GetNumberOfItems())]
    places = {
        name: order.index(scene.layers[name].actors[0]) for name in ("envelope", "grain", "avatar", "live")
    }
    assert max(places["avatar"], places["live"]) < places["grain"] < places["envelope"]
