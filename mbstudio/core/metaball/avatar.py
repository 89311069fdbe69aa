"""The avatar: a grain as a metaball of n control points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import AvatarError
from mbstudio.core.units import parse_unit


@dataclass(frozen=True, eq=False)
class Avatar:
    """The solid ``f(x) >= 1`` of the metaball function ``f(x) = sum_i k_i / |x - x_i|**2``.

    Attributes
    ----------
    centers : float array, shape (n, 3)
        Control points x_i as (x, y, z) in `unit`, in the frame of the grain (so that the
        avatar lies over its scan). Read-only.
    weights : float array, shape (n,)
        Positive coefficients k_i in unit**2. Read-only.
    unit : str
        Canonical length unit.
    label : int or None
        Label of the grain that it was fitted to.
    name : str
        A short name for tables and file names.

    Raises
    ------
    AvatarError
        If shapes disagree, values are not finite, or a weight is not positive.

    References
    ----------
    Zhao et al. (2023), Computers and Geotechnics 161, 105564, Eq. (1).
    """

    centers: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n"]
    unit: str
    label: int | None = None
    name: str = "avatar"

    def __post_init__(self) -> None:
        centers = np.array(self.centers, dtype=np.float64)
        weights = np.array(self.weights, dtype=np.float64)
        if centers.ndim != 2 or centers.shape[1] != 3 or weights.shape != centers.shape[:1] or not len(centers):
            raise AvatarError(
                f"Avatar '{self.name}' has control points of shape {centers.shape} and weights of shape "
                f"{weights.shape}: they must be (n, 3) and (n,) with n >= 1."
            )
        if not (np.isfinite(centers).all() and np.isfinite(weights).all()):
            raise AvatarError(f"Avatar '{self.name}' has control points or weights that are not finite numbers.")
        if weights.min() <= 0:
            raise AvatarError(f"Avatar '{self.name}' has a weight of {weights.min():g}: every k must be positive.")
        centers.flags.writeable = weights.flags.writeable = False
        object.__setattr__(self, "centers", centers)
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "unit", parse_unit(self.unit))

    @property
    def n(self) -> int:
        """Number of control points."""
        return len(self.weights)
