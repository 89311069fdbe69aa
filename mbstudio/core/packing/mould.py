"""Moulds: a box or a cylinder that stands on the plane z = 0 around the z axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

SHAPES = ("box", "cylinder")
_FACETS = 32
"""Flat walls that stand for a cylinder's: its section is 0.3 % larger than the circle that they touch."""
_LOOSE = 0.42


@dataclass(frozen=True)
class Mould:
    """A mould, open at the top.

    Attributes
    ----------
    shape : str
        ``box`` or ``cylinder``.
    half : float
        Half the width of the box, or the radius of the cylinder.
    periodic : bool
        Whether the sides of the box are periodic: what leaves at one enters at the other.
    """

    shape: str
    half: float
    periodic: bool = False

    @property
    def normals(self) -> Float[np.ndarray, "sides 2"]:
        """Directions into the mould, of its flat side walls; each is `half` away from the axis."""
        sides = 4 if self.shape == "box" else _FACETS
        angles = 2 * np.pi * np.arange(sides) / sides
        return -np.column_stack([np.cos(angles), np.sin(angles)]).round(15)

    def wall_distance(self, points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        """Return how far points (x, y) are from the nearest side wall, negative outside; infinity without."""
        if self.periodic:
            return np.full(len(points), np.inf)
        distances: np.ndarray = (points @ self.normals.T).min(axis=1) + self.half
        return distances

    def holds(self, positions: Float[np.ndarray, "m 3"]) -> Bool[np.ndarray, " m"]:
        """Return whether points lie within the mould, above its floor."""
        return (self.wall_distance(positions[:, :2]) > 0) & (positions[:, 2] > 0)


def width_for(solid: float, shape: str) -> float:
    """Return half the width of a mould in which so much solid settles to about the height of its width."""
    volume = solid / (1.0 - _LOOSE)
    area_per_square = 4.0 if shape == "box" else np.pi  # over half the width squared
    return float((volume / (2.0 * area_per_square)) ** (1 / 3))
