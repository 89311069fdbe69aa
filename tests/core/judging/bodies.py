"""Bodies for judges: rough angular grains drawn from a seed, all by one recipe."""

from __future__ import annotations

import numpy as np
import trimesh

from mbstudio.core.judging.features import Features, body_features


def rough_grain(rng: np.random.Generator, bumps: float = 0.12, level: int = 4) -> trimesh.Trimesh:
    """Return a ball cut by planes, with soft bumps of a height in radii."""
    mesh = trimesh.creation.icosphere(subdivisions=level)
    along = np.asarray(mesh.vertices)
    planes = rng.standard_normal((9, 3))
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    depth = rng.uniform(0.75, 0.95, len(planes))
    cut = np.maximum(along @ planes.T, 1e-3) / depth
    radii = (np.sum(np.concatenate([np.ones((len(along), 1)), cut], axis=1) ** 24, axis=1)) ** (-1 / 24)
    centres = rng.standard_normal((12, 3))
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    heights = bumps * rng.standard_normal(len(centres))
    radii = radii * np.exp(np.exp(-((along[:, None] - centres[None]) ** 2).sum(-1) / 0.18) @ heights)
    mesh.vertices = along * radii[:, None] * rng.uniform([0.8, 0.7, 0.6], [1.0, 0.9, 0.8])
    return mesh


def features_of(mesh: trimesh.Trimesh) -> Features:
    return body_features(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def drawn(count: int, seed: int, bumps: float = 0.12) -> list[Features]:
    """Return the features of grains drawn from a seed."""
    rng = np.random.default_rng(seed)
    return [features_of(rough_grain(rng, bumps, 3)) for _ in range(count)]


def made_up(values: np.ndarray) -> Features:
    """Return features of these values and radii of a ball."""
    return Features(np.asarray(values, dtype=float), np.zeros(144), 0.0, 0.02, ())
