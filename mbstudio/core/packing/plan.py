"""What a packing is to be like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbstudio.core.errors import PackingError
from mbstudio.core.packing.mould import SHAPES

ENGINES = ("mujoco",)


@dataclass(frozen=True)
class PackingPlan:
    """What a packing is to be like.

    Attributes
    ----------
    count : int
        Number of grains, at least 2.
    friction : float
        Between grains, 0 to 2.
    wall_friction : float or None
        Between grains and mould; None: the same.
    mould : str
        ``box`` or ``cylinder``.
    width : float or None
        Of the box, or diameter of the cylinder, in the unit of the packing; None: so that the grains settle
        to about the height of the width.
    periodic : bool
        Whether the sides of the box are periodic. MuJoCo has none: it is refused with word.
    seed : int
        Of the choice of grains, their places and orientations.
    spheres : int
        Of each clump.
    engine : str
        One of `ENGINES`.
    overlap : float
        Largest overlap at rest, over the mean nominal diameter, beyond which a packing is refused.
    anyway : bool
        Also pack sizes over three decades, which takes long.

    Raises
    ------
    PackingError
        If a value is out of its bounds.
    """

    count: int = 200
    friction: float = 0.5
    wall_friction: float | None = None
    mould: str = "box"
    width: float | None = None
    periodic: bool = False
    seed: int = 0
    spheres: int = 20
    engine: str = "mujoco"
    overlap: float = 0.01
    anyway: bool = False

    def __post_init__(self) -> None:
        if self.count < 2:
            raise PackingError(f"A packing needs at least 2 grains, not {self.count}.")
        if self.mould not in SHAPES:
            raise PackingError(f"There is no mould '{self.mould}': use one of {', '.join(SHAPES)}.")
        if self.engine not in ENGINES:
            raise PackingError(
                f"There is no engine '{self.engine}' for packings: use one of {', '.join(ENGINES)}."
            )
        if self.periodic:
            raise PackingError(
                "MuJoCo has no periodic sides: leave them out. Porosity and coordination are measured in the "
                "inner part, away from the walls."
            )
        for name, value in (("friction", self.friction), ("friction of the walls", self.wall_friction)):
            if value is not None and not 0 <= value <= 2:
                raise PackingError(f"The {name} must be from 0 to 2, not {value:g}.")
        if self.width is not None and not (np.isfinite(self.width) and self.width > 0):
            raise PackingError(f"The width of the mould must be positive, not {self.width:g}.")
        if self.spheres < 2:
            raise PackingError(f"A clump needs at least 2 spheres, not {self.spheres}.")
        if not 0 < self.overlap <= 1:
            raise PackingError(f"The largest overlap must be from 0 to 1 diameters, not {self.overlap:g}.")
