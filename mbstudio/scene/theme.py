"""Colours of the 3-D scene, light and dark, chosen to stay apart for colour-blind eyes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8


@dataclass(frozen=True)
class SceneTheme:
    """Colours of one scene, as ``#rrggbb``.

    Attributes
    ----------
    top, bottom : str
        Ends of the background's gradient.
    ink : str
        Text, scale bar and the outline of the scan.
    grain, avatar, points : str
        Grain surface (sand), avatar (blue) and control points (reddish purple): Okabe and Ito's
        orange, blue and purple, so that they differ in lightness as well as in hue.
    muted : str
        Grains that are not selected while another one is.
    axes : tuple of str
        Frames of the slices across x, y and z.
    """

    top: str
    bottom: str
    ink: str
    grain: str
    avatar: str
    points: str
    muted: str
    axes: tuple[str, str, str]


LIGHT = SceneTheme(
    top="#fbfcfd",
    bottom="#dfe6ec",
    ink="#33414e",
    grain="#d99b45",
    avatar="#2a7fb8",
    points="#a33b76",
    muted="#c3cad1",
    axes=("#c05a3c", "#2f8f6b", "#2f6db5"),
)
DARK = SceneTheme(
    top="#232b34",
    bottom="#0f1419",
    ink="#c4d0db",
    grain="#e0ad62",
    avatar="#4aa3dd",
    points="#e08bb9",
    muted="#4a545e",
    axes=("#e08a6c", "#5cc29b", "#6ea6e6"),
)

# Mineral tones that differ in lightness as well as in hue, so that neighbours stay apart for
# colour-blind eyes and in grey print.
_LABEL_COLOURS = (
    "#8fb8de", "#c9705c", "#e2c878", "#5c9a7c", "#7d74b8", "#d9a3c6", "#7cc0b8", "#a8a34e",
    "#9c5572", "#5f83bd", "#e5a36c", "#f0e2b0", "#ecbcc0", "#bcdcec", "#4f8f88", "#cfd08a",
    "#b98a5e",
)  # fmt: skip


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue (0 to 255) of ``#rrggbb``."""
    value = int(colour.lstrip("#"), 16)
    return value >> 16, (value >> 8) & 255, value & 255


def label_colours(largest: int) -> UInt8[np.ndarray, "labels 3"]:
    """Return a colour for each label from 0 (background, black) to `largest`."""
    table = np.array([rgb(colour) for colour in _LABEL_COLOURS], dtype=np.uint8)
    labels = np.arange(largest + 1)
    # Multiplying by a number prime to the table's length keeps touching grains, which often
    # have neighbouring labels, apart in colour.
    colours = table[(labels * 7) % len(table)].copy()
    colours[0] = 0
    return colours


_SCORE_COLOURS = ((0.0, "#7fa3bf"), (0.3, "#e6c35c"), (1.0, "#c23b2a"))
"""From a quiet blue over yellow, where suspicion begins, to red."""


def score_colours(scores: Float[np.ndarray, " k"]) -> UInt8[np.ndarray, "k 3"]:
    """Return a colour for each score from 0 to 1."""
    places = [place for place, _ in _SCORE_COLOURS]
    ends = np.array([rgb(colour) for _, colour in _SCORE_COLOURS], dtype=float)
    channels = [np.interp(scores, places, ends[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=1).astype(np.uint8)
