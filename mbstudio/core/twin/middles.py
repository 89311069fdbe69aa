"""Where the volume of a body lies, and along which axis it is longest."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.metaball.field import field_on_grid, solid_bounds

_CELLS = 40


def moments_of_volume(
    control: Float64[np.ndarray, "4 n"], cells: int = _CELLS
) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3 3"]]:
    """Return the middle of the volume of a body and the covariance of its places about it.

    As :func:`middle_of_volume` counts nodes.
    """
    nodes, axes = _filled_nodes(control, cells)
    filled = nodes.astype(np.float64)
    total = float(filled.sum())
    middle = np.array([float(np.einsum("zyx->" + "xyz"[a], filled) @ axes[a]) for a in range(3)]) / total
    away = [axes[a] - middle[a] for a in range(3)]
    covariance = np.empty((3, 3))
    for a in range(3):
        covariance[a, a] = float(np.einsum("zyx->" + "xyz"[a], filled) @ away[a] ** 2) / total
        for b in range(a):
            plane = np.einsum("zyx->" + "xyz"[a] + "xyz"[b], filled)
            covariance[a, b] = covariance[b, a] = float(away[a] @ plane @ away[b]) / total
    return middle, covariance


def longest_axis(control: Float64[np.ndarray, "4 n"]) -> Float64[np.ndarray, "3"]:
    """Return the unit vector along which a body's volume is spread the widest."""
    axis: np.ndarray = np.linalg.eigh(moments_of_volume(control)[1])[1][:, 2]
    return axis


def middle_of_volume(control: Float64[np.ndarray, "4 n"], cells: int = _CELLS) -> Float64[np.ndarray, "3"]:
    """Return the middle of the volume of a body, by counting the nodes of a grid in it.

    The nodes nearest to the surface count by how far f is above or below 1 there, so that the steps of
    the grid do not show.
    """
    filled, axes = _filled_nodes(control, cells)
    total = float(filled.sum(dtype=np.float64))
    sums = [filled.sum(axis=tuple(k for k in range(3) if k != 2 - a), dtype=np.float64) for a in range(3)]
    return np.array([float((sums[a] * axes[a]).sum()) for a in range(3)]) / total


def _filled_nodes(
    control: Float64[np.ndarray, "4 n"], cells: int
) -> tuple[Float64[np.ndarray, "z y x"], list[Float64[np.ndarray, "k"]]]:
    """Return how far each node of a grid is filled, and the nodes' x, y and z."""
    low, high = solid_bounds(control)
    step = float((high - low).max()) / cells
    shape = tuple(int(count) for count in (np.ceil((high - low) / step) + 2)[::-1])
    origin = low - 0.5 * step
    field = field_on_grid(origin, np.full(3, step), (shape[0], shape[1], shape[2]), control)
    filled = np.clip(0.5 + 4.0 * (field - 1.0), 0.0, 1.0)
    axes = [origin[a] + step * np.arange(shape[2 - a]) for a in range(3)]
    return filled, axes
