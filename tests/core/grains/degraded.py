"""Scans with known grains, degraded in one way each."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from jaxtyping import Int, UInt16
from scipy import ndimage

from mbstudio.core.scan import make_phantom, sample_recipe

VOID, CONTRAST = 20_000.0, 12_000.0


@cache
def packed(seed: int = 0, edge: int = 96, scale: float = 0.75) -> Int[np.ndarray, "Z Y X"]:
    """Return true labels of grains pressed together, by default some 25 voxels across."""
    recipe = sample_recipe()
    kinds = {
        name: replace(kind, diameter=(scale * kind.diameter[0], scale * kind.diameter[1]))
        for name, kind in recipe.kinds.items()
    }
    shape = (edge, edge, edge)
    recipe = replace(
        recipe, shape=shape, field_of_view_radius=None, kinds=kinds, bright_grains=0, inclusions=0
    )
    return np.asarray(make_phantom(recipe, seed).labels)


@cache
def scattered(share: float, seed: int = 0, edge: int = 96) -> Int[np.ndarray, "Z Y X"]:
    """Return true labels of ellipsoids apart from each other that fill about this share of the box."""
    rng = np.random.default_rng(seed)
    labels = np.zeros((edge, edge, edge), np.int32)
    axes = np.indices(labels.shape, sparse=True)
    count = 0
    for _ in range(2000):
        if (labels > 0).mean() >= share:
            break
        centre, half = rng.uniform(13, edge - 13, 3), rng.uniform(5, 10, 3)
        near = sum(((a - c) / (h + 2)) ** 2 for a, c, h in zip(axes, centre, half, strict=True)) <= 1
        if not labels[near].any():
            count += 1
            inside = sum(((a - c) / h) ** 2 for a, c, h in zip(axes, centre, half, strict=True)) <= 1
            labels[inside] = count
    return labels


def scanned(
    labels: Int[np.ndarray, "Z Y X"],
    *,
    seed: int = 0,
    noise: float = 0.07,
    blur: float = 0.7,
    toned: tuple[float, float] = (0.0, 1.0),
    cupping: float = 0.0,
    drift: float = 0.0,
    rings: float = 0.0,
    water: float = 0.0,
    dark: bool = False,
) -> UInt16[np.ndarray, "Z Y X"]:
    """Return grey values; noise, cupping, drift and rings in contrasts of grain and void.

    Parameters
    ----------
    toned : tuple of float
        Share of the grains that have another tone, and that tone's contrast over the usual one.
    water : float
        Thickness of a film around the grains, in voxels, half-way between void and grain.
    """
    rng = np.random.default_rng(seed)
    count = int(labels.max())
    tones = np.concatenate([[0.0], 1 + 0.03 * rng.standard_normal(count)])
    tones[1 + rng.permutation(count)[: round(toned[0] * count)]] *= toned[1]
    image = tones[labels]
    if water:
        away = ndimage.distance_transform_edt(labels == 0)
        image = np.where((away > 0) & (away < water), 0.5, image)
    image = ndimage.gaussian_filter(image.astype(np.float32), blur)
    if dark:
        image = 1 - image
    nz, ny, nx = labels.shape
    z, y, x = np.indices(labels.shape, sparse=True)
    radius = np.hypot(y - (ny - 1) / 2, x - (nx - 1) / 2)
    image = image + cupping * (np.minimum(2 * radius / nx, 1.2) ** 2 - 0.5) + drift * (z / (nz - 1) - 0.5)
    if rings:
        profile = ndimage.gaussian_filter1d(rng.standard_normal(2 * nx), 0.6)
        image = image + rings * np.interp(radius, np.arange(2 * nx), profile / np.abs(profile).max())
    image = image + noise * rng.standard_normal(labels.shape)
    return np.clip(np.rint(VOID + CONTRAST * image), 1, 65_535).astype(np.uint16)
