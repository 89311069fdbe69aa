"""Registration: it lays one body onto another, and finds a warp that is known."""

from __future__ import annotations

import numpy as np
import trimesh

from mbstudio.core.cloning.kernel_warp import displacement, lattice
from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.registration import SurfaceTarget, register
from tests.core.cloning.conftest import make_stone


def test_it_brings_bodies_nearer(stones: list[trimesh.Trimesh]) -> None:
    parents = [ParentSurface.from_mesh(stone, "stone") for stone in stones[:4]]
    for target in map(SurfaceTarget, parents[1:]):
        found = register(parents[0], target, np.random.default_rng(0))
        assert found.after < 0.65 * found.before


def test_it_finds_a_warp_that_is_known() -> None:
    stone = ParentSurface.from_mesh(make_stone(5), "stone")
    warp = 0.04 * np.random.default_rng(2).normal(size=(len(lattice()), 3))
    moved = stone.vertices + displacement(stone.vertices, warp)
    other = ParentSurface(stone.name, moved, stone.faces, stone.semi_axes, 1.0, "mm")
    found = register(stone, SurfaceTarget(other), np.random.default_rng(0))
    assert found.flip == 0
    assert found.after < 0.35 * found.before


def test_a_body_onto_itself_is_no_warp() -> None:
    stone = ParentSurface.from_mesh(make_stone(5), "stone")
    found = register(stone, SurfaceTarget(stone), np.random.default_rng(0))
    assert found.before < 1e-12
    assert abs(found.coefficients).max() < 1e-9


def test_a_mirrored_body_is_recognised() -> None:
    stone = ParentSurface.from_mesh(make_stone(7), "stone")
    other = ParentSurface(
        "mirrored", stone.vertices * [1, 1, -1], stone.faces[:, ::-1], stone.semi_axes, 1.0, "mm"
    )
    found = register(stone, SurfaceTarget(other), np.random.default_rng(0))
    assert found.flip == 1
    assert found.before < 1e-12
