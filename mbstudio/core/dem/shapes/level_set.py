"""The signed distance to an avatar on a padded grid: the shape as level-set engines take it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from mbstudio.core.errors import ExportError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surfaces import avatar_surface
from mbstudio.core.units import parse_unit

_STRIDE = 200_000
_STEEPEST = 1.1
"""Distances of neighbours differ by at most their distance; the rest is for the bound by surface points."""
_VOLUME = 0.02
_CENTER = 0.01


@dataclass(frozen=True, eq=False)
class LevelSet:
    """Signed distances, negative inside, at ``origin + (i, j, k) * spacing``.

    Attributes
    ----------
    values : float array, shape (nx, ny, nz)
        Indexed [x, y, z], in unit.
    origin : float array, shape (3,)
        Place of node (0, 0, 0), in unit.
    spacing : float
        Of the nodes along every axis, in unit.
    unit : str
    """

    values: Float[np.ndarray, "x y z"]
    origin: Float[np.ndarray, " 3"]
    spacing: float
    unit: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", parse_unit(self.unit))

    @property
    def volume(self) -> float:
        """Volume of the solid, in unit**3, each node counting by the share of its cell that is inside."""
        return float(self._inside().sum()) * self.spacing**3

    @property
    def center(self) -> Float[np.ndarray, " 3"]:
        """Centre of mass, in unit."""
        inside = self._inside()
        sums = [
            (inside.sum(axis=tuple({0, 1, 2} - {axis})) * np.arange(inside.shape[axis])).sum()
            for axis in range(3)
        ]
        center: np.ndarray = self.origin + self.spacing * np.array(sums) / inside.sum()
        return center

    def _inside(self) -> Float[np.ndarray, "x y z"]:
        return np.clip(0.5 - np.asarray(self.values, dtype=float) / self.spacing, 0.0, 1.0)


def level_set(avatar: Avatar, cells: int = 32, padding: int = 3) -> LevelSet:
    """Return the signed distance to an avatar on a grid around it.

    The distance is that of :meth:`Avatar.signed_distance`, iterated; where that ends at a nearest
    point of its surroundings only, a nearer vertex of a fine mesh of the surface bounds it.

    Parameters
    ----------
    avatar : Avatar
    cells : int
        Grid cells along the longest side of the avatar, at least 4.
    padding : int
        Cells beyond the avatar on every side, at least 1: a cropped grid is a cropped grain.

    Raises
    ------
    ExportError
        If there are too few cells or no padding.
    MeasureError
        If the avatar is in several pieces.
    """
    if cells < 4 or padding < 1:
        raise ExportError(f"The grid needs at least 4 cells and a padding of 1, not {cells} and {padding}.")
    vertices = avatar_surface(avatar).fine[0]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    spacing = float((high - low).max()) / cells
    counts = np.ceil((high - low) / spacing - 1e-9).astype(int) + 2 * padding + 1
    origin = (low + high) / 2 - (counts - 1) / 2 * spacing
    axes = [start + spacing * np.arange(count) for start, count in zip(origin, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    tree = cKDTree(vertices)
    values = np.empty(len(points))
    for start in range(0, len(points), _STRIDE):
        part = points[start : start + _STRIDE]
        distance = avatar.signed_distance(part, iterated=True)
        values[start : start + _STRIDE] = np.copysign(
            np.minimum(np.abs(distance), tree.query(part)[0]), distance
        )
    return LevelSet(values.reshape(counts), origin, spacing, avatar.unit)


def check_level_set(what: str, grid: LevelSet, volume: float) -> None:
    """Raise ExportError unless a grid is the whole signed distance of a body about its centre of mass.

    Parameters
    ----------
    what : str
        Name in messages.
    grid : LevelSet
    volume : float
        Of the body, in unit**3.
    """
    values = np.asarray(grid.values, dtype=float)
    if values.ndim != 3 or min(values.shape) < 5:
        raise ExportError(f"{what} is not a grid with three axes.")
    if not (np.isfinite(values).all() and np.isfinite(grid.origin).all()) or not grid.spacing > 0:
        raise ExportError(f"{what} has numbers that are not finite, or no spacing.")
    if not (values < 0).any():
        raise ExportError(f"{what} has no node inside the grain: distances inside must be negative.")
    border = np.ones(values.shape, dtype=bool)
    border[1:-1, 1:-1, 1:-1] = False
    if values[border].min() < 0.5 * grid.spacing:
        raise ExportError(f"{what} is cropped: the grain reaches the border of the grid. Give more padding.")
    steepest = max(float(np.abs(np.diff(values, axis=axis)).max()) for axis in range(3))
    if steepest > _STEEPEST * grid.spacing:
        raise ExportError(f"{what} does not hold distances: neighbours differ by more than their spacing.")
    if abs(grid.volume / volume - 1) > _VOLUME:
        raise ExportError(
            f"{what} has a volume of {grid.volume:g}, the avatar {volume:g}: give more 'cells'."
        )
    if np.abs(grid.center).max() > _CENTER * volume ** (1 / 3):
        raise ExportError(f"{what} does not have its centre of mass at the origin.")
