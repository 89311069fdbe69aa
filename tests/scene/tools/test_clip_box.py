"""What the clipping box cuts away, and its faces dragged in the picture."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.scene import LIGHT, Scene
from mbstudio.scene.layers.picking import to_display
from mbstudio.scene.surfaces import surface_of


@pytest.fixture
def scene(plotter):
    scene = Scene(plotter, LIGHT)
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=100)
    scene.layers.avatar.set(surface_of(mesh), "um")
    scene.look_from("front")  # x to the right, z upwards
    scene.clip.span(scene.points())
    return scene


def covered(scene):
    """Return which pixels the avatar covers: blue ones."""
    picture = scene.screenshot().astype(int)
    return picture[..., 2] - picture[..., 0] > 30


def hide_frame(scene):
    for actor in (scene.clip._frame, scene.clip._handles):
        actor.SetVisibility(False)


def test_half_of_a_ball_is_cut_away(scene):
    whole = covered(scene)
    scene.clip.switch(True)
    hide_frame(scene)
    assert covered(scene).sum() == pytest.approx(whole.sum(), rel=0.02), "at first nothing is cut"
    scene.clip.set_share(0, 0.0, 0.5)
    hide_frame(scene)
    left = covered(scene)
    assert left.sum() == pytest.approx(whole.sum() / 2, rel=0.04)
    assert np.nonzero(left)[1].max() <= 202, "only the half at lower x is left"
    scene.clip.reset()
    hide_frame(scene)
    assert covered(scene).sum() == pytest.approx(whole.sum(), rel=0.02)


def test_one_looks_into_the_open_body(scene):
    scene.clip.switch(True)
    scene.clip.set_share(1, 0.6, 1.0)  # the half towards the camera is gone: its inside is seen
    hide_frame(scene)
    assert scene.screenshot()[150, 200].astype(int)[2] > scene.screenshot()[150, 200].astype(int)[0] + 20
    scene.clip.switch(False)
    assert scene.layers.avatar.actors[0].mapper.GetClippingPlanes().GetNumberOfItems() == 0
    assert scene.layers.avatar.actors[0].prop.culling == "back"


def test_a_surface_that_comes_later_is_cut_too(scene):
    scene.clip.switch(True)
    scene.clip.set_share(2, 0.0, 0.5)
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=100)
    scene.layers.avatar.set(None)
    scene.layers.avatar.set(surface_of(mesh), "um")
    hide_frame(scene)
    rows = np.nonzero(covered(scene))[0]
    assert rows.min() >= 147, "nothing of it above the middle"


def test_nothing_is_picked_in_what_is_cut_away(scene):
    scene.screenshot()
    x, y = to_display(scene.plotter.renderer, np.array([[60.0, 0.0, 0.0]]))[0]
    assert scene.pick(x, y) is not None
    scene.clip.switch(True)
    scene.clip.set_share(0, 0.0, 0.5)
    scene.screenshot()
    assert scene.pick(x, y) is None


def test_a_face_follows_the_mouse_and_stops_at_the_other(scene):
    clip, told = scene.clip, []
    clip.changed = lambda: told.append(clip.shares.copy())
    clip.switch(True)
    scene.screenshot()
    upper = clip._middles()[1]
    x, y = to_display(scene.plotter.renderer, upper[None])[0]
    assert clip.over(x + 3, y - 3) == 1
    assert clip.grab(x, y)
    per_um = 300 / (2 * scene.plotter.renderer.GetActiveCamera().GetParallelScale())
    clip.drag(x - 51 * per_um, y + 20)
    # The whole is 204 wide: the ball and a hundredth of it on either side.
    assert clip.shares[0] == pytest.approx([0, 0.75], abs=0.003)
    assert clip.bounds[0, 1] == pytest.approx(upper[0] - 51, abs=0.6)
    clip.drag(x - 900 * per_um, y)
    assert clip.shares[0] == pytest.approx([0, 0.02], abs=1e-9)
    clip.drop()
    clip.drag(x, y)
    assert len(told) == 2
    assert (clip.shares[1:] == [[0, 1], [0, 1]]).all()


def test_there_is_nothing_to_grab_while_it_is_off(scene):
    scene.screenshot()
    x, y = to_display(scene.plotter.renderer, scene.clip._middles()[:1])[0]
    assert not scene.clip.grab(x, y)
