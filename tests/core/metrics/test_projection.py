"""Exact silhouettes, convex or not, and the search of the widest."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh

from mbstudio.core.metrics.axes import convex_hull
from mbstudio.core.metrics.projection import SilhouetteCaster, maximum_projection
from tests.core.metrics.solids import turned


def test_a_cast_of_a_concave_body_equals_the_union_of_its_triangles():
    mesh = turned(trimesh.creation.torus(2, 0.6, major_sections=40, minor_sections=20), 3)
    caster = SilhouetteCaster(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    for direction in np.random.default_rng(0).normal(size=(5, 3)):
        found = caster.cast(direction)
        frame = np.linalg.svd(direction[None])[2]
        flat = mesh.vertices @ frame[1:].T
        union = shapely.union_all([shapely.Polygon(triangle) for triangle in flat[mesh.faces]])
        assert found.area == pytest.approx(union.area, rel=1e-6)
        assert found.perimeter == pytest.approx(union.length, rel=1e-4)


def test_a_surface_that_touches_itself_along_an_edge_is_cast_all_the_same():
    first = trimesh.creation.box((1, 1, 1))
    second = first.copy().apply_translation([1, 1, 0])
    both = trimesh.util.concatenate([first, second])
    both.merge_vertices()
    assert len(both.vertices) == 14, "the two cubes share an edge"
    found = SilhouetteCaster(np.asarray(both.vertices), np.asarray(both.faces)).cast(np.array([0.0, 0, 1]))
    assert found.area == pytest.approx(2)
    assert found.perimeter == pytest.approx(8)


def test_the_widest_view_of_a_concave_body_is_found_among_brute_force():
    blocks = [
        trimesh.creation.box((6, 1, 1)),
        trimesh.creation.box((1, 1, 4)).apply_translation([2.5, 0, 1.7]),
    ]
    mesh = turned(trimesh.boolean.union(blocks, engine="manifold"), 11)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    caster = SilhouetteCaster(vertices, faces)
    brute = max(caster.area(direction) for direction in np.random.default_rng(1).normal(size=(4000, 3)))
    found = maximum_projection(vertices, faces, convex_hull(vertices))
    assert found.area >= brute * (1 - 1e-3)
