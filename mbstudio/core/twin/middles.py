"""Where the volume of a body lies."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.metaball.field import field_on_grid, solid_bounds

_CELLS = 40


def middle_of_volume(control: Float64[np.ndarray, "4 n"], cells: int = _CELLS) -> Float64[np.ndarray, "3"]:
    """Return the middle of the volume of a body, by counting the nodes of a grid in it.

    The nodes nearest to the surface count by how far f is above or below 1 there, so that the steps of
    the grid do not show.
    """
    low, high = solid_bounds(control)
    step = float((high - low).max()) / cells
    shape = tuple(int(count) for count in (np.ceil((high - low) / step) + 2)[::-1])
    origin = low - 0.5 * step
    field = field_on_grid(origin, np.full(3, step), (shape[0], shape[1], shape[2]), control)
    filled = np.clip(0.5 + 4.0 * (field - 1.0), 0.0, 1.0)
    axes = [origin[a] + step * np.arange(shape[2 - a]) for a in range(3)]
    total = float(filled.sum(dtype=np.float64))
    sums = [filled.sum(axis=tuple(k for k in range(3) if k != 2 - a), dtype=np.float64) for a in range(3)]
    return np.array([float((sums[a] * axes[a]).sum()) for a in range(3)]) / total
