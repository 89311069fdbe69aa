"""The tray of bodies: where they lie, and which one is under a pixel."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv

from mbstudio.core.metaball import Avatar
from mbstudio.scene import Scene
from mbstudio.scene.layers.tray import GAP, tray_places, tray_surface
from mbstudio.scene.theme import LIGHT, rgb
from mbstudio.scene.tray_camera import TrayCamera


def balls(count):
    """Spheres of one control point: f = k / r² = 1 at r = √k."""
    return [Avatar(np.zeros((1, 3)), np.array([(1.0 + 0.1 * i) ** 2]), "mm") for i in range(count)]


def test_places_fill_rows_of_the_picture():
    # Two by one cells of a picture as wide as four of them are high: 8 bodies in rows of 4.
    places = tray_places(np.tile([2.0, 1.0, 1.0], (8, 1)), aspect=4.0)
    assert len(np.unique(places[:, 0])) == 4
    np.testing.assert_allclose(np.unique(places[:, 0]), GAP * np.array([0, 2, 4, 6]))
    np.testing.assert_allclose(np.unique(places[:, 1]), [-GAP, 0])
    assert (places[:, 2] == 0).all()
    assert (places[0] == 0).all()


def test_bodies_keep_their_size_and_do_not_touch():
    surface = tray_surface(balls(5), first=11, aspect=1.0, scale=1000.0)
    assert sorted(set(surface.labels.tolist())) == [11, 12, 13, 14, 15]
    boxes = []
    for place in range(5):
        points = surface.points[np.unique(surface.triangles[surface.labels == 11 + place])]
        low, high = points.min(axis=0), points.max(axis=0)
        np.testing.assert_allclose(high - low, 2000 * (1 + 0.1 * place), rtol=0.02)
        boxes.append((low, high))
    for i, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:i]:
            assert ((other_low[:2] > high[:2]) | (other_high[:2] < low[:2])).any()


@pytest.fixture
def scene():
    plotter = pv.Plotter(off_screen=True, window_size=(300, 200))
    scene = Scene(plotter)
    yield scene
    scene.close()
    plotter.close()


def test_one_is_picked_and_brought_out(scene):
    scene.layers.tray.set(tray_surface(balls(6), aspect=1.5), "mm")
    assert scene.points() is None
    scene.layers.tray.show(True)
    camera = TrayCamera(scene)
    before = scene.plotter.camera.position
    assert camera.look_at_tray(True, False)
    scene.plotter.render()
    # Seen from above in rows of three: the first at the upper left.
    assert scene.layers.tray.pick(50, 150).label == 1
    assert scene.layers.tray.pick(250, 50).label == 6
    assert scene.layers.tray.pick(1, 199) is None
    scene.layers.tray.select(6)
    mesh = scene.layers.tray._mesh
    brought_out = mesh.cell_data["colour"][mesh.cell_data["label"] == 6]
    assert (brought_out == rgb(LIGHT.points)).all()
    assert not (mesh.cell_data["colour"][mesh.cell_data["label"] == 1] == rgb(LIGHT.points)).all()
    scene.layers.tray.show(False)
    assert scene.layers.tray.pick(50, 150) is None
    assert not camera.look_at_tray(False, False)
    np.testing.assert_allclose(scene.plotter.camera.position, before)


def test_a_tray_that_was_turned_is_not_fitted_again(scene):
    scene.layers.tray.set(tray_surface(balls(6), aspect=1.5), "mm")
    scene.layers.tray.show(True)
    camera = TrayCamera(scene)
    camera.look_at_tray(True, False)
    assert camera.refit()
    scene.plotter.camera.parallel_scale *= 0.5
    assert not camera.refit()
