"""Grains of a packing as one surface that can be posed anew many times a second; plain arrays, no VTK."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32, Int64, UInt8

from mbstudio.core.packing.grain_kinds import GrainKinds
from mbstudio.core.packing.mould import Mould
from mbstudio.core.packing.packing import Packing
from mbstudio.core.packing.poses import Poses
from mbstudio.scene.surfaces import Surface, avatar_surface
from mbstudio.scene.theme import rgb

MOST_CELLS, LEAST_CELLS = 24, 6
_TRIANGLES_A_CELL = 4.0  # of a shell that crosses so many cells squared
COLOURED_BY = ("size", "coordination", "force", "overlap")
# Viridis (van der Walt & Smith 2015): lightness rises evenly, also for colour-blind eyes and in grey print.
_RAMP = (
    "#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b",
    "#fde725",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PackedForms:
    """Surfaces of the kinds of a packing, each grain's lying after the other's, in its own frame.

    Attributes
    ----------
    kinds : GrainKinds
        What they were made of.
    order : int array, shape (count,)
        Grains in the order in which they lie: those of one kind together.
    points, normals : float32 arrays, shape (m, 3)
        Of all grains in their own frames, at the size of the avatars.
    triangles : int64 array, shape (t, 3)
    grains : int32 array, shape (t,)
        Whose each triangle is.
    blocks : tuple of (int, int, int)
        Of each kind that is there: its number, its grains, the vertices of one.
    """

    kinds: GrainKinds
    order: Int64[np.ndarray, " count"]
    points: Float32[np.ndarray, "m 3"]
    normals: Float32[np.ndarray, "m 3"]
    triangles: Int64[np.ndarray, "t 3"]
    grains: Int32[np.ndarray, " t"]
    blocks: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, eq=False)
class PackedGrains:
    """Grains where they lie, to be looked at.

    Attributes
    ----------
    forms : PackedForms
        The same object as long as only the poses change.
    surface : Surface
        Its labels are the numbers of the grains.
    mould : Mould
    top : float
        Height up to which the mould is drawn.
    values : float array, shape (count,)
        Of each grain, 0 to 1, for its colour; NaN where it has none.
    """

    forms: PackedForms
    surface: Surface
    mould: Mould
    top: float
    values: Float[np.ndarray, " count"]


def make_forms(kinds: GrainKinds, numbers: Int64[np.ndarray, " count"], triangles: int) -> PackedForms:
    """Return the surfaces of grains by the numbers of their kinds; may run in a worker thread.

    Parameters
    ----------
    kinds : GrainKinds
    numbers : int array, shape (count,)
    triangles : int
        About how many all grains may have together.
    """
    cells = math.sqrt(triangles / max(len(numbers), 1) / _TRIANGLES_A_CELL)
    fine = int(np.clip(round(cells), LEAST_CELLS, MOST_CELLS))
    order = np.argsort(numbers, kind="stable")
    points, normals, faces, owners = [], [], [], []
    blocks, start = [], 0
    for kind in np.unique(numbers).tolist():
        form = avatar_surface(kinds.avatars[kind], fine)
        mine = order[numbers[order] == kind]
        size = len(form.points)
        shifts = start + size * np.arange(len(mine))
        points.append(np.tile(form.points, (len(mine), 1)))
        normals.append(np.tile(form.normals, (len(mine), 1)))
        faces.append((form.triangles[None] + shifts[:, None, None]).reshape(-1, 3))
        owners.append(np.repeat(mine, len(form.triangles)))
        blocks.append((kind, len(mine), size))
        start += size * len(mine)
    return PackedForms(
        kinds,
        order,
        np.concatenate(points),
        np.concatenate(normals),
        np.concatenate(faces),
        np.concatenate(owners).astype(np.int32),
        tuple(blocks),
    )


def posed(
    forms: PackedForms,
    poses: Poses,
    mould: Mould,
    values: Float[np.ndarray, " count"],
    top: float | None = None,
) -> PackedGrains:
    """Return grains where they lie; may run in a worker thread.

    Parameters
    ----------
    forms : PackedForms
    poses : Poses
    mould : Mould
    values : float array, shape (count,)
    top : float, optional
        Height of the mould that is drawn; by default that of its width.
    """
    turns = poses.rotations[forms.order].astype(np.float32)
    scales = poses.scales[forms.order].astype(np.float32)
    places = poses.positions[forms.order].astype(np.float32)
    points, normals = np.empty_like(forms.points), np.empty_like(forms.normals)
    vertex, first = 0, 0
    for _, count, size in forms.blocks:
        rows, grains = slice(vertex, vertex + count * size), slice(first, first + count)
        back = np.swapaxes(turns[grains], 1, 2)
        local = forms.points[vertex : vertex + size]
        moved = (local[None] * scales[grains, None, None]) @ back + places[grains, None, :]
        points[rows] = moved.reshape(-1, 3)
        normals[rows] = (forms.normals[vertex : vertex + size][None] @ back).reshape(-1, 3)
        vertex, first = vertex + count * size, first + count
    surface = Surface(points, forms.triangles, normals, forms.grains)
    return PackedGrains(forms, surface, mould, 2 * mould.half if top is None else top, values)


def sizes_of(kinds: GrainKinds, poses: Poses) -> Float[np.ndarray, " count"]:
    """Return the nominal diameters of grains."""
    diameters: np.ndarray = kinds.diameters[poses.kinds] * poses.scales
    return diameters


def grain_values(packing: Packing, by: str) -> Float[np.ndarray, " count"]:
    """Return a number of each grain: nominal diameter, neighbours, largest force or largest overlap.

    Parameters
    ----------
    packing : Packing
    by : str
        One of `COLOURED_BY`. Forces are over the mean weight of a grain, overlaps over the mean diameter.

    Returns
    -------
    float array, shape (count,)
        NaN for forces that nobody has told.
    """
    contacts, count = packing.found_contacts, len(packing)
    if by == "size":
        return packing.diameters
    if by == "coordination":
        return contacts.neighbours(count).astype(float)
    told = contacts.forces if by == "force" else contacts.overlaps / packing.mean_diameter
    if len(told) and not np.isfinite(told).all():
        return np.full(count, np.nan)
    largest = np.zeros(count)
    for column in range(2):
        mine = contacts.pairs[:, column] >= 0
        np.maximum.at(largest, contacts.pairs[mine, column], told[mine])
    return largest


def shares_of(values: Float[np.ndarray, " count"]) -> tuple[Float[np.ndarray, " count"], float, float]:
    """Return values as shares from the least to the largest, and these two; one half where all are alike."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.full(len(values), np.nan), float("nan"), float("nan")
    low, high = float(known.min()), float(known.max())
    if high - low <= 1e-9 * max(abs(high), 1e-300):
        return np.where(np.isfinite(values), 0.5, np.nan), low, high
    return (values - low) / (high - low), low, high


