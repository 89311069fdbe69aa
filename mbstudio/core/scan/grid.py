"""How a file places its voxels in space, so that two files of one object can be laid together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from mbstudio.core.units import conversion_factor


@dataclass(frozen=True, eq=False)
class Grid:
    """The voxels of a file in the space that it names, in the order in which they are stored.

    Attributes
    ----------
    steps : array, shape (3, 3)
        Row i is the step in space from voxel to voxel along the stored axes x, y, z (i = 0, 1, 2).
    origin : array, shape (3,)
        Position of the first stored voxel.
    unit : str or None
        Unit of both; None where the file does not say.
    flipped : tuple of bool
        Along which axes (z, y, x) the voxels were turned round when they were read.
    """

    steps: Float[np.ndarray, "3 3"]
    origin: Float[np.ndarray, "3"]
    unit: str | None = None
    flipped: tuple[bool, bool, bool] = (False, False, False)

    @property
    def is_placeholder(self) -> bool:
        """Whether this is what programs write that know no geometry: steps of one, from zero."""
        return bool(np.array_equal(self.steps, np.eye(3)) and not self.origin.any())

    def turned_half_about_z(self) -> Grid:
        """Return the grid with x and y reversed: from right-anterior to left-posterior axes."""
        half_turn = np.array([-1.0, -1.0, 1.0])
        return replace(self, steps=self.steps * half_turn, origin=self.origin * half_turn)

    def in_unit_of(self, other: Grid) -> Grid:
        """Return the grid in the unit of another; as it is where one of them names none."""
        if self.unit is None or other.unit is None:
            return self
        factor = conversion_factor(self.unit, other.unit)
        return replace(self, steps=self.steps * factor, origin=self.origin * factor, unit=other.unit)

    def region(self, before: Sequence[int], behind: Sequence[int]) -> Grid:
        """Return the grid of a part of the voxels.

        Parameters
        ----------
        before, behind : sequence of int
            Voxels left out at both ends along z, y, x, in the order in which they are handed out.
        """
        stored = [
            last if back else first for first, last, back in zip(before, behind, self.flipped, strict=True)
        ]
        return replace(self, origin=self.origin + np.array(stored[::-1], float) @ self.steps)

    def in_blocks(self, factors: Sequence[int]) -> Grid:
        """Return the grid of the middles of blocks of so many voxels along z, y, x."""
        counts = np.array(factors[::-1], float)
        return replace(
            self, steps=self.steps * counts[:, None], origin=self.origin + (counts - 1) / 2 @ self.steps
        )

    def as_read(self, stored: np.ndarray) -> np.ndarray:
        """Return an array of the stored order in the order in which the file's voxels are handed out."""
        return stored[tuple(slice(None, None, -1 if back else 1) for back in self.flipped)]

    # Turning round is its own inverse.
    as_stored = as_read
