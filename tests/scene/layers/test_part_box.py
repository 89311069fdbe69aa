"""The box of a part is drawn where it lies, in the theme's colour, through and over nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.scene import DARK, LIGHT, Scene
from mbstudio.scene.layers.picking import to_display
from mbstudio.scene.theme import rgb

BOUNDS = np.array([[20.0, 60.0], [10.0, 50.0], [-5.0, 25.0]])


@pytest.fixture
def scene(plotter):
    scene = Scene(plotter, replace(LIGHT, top="#ffffff", bottom="#ffffff"))
    scene.set_scan(Scan(np.random.default_rng(0).random((20, 30, 40)), VoxelSize(2, 2, 2, "um"), (0, 0, -6)))
    scene.layers.slices.show(False)
    scene.look_from("isometric")
    return scene


def edges() -> np.ndarray:
    """Points along the twelve edges, away from the corners."""
    shares = np.linspace(0.15, 0.85, 8)
    points = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        for first in BOUNDS[others[0]]:
            for second in BOUNDS[others[1]]:
                line = np.empty((len(shares), 3))
                line[:, axis] = BOUNDS[axis, 0] + shares * np.ptp(BOUNDS[axis])
                line[:, others[0]], line[:, others[1]] = first, second
                points.append(line)
    return np.concatenate(points)


def is_drawn(scene, colour: str) -> np.ndarray:
    """Whether the picture has a colour near each point of the edges."""
    picture = scene.screenshot().astype(int)
    found = []
    for x, y in to_display(scene.plotter.renderer, edges()):
        column, row = round(x), picture.shape[0] - 1 - round(y)
        near = picture[row - 2 : row + 3, column - 2 : column + 3].reshape(-1, 3)
        found.append(bool(np.abs(near - rgb(colour)).sum(axis=1).min() < 30))
    return np.array(found)


def test_all_edges_are_drawn_where_the_part_lies(scene) -> None:
    box = scene.layers.part_box
    assert not is_drawn(scene, LIGHT.grain).any()
    box.set(BOUNDS)
    assert is_drawn(scene, LIGHT.grain).all()
    box.set(BOUNDS + 8.0)
    assert not is_drawn(scene, LIGHT.grain).all(), "it has moved"
    box.set(BOUNDS)
    scene.set_theme(replace(DARK, grain="#00ff00"))
    assert is_drawn(scene, "#00ff00").all()
    box.set(None)
    assert not is_drawn(scene, "#00ff00").any()
    assert not box.holds_something


def test_slices_hide_what_lies_behind_them(scene) -> None:
    scene.layers.part_box.set(BOUNDS)
    scene.layers.slices.show(True)
    seen = is_drawn(scene, LIGHT.grain)
    assert 0.3 < seen.mean() < 1


def test_the_box_is_neither_hit_nor_clipped_nor_fitted(scene) -> None:
    box = scene.layers.part_box
    before = scene.points()
    box.set(BOUNDS)
    np.testing.assert_allclose(
        (scene.points().min(axis=0), scene.points().max(axis=0)), (before.min(axis=0), before.max(axis=0))
    )
    corner = to_display(scene.plotter.renderer, edges()[:1])[0]
    assert box.pick(*corner) is None
    scene.show_layers({"slices"})
    assert box.is_visible, "stations do not switch it"
