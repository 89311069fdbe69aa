"""Taking away the small volume error that a search leaves."""

from __future__ import annotations

import numpy as np

from mbstudio.core.imaging.fast.refine import Refinement
from mbstudio.core.metaball.field import solid_bounds
from mbstudio.core.metaball.surface import volume_and_area_of_thin

MATCHED = "all weights scaled a little to match the volume of the voxels"
# More would only hide a wrong shape; but in thin bodies that much is soon a small displacement.
_MOST_MATCHED, _MOST_MATCHED_OF_THIN = 0.03, 0.08
# Volume error of which one factor leaves so little that it is not measured again.
_MATCHED_AT_ONCE = 0.002


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
    # Of a sphere, V goes with k**(3/2); of a sheet of many control points with some k**4.
    power, moved, before = (4.0, 0.0, 0.0) if thin else (1.5, 0.0, 0.0)
    for done in range(5 if thin else 2):
        volume, _ = volume_and_area_of_thin(control, 64, solid_bounds(control, rounds=1))
        excess = float(np.log(volume / prepared.volume))
        if abs(excess) > most:
            return False
        if thin and done and abs(moved) > 1e-9:
            power = float(np.clip((excess - before) / moved, 1.0, 8.0))
        moved, before = -excess / power, excess
        control[3] *= np.exp(moved)
        if abs(excess) < _MATCHED_AT_ONCE:
            break
    search.control = control
    return True
