"""Whether parents are of one kind of material, or of two that no clone lies between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial import ConvexHull

from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.solid_moments import solid_moments
from mbstudio.core.cloning.surface_style import SurfaceStyle

FEWEST = 3
"""Parents that make a kind of their own; fewer are outliers."""
_CLEAR = 5.0
"""Difference of means over the deviation within, from which on two kinds are told. The best split of one
normal kind gives 2.7, of a uniform one 3.5."""
_FACTORS = ("area", "hollowness")


@dataclass(frozen=True)
class ParentsGap:
    """Two kinds of material among parents.

    Attributes
    ----------
    factor : {'area', 'hollowness'}
        By which they are told: the surface beyond that of an ellipsoid, or the volume that the hull adds.
    names : tuple of str
        Of the smaller group.
    lower, upper : float
        Mean of the group with less of it, and with more.
    separation : float
        Difference of the means (of logarithms) over the deviation within the groups.
    """

    factor: str
    names: tuple[str, ...]
    lower: float
    upper: float
    separation: float

    def __str__(self) -> str:
        what = {
            "area": "surface beyond that of an ellipsoid",
            "hollowness": "volume between the body and its convex hull",
        }[self.factor]
        some = ", ".join(self.names[:4]) + (" and others" if len(self.names) > 4 else "")
        return (
            f"The parents seem to be of two materials: {len(self.names)} of them ({some}) differ from the "
            f"rest in {what}, {100 * self.lower:.1f} % against {100 * self.upper:.1f} %. Clones mix their "
            "forms: learn each material by itself."
        )


def find_gap(style: SurfaceStyle) -> ParentsGap | None:
    """Return the clearest gap between two kinds of parents; None where they are of one kind."""
    names = [parent.name for parent in style.parents]
    values = np.stack([surface_texture(parent) for parent in style.parents])
    found = [gap for place, factor in enumerate(_FACTORS) if (gap := _split(factor, names, values[:, place]))]
    return max(found, key=lambda gap: gap.separation, default=None)


def surface_texture(parent: ParentSurface) -> Float64[np.ndarray, " 2"]:
    """Return what tells kinds of stone from each other, free of form and size.

    Returns
    -------
    float array, shape (2,)
        Of the body with the second moments of a ball: its area over that of the ball of its volume, less 1,
        and the share of volume that its convex hull adds.
    """
    vertices, faces = parent.vertices, parent.faces
    volume = solid_moments(vertices, faces).volume
    ball = np.pi * (6.0 * volume / np.pi) ** (2 / 3)
    return np.array([surface_area(vertices, faces) / ball - 1.0, ConvexHull(vertices).volume / volume - 1.0])


def surface_area(vertices: Float[np.ndarray, "v 3"], faces: np.ndarray) -> float:
    """Return the area of triangles."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _split(factor: str, names: list[str], values: Float[np.ndarray, " parents"]) -> ParentsGap | None:
    """Return the best split of one factor, where that is clear (Otsu 1979)."""
    logs = np.log(np.maximum(values, 1e-4))
    order = np.argsort(logs, kind="stable")
    best: ParentsGap | None = None
    for count in range(FEWEST, len(names) - FEWEST + 1):
        low, high = order[:count], order[count:]
        within = np.sqrt((count * logs[low].var() + len(high) * logs[high].var()) / len(names))
        # What differs by less than a tenth is one kind, however alike the rest is.
        separation = float((logs[high].mean() - logs[low].mean()) / max(within, 0.1))
        if separation >= _CLEAR and (best is None or separation > best.separation):
            fewer = low if count <= len(high) else high
            best = ParentsGap(
                factor, tuple(names[row] for row in sorted(fewer.tolist())),
                float(values[low].mean()), float(values[high].mean()), separation,
            )  # fmt: skip
    return best
