"""Evenly spread directions and turns, the same in every run."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float


@lru_cache(maxsize=8)
def half_sphere(count: int) -> Float[np.ndarray, "d 3"]:
    """Return evenly spread unit vectors over half a sphere (Fibonacci), shape (count, 3)."""
    index = np.arange(count) + 0.5
    z = 1.0 - index / count
    azimuth = np.pi * (1 + np.sqrt(5.0)) * index
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)


@lru_cache(maxsize=8)
def turns(count: int) -> Float[np.ndarray, "k 3"]:
    """Return vectors spread over the unit ball (an R3 low-discrepancy sequence), each with its opposite.

    Parameters
    ----------
    count : int
        An even number.
    """
    golden = 1.2207440846057596
    u = (0.5 + np.outer(np.arange(1, count // 2 + 1), golden ** -np.arange(1.0, 4.0))) % 1.0
    z, azimuth, radius = 2 * u[:, 0] - 1, 2 * np.pi * u[:, 1], np.cbrt(0.05 + 0.95 * u[:, 2])
    ring = np.sqrt(1 - z**2)
    half = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1) * radius[:, None]
    return np.concatenate([half, -half])


def frame_along(direction: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return a right-handed frame as rows whose third row is the direction (any length but zero)."""
    third = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    lateral = np.zeros(3)
    lateral[np.abs(third).argmin()] = 1.0
    first = np.cross(lateral, third)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third])
