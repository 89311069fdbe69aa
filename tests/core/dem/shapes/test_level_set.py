"""Signed distances on a padded grid: known answers, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.dem.shapes.level_set import LevelSet, check_level_set, level_set
from mbstudio.core.errors import ExportError
from mbstudio.core.metaball import Avatar


def nodes_of(grid: LevelSet) -> np.ndarray:
    return grid.origin + grid.spacing * np.stack(
        np.meshgrid(*(np.arange(count) for count in grid.values.shape), indexing="ij"), axis=-1
    )


def test_one_control_point_gives_the_distance_to_a_sphere():
    ball = Avatar([[1, 2, 3]], [4.0], "mm")  # radius 2
    grid = level_set(ball, cells=20, padding=2)
    distance = np.linalg.norm(nodes_of(grid) - [1, 2, 3], axis=-1) - 2
    # f is infinite on the control point itself, and the surface is all round it.
    assert grid.values == pytest.approx(distance, abs=2e-6)
    assert grid.values.shape == (25, 25, 25)
    assert grid.spacing == pytest.approx(0.2, rel=1e-3)
    assert grid.volume == pytest.approx(4 / 3 * np.pi * 8, rel=5e-3)
    assert grid.center == pytest.approx([1, 2, 3], abs=1e-6)


def test_two_equal_control_points_on_their_axis_of_symmetry():
    """On the plane between k = 1 at x = -a and a, f = 2 / (a**2 + r**2): the neck is at r**2 = 2 - a**2."""
    a = 0.8
    pair = Avatar([[-a, 0, 0], [a, 0, 0]], [1.0, 1.0], "mm")
    grid = level_set(pair, cells=40)
    middle = np.array(grid.values.shape) // 2
    assert nodes_of(grid)[tuple(middle)] == pytest.approx([0, 0, 0], abs=1e-9)
    # From the centre the neck's circle is nearest: f falls from it to the surface along every radius.
    assert grid.values[tuple(middle)] == pytest.approx(-np.sqrt(2 - a**2), rel=1e-3)
    inside = pair.contains(nodes_of(grid).reshape(-1, 3)).reshape(grid.values.shape)
    clear = np.abs(grid.values) > 1e-9
    assert np.array_equal((grid.values < 0)[clear], inside[clear])


def test_no_neighbours_differ_by_more_than_they_are_apart(ring):
    grid = level_set(ring, cells=24)
    for axis in range(3):
        assert np.abs(np.diff(grid.values, axis=axis)).max() <= grid.spacing * 1.05
    # The hole of the ring is outside, and as deep as its rim is away.
    middle = tuple(np.array(grid.values.shape) // 2)
    assert grid.values[middle] > 0.5


@pytest.fixture(scope="module")
def ball() -> LevelSet:
    return level_set(Avatar([[0, 0, 0]], [1.0], "mm"), cells=16, padding=2)


VOLUME = 4 / 3 * np.pi


def test_a_whole_grid_passes(ball):
    check_level_set("ball", ball, VOLUME)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda g: replace(g, values=g.values[3:], origin=g.origin + np.array([3 * g.spacing, 0, 0])),
            "cropped",
        ),
        (lambda g: replace(g, values=g.values[:, :, :-2]), "cropped"),
        (lambda g: replace(g, values=-g.values), "cropped"),
        (lambda g: replace(g, values=np.abs(g.values) + 1e-3), "no node inside"),
        (lambda g: replace(g, values=g.values * 10), "not hold distances"),
        (lambda g: replace(g, values=g.values + 0.05), "has a volume"),
        (lambda g: replace(g, origin=g.origin + np.array([0.1, 0, 0])), "centre of mass"),
        (lambda g: replace(g, spacing=-g.spacing), "no spacing"),
        (lambda g: replace(g, values=np.where(g.values > 1, np.nan, g.values)), "not finite"),
        (lambda g: replace(g, values=g.values.reshape(-1)), "not a grid with three axes"),
    ],
)
def test_what_is_no_whole_distance_is_refused(change, message, ball):
    with pytest.raises(ExportError, match=message):
        check_level_set("ball", change(ball), VOLUME)


def test_too_coarse_a_grid_is_refused(avatar):
    with pytest.raises(ExportError, match="at least 4"):
        level_set(avatar, cells=2)
    with pytest.raises(ExportError, match="at least 4"):
        level_set(avatar, padding=0)
