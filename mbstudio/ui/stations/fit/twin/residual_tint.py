"""The residual of a twin as colours over the slices."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8

from mbstudio.scene.layers.colour_scale import diverging_colours

REACH = 0.25
"""Contrasts at which the colour is full."""
_LEAST = 0.2  # of that: below it there is no colour
_OPAQUE = 215


def residual_tint(residual: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 4"]:
    """Return a picture to lay over a slice: red where the scan is brighter than its model, blue where darker.

    Parameters
    ----------
    residual : float32 array, shape (h, w)
        Scan less model in contrasts.
    """
    share = np.clip(residual / np.float32(REACH), -1.0, 1.0)
    colours = diverging_colours(255)
    picture = np.empty((*residual.shape, 4), np.uint8)
    # The middle of the scale is light grey; strong colours alone are laid over grey values.
    strong = np.sign(share) * (0.55 + 0.35 * np.abs(share))
    picture[..., :3] = colours[np.round(127 * (1.0 + strong)).astype(np.intp)]
    alpha = np.clip((np.abs(share) - _LEAST) / (1.0 - _LEAST), 0.0, 1.0)
    picture[..., 3] = np.round(_OPAQUE * np.sqrt(alpha)).astype(np.uint8)
    return picture
