"""Styles of a few made stones, learned once."""

from __future__ import annotations

from functools import cache

from mbstudio.core.cloning.parent_avatars import fit_parents
from mbstudio.core.cloning.surface_style import SurfaceStyle, learn_surfaces
from tests.core.cloning.conftest import make_stone


@cache
def fitted_stones(count: int = 4, n: int = 20) -> SurfaceStyle:
    """Return the style of stones of few triangles, with metaballs of their parents."""
    stones = [make_stone(seed, 2) for seed in range(count)]
    return fit_parents(learn_surfaces(stones, [f"stone {place}" for place in range(count)]), n)
