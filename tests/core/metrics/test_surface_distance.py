"""The distance of two surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.metrics.surface_distance import (
    closest_on_triangles,
    farthest_distance,
    hausdorff_distance,
)


def surface(mesh: trimesh.Trimesh):
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def sphere(radius, centre=(0, 0, 0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    mesh.apply_translation(centre)
    return mesh


@pytest.mark.parametrize(
    ("other", "distance"),
    [
        (sphere(2.0), 1.0),
        (sphere(3.0, (0.0, 0.4, 0.3)), 0.5),
        # A small ball far away: only those of its points that lie farthest count.
        (trimesh.util.concatenate([sphere(3.0), sphere(0.5, (10.0, 0, 0))]), 7.5),
    ],
)
def test_hausdorff_distance_of_balls(other, distance):
    one, two = surface(sphere(3.0)), surface(other)
    assert hausdorff_distance(one, two) == pytest.approx(distance, abs=0.003)
    assert hausdorff_distance(two, one) == pytest.approx(distance, abs=0.003)


def test_distance_is_to_the_faces_not_to_their_corners():
    """The nearest corner of a plain of two triangles is much farther off."""
    plain = (
        np.array([[-50.0, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    above = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    above.apply_translation([3.0, 7.0, 5.0])
    assert farthest_distance(np.asarray(above.vertices), plain) == pytest.approx(6.0, abs=1e-9)


def test_it_is_that_of_the_side_that_sticks_out():
    box = trimesh.creation.box((1, 1, 1)).subdivide().subdivide()
    horned = box.copy()
    tip = int(np.argmax(horned.vertices @ [1, 1, 1]))
    horned.vertices[tip] += 1.0
    assert hausdorff_distance(surface(box), surface(horned)) == pytest.approx(np.sqrt(3))
    assert farthest_distance(np.asarray(box.vertices), surface(horned)) < 0.5


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e6])
def test_the_unit_does_not_count(scale):
    """Grains in metres have triangles of a micrometre."""
    first, second = (surface(trimesh.creation.icosphere(4, radius)) for radius in (1.0, 1.1))
    distance = hausdorff_distance((first[0] * scale, first[1]), (second[0] * scale + 3 * scale, second[1]))
    assert distance / scale == pytest.approx(hausdorff_distance(first, (second[0] + 3, second[1])), rel=1e-9)
    corner = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]])
    inside = closest_on_triangles(corner * scale, np.array([[0.5, 0.5, 3.0]]) * scale)
    assert inside / scale == pytest.approx(np.array([[0.5, 0.5, 0.0]]))