def ramp_colours(shares: Float[np.ndarray, " count"], unknown: str) -> UInt8[np.ndarray, "count 3"]:
    """Return the colour of each share from 0 to 1, and one for those that are NaN."""
    anchors = np.array([rgb(colour) for colour in _RAMP], dtype=float)
    places = np.linspace(0, 1, len(anchors))
    told = np.nan_to_num(np.clip(shares, 0, 1))
    colours = np.column_stack([np.interp(told, places, anchors[:, channel]) for channel in range(3)])
    colours[~np.isfinite(shares)] = rgb(unknown)
    return np.round(colours).astype(np.uint8)


def ramp_anchors() -> Sequence[str]:
    """Return the colours of the ramp, from the least to the largest."""
    return _RAMP


def mould_lines(mould: Mould, top: float) -> tuple[Float[np.ndarray, "m 3"], Int64[np.ndarray, "lines 2"]]:
    """Return points and pairs of them: the edges of a mould up to a height."""
    count = 4 if mould.shape == "box" else 48
    angles = np.pi / 4 + 2 * np.pi * np.arange(count) / count
    radius = mould.half * (np.sqrt(2) if mould.shape == "box" else 1.0)
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    points = np.concatenate([np.column_stack([ring, np.full(count, height)]) for height in (0.0, top)])
    round_it = np.column_stack([np.arange(count), (np.arange(count) + 1) % count])
    uprights = np.arange(0, count, count // 4)
    lines = np.concatenate([round_it, round_it + count, np.column_stack([uprights, uprights + count])])
    return points, lines.astype(np.int64)
