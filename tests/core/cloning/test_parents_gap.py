"""Parents of two materials are told, parents of one are not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.cloning.parents_gap import find_gap, surface_texture
from mbstudio.core.cloning.surface_style import learn_surfaces
from tests.core.cloning.conftest import make_stone


def make_pebble(seed: int) -> trimesh.Trimesh:
    """Return a smooth ellipsoid with a little roughness."""
    rng = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.vertices *= np.exp(rng.normal(0, 0.15, 3)) * (1 + 0.002 * rng.normal(size=(len(mesh.vertices), 1)))
    mesh.units = "mm"
    return mesh


def test_pebbles_among_stones_are_told():
    bodies = [make_stone(seed, 2) for seed in range(8)] + [make_pebble(seed) for seed in range(4)]
    names = [f"stone {i}" for i in range(8)] + [f"pebble {i}" for i in range(4)]
    gap = find_gap(learn_surfaces(bodies, names))
    assert gap is not None
    assert gap.names == ("pebble 0", "pebble 1", "pebble 2", "pebble 3")
    assert gap.lower < gap.upper
    assert "4 of them (pebble 0, " in str(gap)


@pytest.mark.parametrize("make", [lambda seed: make_stone(seed, 2), make_pebble])
def test_one_material_is_one(make):
    assert find_gap(learn_surfaces([make(seed) for seed in range(12)])) is None


def test_texture_knows_no_form():
    stone = make_stone(3, 2)
    long = stone.copy()
    long.vertices *= (2.0, 1.0, 0.5)
    textures = [surface_texture(parent) for parent in learn_surfaces([stone, long]).parents]
    np.testing.assert_allclose(textures[0], textures[1], rtol=1e-9)
