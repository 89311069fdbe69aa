"""Strokes as a person would paint them, drawn from known grains by a seed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int
from scipy import ndimage

from mbstudio.core.grains.classifying import Stroke

RADIUS, LENGTH = 1.0, 8.0  # voxels


def paint_slices(
    truth: Int[np.ndarray, "Z Y X"],
    seed: int,
    *,
    slices: int = 3,
    strokes: int = 10,
    borders: int = 6,
    bright: Bool[np.ndarray, "Z Y X"] | None = None,
) -> list[Stroke]:
    """Return short straight strokes in some slices across z, each wholly within voxels of its kind.

    Parameters
    ----------
    truth : int array, shape (Z, Y, X)
    seed : int
    slices : int
        Evenly spread.
    strokes, borders : int
        Of void and of grain each, and of borders between grains, in each slice.
    bright : bool array, optional
        Grains of a second tone, which are painted as such.
    """
    rng = np.random.default_rng(seed)
    painted: list[Stroke] = []
    for z in np.linspace(0, len(truth) - 1, slices + 2)[1:-1].round().astype(int):
        labels = truth[z]
        second = np.zeros(labels.shape, bool) if bright is None else bright[z]
        border = _borders(truth, int(z))
        masks = {
            "void": labels == 0,
            "grain": (labels > 0) & ~second & ~border,
            "mineral": (labels > 0) & second & ~border,
            "border": border,
        }
        for kind, mask in masks.items():
            wanted = borders if kind == "border" else strokes
            painted += _strokes_within(mask, kind, int(z), wanted, rng)
    return painted


def _borders(truth: Int[np.ndarray, "Z Y X"], z: int) -> Bool[np.ndarray, "Y X"]:
    """Return the voxels of a slice where two grains touch."""
    part = truth[max(0, z - 1) : z + 2]
    highest = ndimage.maximum_filter(part, size=3)
    lowest = ndimage.minimum_filter(np.where(part > 0, part, truth.max() + 1), size=3)
    here = min(z, 1)
    return np.asarray((part[here] > 0) & (highest[here] != lowest[here]))


def _strokes_within(
    mask: Bool[np.ndarray, "Y X"], kind: str, z: int, wanted: int, rng: np.random.Generator
) -> list[Stroke]:
    """Return strokes whose voxels all are of a kind; borders are thin, and painted with a fine brush."""
    radius = 0.5 if kind == "border" else RADIUS
    room = mask if kind == "border" else ndimage.binary_erosion(mask, iterations=1)
    places = np.argwhere(room)
    found: list[Stroke] = []
    for _ in range(50 * wanted):
        if len(found) == wanted or not len(places):
            break
        start = places[rng.integers(len(places))]
        if kind == "border":
            found.append(Stroke(kind, ((z, *start),), radius, 0))
            continue
        turn = rng.uniform(0, 2 * np.pi)
        end = np.rint(start + LENGTH * np.array([np.sin(turn), np.cos(turn)])).astype(int)
        way = np.rint(np.linspace(start, end, 12)).astype(int)
        if (way < 0).any() or (way >= mask.shape).any() or not room[tuple(way.T)].all():
            end = start
        found.append(Stroke(kind, ((z, *start), (z, *end)), radius, 0))
    return found
