"""Labels drawn over a slice in pixels of the screen: filled, outlined with a halo, or some of them alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int, UInt8

HALO = (12, 14, 17)
"""Colour on both sides of an outline, so that it is seen on any grey."""
_HALO_ALPHA = 190
_VIVID = 1.7  # how much further from grey than the grains' colours outlines are


@dataclass(frozen=True)
class LabelLook:
    """How labels are drawn over grey values.

    Attributes
    ----------
    opacity : float
        Of the fill, 0 (none) to 1.
    outlines : bool
    only : frozenset of int, or None
        The labels that are shown; None for all.
    bold : frozenset of int
        Labels whose outlines are twice as wide: the chosen grains.
    """

    opacity: float = 0.0
    outlines: bool = True
    only: frozenset[int] | None = None
    bold: frozenset[int] = frozenset()

    @property
    def draws_nothing(self) -> bool:
        return self.opacity <= 0 and not self.outlines


def members(labels: Int[np.ndarray, "h w"], some: frozenset[int]) -> Bool[np.ndarray, "h w"]:
    """Return where labels are some given ones."""
    found: np.ndarray = np.isin(labels, np.fromiter(some, np.int64, len(some)))
    return found


def label_overlay(
    labels: Int[np.ndarray, "h w"], colours: UInt8[np.ndarray, "k 3"], look: LabelLook, width: int = 1
) -> UInt8[np.ndarray, "h w 4"]:
    """Return a picture (red, green, blue, alpha) to be laid over the grey values.

    Parameters
    ----------
    labels : int array, shape (h, w)
        The label of each pixel of the screen.
    colours : uint8 array, shape (k, 3)
        Of each label.
    look : LabelLook
    width : int
        Pixels that an outline is wide.
    """
    if look.only is not None:
        labels = np.where(members(labels, look.only), labels, 0)
    picture = np.zeros((*labels.shape, 4), np.uint8)
    if look.opacity > 0:
        picture[..., :3] = colours[labels]
        picture[..., 3] = np.where(labels > 0, np.uint8(round(255 * min(look.opacity, 1.0))), 0)
    if not look.outlines:
        return picture
    rim = widened(rim_of(labels), width - 1)
    if look.bold:
        bold = members(labels, look.bold)
        rim |= widened(rim & bold, width)
    line = rim & (labels > 0)
    halo = widened(line, 1) & ~line
    picture[halo] = (*HALO, _HALO_ALPHA)
    picture[line, :3] = vivid(colours)[labels[line]]
    picture[line, 3] = 255
    return picture


def rim_of(labels: Int[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Return the pixels of grains beside which another label lies."""
    rim = np.zeros(labels.shape, dtype=bool)
    across, along = labels[1:] != labels[:-1], labels[:, 1:] != labels[:, :-1]
    rim[1:] |= across
    rim[:-1] |= across
    rim[:, 1:] |= along
    rim[:, :-1] |= along
    rim &= labels > 0
    return rim


def widened(marked: Bool[np.ndarray, "h w"], steps: int) -> Bool[np.ndarray, "h w"]:
    """Return what lies within so many pixels of marked ones."""
    for _ in range(max(0, steps)):
        wider = marked.copy()
        wider[1:] |= marked[:-1]
        wider[:-1] |= marked[1:]
        wider[:, 1:] |= marked[:, :-1]
        wider[:, :-1] |= marked[:, 1:]
        marked = wider
    return marked


def vivid(colours: UInt8[np.ndarray, "k 3"]) -> UInt8[np.ndarray, "k 3"]:
    """Return colours further from grey: the thinner a line is, the stronger its colour must be."""
    values = colours.astype(np.float32)
    grey = values.mean(axis=1, keepdims=True)
    strong: Any = np.clip(grey + 30 + _VIVID * (values - grey), 0, 255).astype(np.uint8)
    return strong  # type: ignore[no-any-return]
