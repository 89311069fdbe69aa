"""Slices dragged in the picture: from a known camera, so many pixels are so many voxels."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.scene import Scene
from mbstudio.scene.layers.picking import length_of_drag, sight, to_display
from mbstudio.scene.tools.slice_grip import SliceGrip


@pytest.fixture
def scene(plotter, rng):
    scene = Scene(plotter)
    grey = rng.integers(0, 255, (24, 32, 40)).astype(np.uint8)
    scene.set_scan(Scan(grey, VoxelSize(20, 10, 10, "um"), (100.0, 200.0, 300.0)))
    return scene


def pixels_per_um(scene):
    return 300 / (2 * scene.plotter.renderer.GetActiveCamera().GetParallelScale())


def test_places_in_the_picture_are_vtks(scene):
    scene.look_from("isometric")
    scene.screenshot()
    renderer = scene.plotter.renderer
    point = np.array([250.0, 310.0, 480.0])
    renderer.SetWorldPoint(*point, 1.0)
    renderer.WorldToDisplay()
    np.testing.assert_allclose(to_display(renderer, point)[0], renderer.GetDisplayPoint()[:2], atol=0.01)
    start, along = sight(renderer, *to_display(renderer, point)[0])
    away = point - start
    np.testing.assert_allclose(away - (away @ along) * along, 0, atol=1e-3)


def test_a_frame_is_dragged_by_its_voxels(scene):
    scene.look_from("front")  # x to the right, z upwards
    scene.screenshot()
    moved = []

    def move(axis, index):
        moved.append((axis, index))
        scene.layers.slices.planes.move(axis, index)

    grip = SliceGrip(scene.layers.slices, move)
    # The slice across z at voxel 12 is a level line at z = 300 + 12 * 20.
    x, y = to_display(scene.plotter.renderer, np.array([[150.0, 200.0, 540.0]]))[0]
    assert grip.over(x, y) == "z"
    assert grip.grab(x, y + 1)
    grip.drag(x + 30, y + 1 + 5 * 20 * pixels_per_um(scene))
    assert moved == [("z", 17)]
    grip.drag(x, y + 1 + 1000)
    assert scene.layers.slices.planes.index["z"] == 23, "no further than the last"
    grip.drop()
    grip.drag(x, y)
    assert scene.layers.slices.planes.index["z"] == 23, "let go is let go"


def test_there_is_nothing_to_grab_away_from_frames_or_where_they_are_hidden(scene):
    scene.look_from("front")
    scene.screenshot()
    grip = SliceGrip(scene.layers.slices, lambda *_: None)
    x, y = to_display(scene.plotter.renderer, np.array([[150.0, 200.0, 540.0]]))[0]
    assert not grip.grab(x, y + 25)
    scene.layers.slices.planes.show("z", False)
    assert grip.over(x, y) != "z"
    scene.show_layers(set())
    assert grip.over(x, y) is None


def test_seen_end_on_a_drag_upwards_pulls_nearer(scene):
    scene.look_from("top")
    scene.screenshot()
    renderer, place = scene.plotter.renderer, np.array([300.0, 350.0, 500.0])
    upwards = length_of_drag(renderer, place, np.array([0.0, 0, 1]), np.array([0.0, 50.0]))
    assert upwards == pytest.approx(50 / pixels_per_um(scene))
    across = length_of_drag(renderer, place, np.array([1.0, 0, 0]), np.array([50.0, 8.0]))
    assert across == pytest.approx(50 / pixels_per_um(scene))


def test_the_slice_under_a_line_of_sight(scene):
    slices = scene.layers.slices.planes
    # From above: the slice across z at 540 lies highest in the middle of the box.
    hit = slices.point_on(np.array([152.0, 233.0, 5000.0]), np.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(hit, [152, 233, 540])
    assert slices.voxel_at(hit) == (5, 3, 12)
    assert slices.point_on(np.array([5000.0, 233.0, 5000.0]), np.array([0.0, 0.0, -1.0])) is None
    slices.show("z", False)
    assert slices.point_on(np.array([152.0, 233.0, 5000.0]), np.array([0.0, 0.0, -1.0])) is None
