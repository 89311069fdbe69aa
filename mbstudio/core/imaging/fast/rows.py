"""What the fast search asks of an avatar: surface points, interior points, the solid as a whole.

Each part knows its points and weights; :class:`~mbstudio.core.imaging.fast.refine.Refinement` makes the rows
of its sum of squares from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.fast.levenberg_marquardt import field_of_rows
from mbstudio.core.imaging.preprocess import PreparedGrain


class Residuals(NamedTuple):
    """The rows of the sum of squares at some control points, and what their derivatives need.

    Attributes
    ----------
    surface, field : float32 arrays, shape (p,)
        Distances and f at the surface points, unweighted.
    hinge, inner : float32 arrays, shape (q,)
        Weighted hinges and f at the interior points.
    shallow : float array, shape (n,)
        Weighted lacks of depth of the control points.
    slope : float array, shape (3, n)
        Gradients of the signed distance there.
    volume, area : float
        The weighted rows of the solid.
    """

    surface: np.ndarray
    field: np.ndarray
    hinge: np.ndarray
    inner: np.ndarray
    shallow: np.ndarray
    slope: np.ndarray
    volume: float
    area: float

    def half_sum_of_squares(self, row_weight: np.ndarray) -> float:
        """Return half the sum of the squares of all rows; `row_weight` is that of the surface points."""
        return 0.5 * (
            float(np.sum(np.square(row_weight * self.surface, dtype=np.float64)))
            + float(np.sum(np.square(self.hinge, dtype=np.float64)))
            + float(self.shallow @ self.shallow)
            + self.volume**2
            + self.area**2
        )


class SurfaceRows(NamedTuple):
    """Weighted rows at points, and their derivatives by f; all in single precision.

    Attributes
    ----------
    points : float32 array, shape (3, m)
    residual, slope : float32 arrays, shape (m,)
    """

    points: np.ndarray
    residual: np.ndarray
    slope: np.ndarray


class InteriorPoints:
    """Points that must lie inside the avatar, or outside it, by a margin.

    Attributes
    ----------
    points : float32 array, shape (3, q)
    side : float32 array, shape (q,)
        1 where the point must lie inside, -1 outside.
    weight : float32 array, shape (q,)
    """

    def __init__(self, prepared: PreparedGrain, weight: float) -> None:
        self.points = np.ascontiguousarray(prepared.interior.T, dtype=np.float32)
        self._margin = (0.5 * np.minimum(prepared.interior_depth, 0.15)).astype(np.float32)
        count = len(self._margin)
        self.side = np.ones(count, dtype=np.float32)
        self.weight = np.full(count, weight / np.sqrt(max(count, 1)), dtype=np.float32)

    def add(
        self, points: Float64[np.ndarray, "3 p"], depth: Float64[np.ndarray, "p"], weight: float, filled: bool
    ) -> None:
        """Add points that must lie inside the avatar, or outside it, about as deep as in the grain."""
        count = points.shape[1]
        self.points = np.ascontiguousarray(np.hstack([self.points, points.astype(np.float32)]))
        self.side = np.append(self.side, np.full(count, 1 if filled else -1, dtype=np.float32))
        self._margin = np.append(self._margin, np.minimum(0.5 * depth, 0.075).astype(np.float32))
        rows = np.full(count, weight / np.sqrt(max(count, 1)), dtype=np.float32)
        self.weight = np.append(self.weight, rows)

    def hinges(self, control: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the weighted hinges and f at the points, for control points in single precision."""
        inner = np.empty(self.points.shape[1], dtype=np.float32)
        field_of_rows(self.points, control, inner)
        return self.hinges_of(inner), inner

    def hinges_of(self, inner: np.ndarray) -> np.ndarray:
        """Return the weighted hinges for f at the points."""
        hinge: np.ndarray = np.minimum(self.side * (1 - inner**-0.5) - self._margin, 0)
        hinge *= self.weight
        return hinge


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """The surface points in use, the tips among them.

    Attributes
    ----------
    points : float32 array, shape (3, p)
    row_weight : float32 array, shape (p,)
        Weights of the distances in the sum of squares.
    share : float32 array, shape (p,)
        Their weights in means over the surface; of tips 0.
    """

    points: np.ndarray
    row_weight: np.ndarray
    share: np.ndarray

    @classmethod
    def join(cls, chosen: np.ndarray, tips: np.ndarray, tip_weight: np.ndarray) -> SurfacePoints:
        """Return hull points (rows x, y, z) and tips as one."""
        m, t = chosen.shape[1], tips.shape[1]
        return cls(
            np.ascontiguousarray(np.hstack([chosen, tips])),
            np.concatenate([np.full(m, 1 / np.sqrt(m)), tip_weight]).astype(np.float32),
            np.concatenate([np.full(m, 1 / m), np.zeros(t)]).astype(np.float32),
        )

    def mean(self, values: np.ndarray) -> float:
        """Return the mean over the surface of what is known at the points."""
        return float((self.share * values).sum(dtype=np.float64))


@dataclass(frozen=True, eq=False)
class SolidRows:
    """Volume and area of the avatar as measured last, linear in the distances of the surface points since.

    Attributes
    ----------
    volume_offset, area_offset : float
        What the rows have beside the means of the distances.
    area_weight : float
        0 where the area is left alone.
    bend : float32 array, shape (p,)
        By how much the area grows with the displacement at each surface point.
    """

    volume_offset: float
    bend: np.ndarray
    area_weight: float = 0.0
    area_offset: float = 0.0
