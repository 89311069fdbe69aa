"""The scan as a cloud: thinned to what the card takes, coarser in motion, in the slices' grey window."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv

from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.scene import LIGHT, Scene
from mbstudio.scene.layers.volume import largest_texture, volume_voxels


@pytest.fixture
def scan(rng):
    grey = rng.integers(50, 60, (30, 30, 30)).astype(np.uint8)
    grey[8:22, 8:22, 8:22] = 200
    return Scan(grey, VoxelSize(10, 10, 10, "um"), (0.0, 0.0, 0.0))


@pytest.fixture
def scene(plotter, scan):
    scene = Scene(plotter, LIGHT)
    scene.set_scan(scan)
    scene.layers.volume.set(volume_voxels(scan))
    scene.look_from("front")
    scene.show_layers({"volume"})
    return scene


def covered(scene):
    picture = scene.screenshot().astype(int)
    return np.abs(picture - picture[:, :1]).max(axis=2)[20:230, 100:300] > 25


def test_the_cloud_shows_what_is_dense_and_not_the_void(scene):
    mask = covered(scene)
    rows, columns = np.nonzero(mask)
    # 14 of 30 voxels: the box of 290 fills 1 / 1.14 of 300 pixels.
    expected = 14 / 29 * 300 / 1.14
    assert np.ptp(rows) == pytest.approx(expected, abs=10)
    assert np.ptp(columns) == pytest.approx(expected, abs=10)


def test_in_motion_it_is_drawn_by_fewer_voxels_that_show_the_same(scene):
    fine = covered(scene)
    scene.set_moving(True)
    cloud = scene.layers.volume.cloud
    assert cloud.coarse.GetVisibility()
    assert not cloud.actor.GetVisibility()
    few, many = (
        np.prod(volume.GetMapper().GetInput().GetDimensions()) for volume in (cloud.coarse, cloud.actor)
    )
    assert few <= many / 15
    assert (covered(scene) ^ fine).mean() < 0.2 * fine.mean()
    scene.set_moving(False)
    assert (covered(scene) == fine).all()


def test_the_grey_window_holds_for_the_cloud(scene):
    assert covered(scene).any()
    scene.set_window(300.0, 400.0)  # above all grey values: clear throughout
    assert not covered(scene).any()
    scene.set_window(50.0, 200.0)
    assert covered(scene).any()


def test_taking_the_scan_away_takes_the_cloud(scene):
    scene.set_scan(None)
    assert not scene.layers.volume.holds_something
    assert not covered(scene).any()


def test_the_largest_texture_is_known_once_something_was_drawn():
    plotter = pv.Plotter(off_screen=True, window_size=(64, 64))
    assert largest_texture(plotter.render_window) == 0
    plotter.show(auto_close=False, interactive=False)
    assert largest_texture(plotter.render_window) >= 256
    plotter.close()
