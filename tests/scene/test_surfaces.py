"""Surfaces that are put into a mesh which is shown already."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv

from mbstudio.core.metaball import Avatar
from mbstudio.scene import Scene
from mbstudio.scene.surfaces import avatar_surface


def ball(radius: float):
    """One control point: f = 1 is the sphere of radius sqrt(k)."""
    return avatar_surface(Avatar([[0.0, 0.0, 0.0]], [radius**2], "mm"), cells=24)


def test_a_mesh_takes_another_surface():
    mesh = ball(1.0).poly_data()
    small = ball(0.5)
    small.fill(mesh)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.125, rel=0.02)
    assert mesh.bounds[1] == pytest.approx(0.5, rel=0.01)
    assert mesh.n_points == len(small.points)
    assert mesh.n_cells == len(small.triangles)
    np.testing.assert_allclose(mesh.point_data["Normals"], mesh.points / 0.5, atol=0.01)
    assert mesh.point_data.active_normals_name == "Normals"


def test_the_surface_that_came_last_is_shown_before_and_after_the_first_picture():
    plotter = pv.Plotter(off_screen=True, window_size=[200, 200])
    scene = Scene(plotter, unit="mm")
    scene.show_layers({"live"})
    scene.layers.live.set(ball(1.0))
    scene.layers.live.set(ball(0.5))
    scene.look_from("front")
    seen = [float(np.ptp(scene.points(), axis=0).max())]
    scene.screenshot()
    scene.layers.live.set(ball(0.25))
    seen.append(float(np.ptp(scene.points(), axis=0).max()))
    before = scene.screenshot().astype(int)
    scene.layers.live.set(ball(0.5))
    after = scene.screenshot().astype(int)
    assert seen == pytest.approx([1.0, 0.5], rel=0.02)
    assert (np.abs(after - before).max(axis=2) > 20).mean() > 0.1
    scene.close()
    plotter.close()
