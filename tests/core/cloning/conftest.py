"""Stones made here: spheres cut by random planes, with some roughness."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.cloning.parent_avatars import fit_parents
from mbstudio.core.cloning.surface_style import SurfaceStyle, learn_surfaces


def make_stone(seed: int, subdivisions: int = 3) -> trimesh.Trimesh:
    """Return a closed stone in mm: convex, of about ten faces, with edges a little rounded."""
    rng = np.random.default_rng(seed)
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    along = np.asarray(sphere.vertices)
    normals = rng.normal(size=(10, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    reach = rng.uniform(0.7, 1.0, 10)
    nearness = np.maximum(along @ normals.T, 1e-3) / reach
    radius = np.power(np.power(nearness, 12).sum(axis=1) + 1e-6, -1 / 12)
    radius = np.minimum(radius, 1.4) * (1 + 0.01 * rng.normal(size=len(along)))
    form = np.exp(rng.normal(0, 0.15, 3)) * rng.uniform(1.5, 3.0)
    mesh = trimesh.Trimesh(along * radius[:, None] * form, sphere.faces, process=False)
    mesh.units = "mm"
    return mesh


@pytest.fixture(scope="session")
def stones() -> list[trimesh.Trimesh]:
    return [make_stone(seed) for seed in range(10)]


@pytest.fixture(scope="session")
def style(stones: list[trimesh.Trimesh]) -> SurfaceStyle:
    return learn_surfaces(stones, [f"stone {i}" for i in range(len(stones))])


@pytest.fixture(scope="session")
def fitted_style(stones: list[trimesh.Trimesh]) -> SurfaceStyle:
    return fit_parents(learn_surfaces(stones[:4]), 20)
