"""No body of a twin falls apart or becomes hollow: it is drawn back to where it was whole."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.metaball.topology import topology

_COARSE = 64
_SHARES = (0.7, 0.4, 0.15)


def is_whole(control: Float64[np.ndarray, "4 n"]) -> bool:
    """Return whether a body is one piece without a void."""
    return control.shape[1] == 1 or topology(control, finest=_COARSE).is_sound


def draw_back(
    control: Float64[np.ndarray, "4 n"], whole: Float64[np.ndarray, "4 n"]
) -> tuple[Float64[np.ndarray, "4 n"], float]:
    """Return the body between one that is not whole and one that was, and how much is left of the first."""
    for share in _SHARES:
        between = share * control + (1.0 - share) * whole
        between[3] = np.exp(share * np.log(control[3]) + (1.0 - share) * np.log(whole[3]))
        if is_whole(between):
            return between, share
    return whole.copy(), 0.0
