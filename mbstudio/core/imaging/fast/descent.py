"""The course of a descent: when control points are relocated on the way, and when it ends."""

from __future__ import annotations

import numpy as np

from mbstudio.core.imaging.fast.block_refine import BlockRefinement
from mbstudio.core.imaging.fast.block_relocation import relocate_in_blocks
from mbstudio.core.imaging.fast.refine import Refinement
from mbstudio.core.imaging.fast.relocation import relocate

# How often control points are relocated, the steps between, and the share of them each time; the second where
# there are many: a relocation costs less then than it gains.
_RELOCATIONS_OF_FEW, _RELOCATIONS_OF_MANY, _MANY = (5, 8, 0.1), (7, 6, 0.07), 80
# Blocks take longer to settle after one.
_RELOCATIONS_OF_BLOCKS = (4, 6, 0.07)
_STEPS_AFTER = 10  # the last relocation
_FEWEST_TO_RELOCATE = 10
_NOISE_TO_RELOCATE = 0.6
_WORSE = 1.02  # times the RMS before a relocation: it is then taken back, and was the last
_MOST_STUCK = 2  # steps in a row that find nothing lower
_MOST_IDLE = 2  # checks in a row without progress


class Descent:
    """What is to be done between the steps of one descent.

    Parameters
    ----------
    search : Refinement
    count : int
        Steps at most.
    n, seed : int
        Of the fit: control points asked for, and the seed of relocations.
    rms : float
        Distance at the start, in the grain's unit, like all that are told.
    relocates : bool
        Whether control points may be relocated.
    """

    def __init__(
        self, search: Refinement, count: int, *, n: int, seed: int, rms: float, relocates: bool
    ) -> None:
        prepared = search.prepared
        self._search, self._count = search, count
        self._noise = search.settings.noise * prepared.fineness * prepared.scale
        self._checked, self._idle, self._stuck = rms, 0, 0
        # On few or long voxels relocated points would only follow the steps.
        worth = relocates and n >= _FEWEST_TO_RELOCATE and np.isfinite(prepared.area)
        most, self._every, self._share = _RELOCATIONS_OF_MANY if n >= _MANY else _RELOCATIONS_OF_FEW
        if isinstance(search, BlockRefinement):
            most, self._every, self._share = _RELOCATIONS_OF_BLOCKS
        self._relocations = most if worth else 0
        self._rng = np.random.default_rng([seed, 2])
        self._before = (rms, search.control)

    def relocate_before(self, step: int, rms: float) -> str:
        """Relocate control points before a step (from 1) if it is time; return what was done, in words."""
        if not (self._relocations and step % self._every == 0 and self._count - step >= _STEPS_AFTER):
            return ""
        if rms > _WORSE * self._before[0]:
            self._search.set_control(self._before[1])
            self._relocations = 0
            return ""
        if rms < _NOISE_TO_RELOCATE * self._noise:
            self._relocations = 0
            return ""
        self._before = (rms, self._search.control)
        moved = max(1, round(self._share * self._search.control.shape[1]))
        self._relocations -= 1
        if isinstance(self._search, BlockRefinement):
            moved = relocate_in_blocks(self._search, moved, self._rng)
        else:
            relocate(self._search, moved, self._rng)
        return f"{moved} control points moved to where the surface was worst"

    def is_over(self, step: int, rms: float, *, advanced: bool) -> bool:
        """Return whether the descent ends after a step (from 1), given whether it found something lower."""
        settings = self._search.settings
        self._stuck = 0 if advanced else self._stuck + 1
        if self._stuck >= _MOST_STUCK:
            return True
        if step % settings.check_every:
            return False
        gain = 1 - rms / max(self._checked, 1e-300)
        self._idle = self._idle + 1 if gain < settings.least_gain and not self._relocations else 0
        self._checked = rms
        in_noise = rms < self._noise and gain < settings.least_gain_in_noise
        return self._idle >= _MOST_IDLE or in_noise
