"""Exact silhouettes, convex or not, and the search of the widest."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh

from benchmarks.known_solids import dumb_bell
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


def test_the_widest_view_of_a_dumb_bell_is_from_the_side():
    known = dumb_bell(0.45, 0.55, 0.2)
    balls = [trimesh.creation.icosphere(5, 0.45).apply_translation([0, 0, z]) for z in (-0.55, 0.55)]
    neck = trimesh.creation.cylinder(0.2, segment=[[0, 0, -0.55], [0, 0, 0.55]], sections=256)
    mesh = turned(trimesh.boolean.union([*balls, neck], engine="manifold"), 5)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    found = maximum_projection(vertices, faces, convex_hull(vertices))
    assert found.area == pytest.approx(known.shadow[0], rel=1.5e-3)
    assert found.perimeter == pytest.approx(known.shadow[1], rel=2e-3)


def test_three_crossed_plates_seen_along_a_diagonal():
    """Squares of side 2 across each axis: along (1, 1, 1) their shadows unite to a known star."""
    plates = [trimesh.creation.box(np.where(np.arange(3) == axis, 1e-4, 2.0)) for axis in range(3)]
    mesh = turned(trimesh.boolean.union(plates, engine="manifold"), 6)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    found = maximum_projection(vertices, faces, convex_hull(vertices))
    caster = SilhouetteCaster(vertices, faces)
    rng = np.random.default_rng(2)
    brute = max(caster.area(direction) for direction in rng.normal(size=(3000, 3)))
    assert found.area >= brute * (1 - 1e-3)
    assert found.area < 12, "no more than the plates' faces"


@pytest.mark.parametrize("seed", range(4))
def test_no_start_leads_higher_on_concave_bodies(seed):
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(4):
        part = trimesh.creation.box(rng.uniform(0.3, 4, 3))
        parts.append(turned(part, int(rng.integers(10**6))).apply_translation(-part.center_mass))
        parts[-1].apply_translation(-parts[-1].center_mass)
    mesh = trimesh.boolean.union(parts, engine="manifold")
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    caster = SilhouetteCaster(vertices, faces)
    brute = max(caster.area(direction) for direction in rng.normal(size=(600, 3)))
    assert maximum_projection(vertices, faces, convex_hull(vertices)).area >= brute * (1 - 1e-3)
