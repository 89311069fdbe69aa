"""A smooth surface around every label of a volume, in one pass: surface nets in numpy.

One vertex stands in each cell of eight voxels that do not all have the same label, one quad
across each pair of neighbours of which one is a grain and the other is not. The vertices are then
drawn towards their neighbours, never further than half a cell, which smooths the stairs of the
voxels (Gibson, 1998, MICCAI, "Constrained elastic surface nets").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, Int64

ROUNDS = 10
STEP = 0.6
REACH = 0.8  # voxels that a vertex may move from the middle of its cell


@dataclass(frozen=True, eq=False)
class LabelNet:
    """Vertices (x, y, z) in voxels, outward triangles, the label of each, and the voxel (z, y, x) before it.

    The voxel is the first of the two that the triangle parts; -1 lies outside.
    """

    points: Float[np.ndarray, "m 3"]
    triangles: Int64[np.ndarray, "t 3"]
    labels: Int32[np.ndarray, " t"]
    homes: Int32[np.ndarray, "t 3"]


def label_net(labels: Int[np.ndarray, "Z Y X"]) -> LabelNet:
    """Return the surface around all labels but 0; voxel [iz, iy, ix] has its centre at (ix, iy, iz)."""
    # A margin of background closes the grains that the box cuts.
    padded = np.pad(np.asarray(labels, dtype=np.int32), 1)
    quads, owners, firsts = zip(*(_quads_across(padded, axis) for axis in range(3)), strict=True)
    corners = np.concatenate(quads)
    owner = np.concatenate(owners)
    used, corners = np.unique(corners, return_inverse=True)
    corners = corners.reshape(-1, 4)
    # Cell [iz, iy, ix] of the padded volume lies between voxels i and i + 1; the margin shifts by one.
    middle = np.column_stack(np.unravel_index(used, padded.shape))[:, ::-1] + 0.5 - 1.0
    points = _smoothed(middle, corners)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    home = np.concatenate(firsts).astype(np.int32) - 1
    return LabelNet(
        points,
        triangles.astype(np.int64),
        np.concatenate([owner, owner]).astype(np.int32),
        np.concatenate([home, home]),
    )


def vertex_normals(
    points: Float[np.ndarray, "m 3"], triangles: Int64[np.ndarray, "t 3"]
) -> Float32[np.ndarray, "m 3"]:
    """Return the unit normal of each vertex: the mean of its triangles', weighted by their area."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    normals = _summed(triangles.ravel(), np.repeat(faces, 3, axis=0), len(points))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.where(lengths > 0, lengths, 1)).astype(np.float32)


def _quads_across(padded: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the corners (flat indices of cells), labels and first voxels of the quads across one axis."""
    first = np.take(padded, range(padded.shape[axis] - 1), axis)
    second = np.take(padded, range(1, padded.shape[axis]), axis)
    where = np.nonzero((first != second) & ((first == 0) | (second == 0)))
    voxel = np.ravel_multi_index(where, padded.shape)
    strides = np.array([padded.shape[1] * padded.shape[2], padded.shape[2], 1])
    # The four cells around the edge from a voxel to its neighbour along `axis`; in this order they
    # turn, seen from the neighbour, one way for z and x, the other for y.
    one, other = (strides[number] for number in ((1, 2), (2, 0), (0, 1))[axis])
    corners = np.column_stack([voxel - one - other, voxel - other, voxel, voxel - one])
    grain_first = first[where] != 0
    outward = np.where(grain_first[:, None], corners[:, ::-1], corners)
    return outward, np.where(grain_first, first[where], second[where]), np.column_stack(where)


def _smoothed(middle: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Draw each vertex towards the mean of its neighbours along the quads' edges."""
    starts = corners.ravel()
    ends = np.roll(corners, -1, axis=1).ravel()
    count = np.bincount(starts, minlength=len(middle)) + np.bincount(ends, minlength=len(middle))
    points = middle.copy()
    for _ in range(ROUNDS):
        total = _summed(starts, points[ends], len(middle)) + _summed(ends, points[starts], len(middle))
        points += STEP * (total / count[:, None] - points)
        np.clip(points, middle - REACH, middle + REACH, out=points)
    return points


def _summed(index: np.ndarray, values: np.ndarray, length: int) -> np.ndarray:
    return np.column_stack([np.bincount(index, values[:, axis], length) for axis in range(3)])
