"""Taking away the small volume error that a search leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.fast.refine import Refinement
from mbstudio.core.metaball.field import solid_bounds
from mbstudio.core.metaball.surface import volume_and_area_of_thin

MATCHED = "all weights scaled slightly to match the volume of the voxels"
# More would only hide a wrong shape; but in thin bodies that much is soon a small displacement.
_MOST_MATCHED, _MOST_MATCHED_OF_THIN = 0.03, 0.08
# Volume error of which one factor leaves so little that it is not measured again.
_MATCHED_AT_ONCE = 0.002


@dataclass
class VolumeScaling:
    """Scales all k of control points until their solid has a volume, by the secant of ln V over ln k.

    Attributes
    ----------
    volume : float
        The one wanted, in cubed lengths of the control points.
    power : float
        V goes with k to this power: 3/2 for a sphere, some 4 for a sheet of many control points.
    adapts : bool
        Whether the power is taken from the step before, once there is one.
    """

    volume: float
    power: float = 1.5
    adapts: bool = True
    _moved: float = 0.0
    _before: float = 0.0

    def excess(self, control: Float64[np.ndarray, "4 n"]) -> float:
        """Return ln of the solid's volume over the wanted one."""
        now, _ = volume_and_area_of_thin(control, 64, solid_bounds(control, rounds=1))
        return float(np.log(now / self.volume))

    def scale(self, control: Float64[np.ndarray, "4 n"], excess: float) -> None:
        """Take an excess away, in place."""
        if self.adapts and abs(self._moved) > 1e-9:
            self.power = float(np.clip((excess - self._before) / self._moved, 1.0, 8.0))
        self._moved, self._before = -excess / self.power, excess
        control[3] *= np.exp(self._moved)


def match_volume(search: Refinement) -> bool:
    """Scale all weights by one factor so that the avatar has the volume of the voxels.

    Returns
    -------
    bool
        False where the error is too large to be scaled away; the search is then as it was.
    """
    prepared, control = search.prepared, search.control.copy()
    thin = prepared.slenderness > 1
    most = max(_MOST_MATCHED, min(_MOST_MATCHED_OF_THIN, 0.4 * prepared.voxel / prepared.thickness))
    scaling = VolumeScaling(prepared.volume, 4.0 if thin else 1.5, adapts=thin)
    for _ in range(5 if thin else 2):
        excess = scaling.excess(control)
        if abs(excess) > most:
            return False
        scaling.scale(control, excess)
        if abs(excess) < _MATCHED_AT_ONCE:
            break
    search.control = control
    return True
