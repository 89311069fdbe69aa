"""The paper's loss of the gradient search (Eq. GSloss) and its derivative by f.

With f the metaball function at a hull point, the loss of that point is

- ``(f - 1)**2`` for f >= 2,
- ``f - 1`` for 1 <= f <= 2,
- ``(f - 1)**2 + 1/f - 1`` for 0 < f <= 1,

which is continuous. mbstudio reports the mean over the hull points, so that the value does not
depend on their number.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from mbstudio.core.compiled import compiled


@compiled(error_model="numpy")
def _mean_loss(field: np.ndarray) -> float:
    total = 0.0
    for i in range(len(field)):
        f = np.float64(field[i])
        if f >= 2.0:
            total += (f - 1.0) ** 2
        elif f >= 1.0:
            total += f - 1.0
        else:
            total += (f - 1.0) ** 2 + 1.0 / f - 1.0
    return total / len(field)


def mean_loss(field: Float[np.ndarray, "m"]) -> float:
    """Return the mean of Eq. GSloss over hull points, given f at each of them."""
    return float(_mean_loss(np.ascontiguousarray(field)))


def point_loss_slope(field: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    """Return the derivative of Eq. GSloss by f at each hull point (at 1 and 2: the middle branch)."""
    f = np.asarray(field, dtype=np.float64)
    return np.where(f > 2, 2 * (f - 1), np.where(f >= 1, 1.0, 2 * (f - 1) - 1 / np.minimum(f, 1) ** 2))
