"""Roundness of solids whose edges have a known radius, as meshes and as voxels."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from benchmarks.roundness import as_voxels, cylinder, rounded_box, roundness_of_ellipsoid
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import measure_detail
from mbstudio.core.metrics.roundness import roundness
from tests.core.metrics.solids import turned

SIDES = {"cube": (2, 2, 2), "brick": (4, 2, 2), "plate": (6, 6, 2)}
RADII = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9)


def of_mesh(mesh):
    """Roundness of a body whose inscribed radius is 1."""
    return roundness(np.asarray(mesh.vertices), np.asarray(mesh.faces), 1.0)


def box(sides, radius, seed):
    return turned(rounded_box(sides, radius) if radius else trimesh.creation.box(sides), seed)


@pytest.mark.parametrize("sides", SIDES.values(), ids=SIDES)
def test_boxes_have_the_radius_of_their_edges(sides):
    found = [of_mesh(box(sides, radius, seed)) for seed, radius in enumerate(RADII)]
    assert found == pytest.approx(RADII, abs=0.05)
    assert np.all(np.diff(found) > 0)


@pytest.mark.full
@pytest.mark.parametrize("sides", [(10, 10, 2), (20, 2, 2), (20, 20, 2)], ids=["wide plate", "rod", "sheet"])
def test_rods_and_sheets_too(sides):
    """Last passed on 30 November 2026."""
    found = [of_mesh(box(sides, radius, seed)) for seed, radius in enumerate(RADII)]
    assert found == pytest.approx(RADII, abs=0.05)
    assert np.all(np.diff(found) > 0)


@pytest.mark.parametrize("rim", [0.2, 0.5, 0.8])
@pytest.mark.parametrize(("radius", "height"), [(1, 2), (1, 8), (4, 2)])
def test_cylinders_have_the_radius_of_their_rims(radius, height, rim):
    """The side of a long one, as curved as the inscribed sphere, is no corner."""
    assert of_mesh(turned(cylinder(radius, height, rim), 3)) == pytest.approx(rim, abs=0.05)


@pytest.mark.parametrize("axes", [(1.1, 1.05, 1), (1.5, 1.2, 1), (2, 2, 1), (2, 1, 1)])
def test_ellipsoids_have_the_mean_radius_of_where_they_are_curved_most(axes):
    ball = trimesh.creation.icosphere(6)
    mesh = turned(trimesh.Trimesh(ball.vertices * axes, ball.faces, process=False), 5)
    assert of_mesh(mesh) == pytest.approx(roundness_of_ellipsoid(*axes), abs=0.05)


@pytest.mark.parametrize("sides", [(2, 2, 2), (6, 6, 2)], ids=["cube", "plate"])
@pytest.mark.parametrize("radius", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_voxels_tell_it_at_sixty_across(sides, radius):
    grain = as_voxels(box(sides, radius, 7), 2 / 60)
    assert measure_detail(grain).roundness == pytest.approx(radius, abs=0.05)


def test_a_grain_of_few_voxels_has_none_and_says_so():
    found = measure_detail(as_voxels(box((2, 2, 2), 0.5, 1), 2 / 12))
    assert math.isnan(found.roundness)
    assert "fewer than 15 voxels" in found.warning
    assert found.as_dict()["roundness"] is None
    assert found.inscribed == pytest.approx(2, rel=0.06)


def test_a_ball_has_no_corners():
    assert measure_detail(trimesh.creation.icosphere(5)).roundness == pytest.approx(1, abs=0.05)
    assert measure_detail(Avatar([[0.0, 0, 0]], [1.0], "mm")).roundness == pytest.approx(1, abs=0.05)
