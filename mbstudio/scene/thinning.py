"""Many bodies drawn by fewer triangles: what a processor draws in a fraction of a second.

In each body the vertices within a cell of a grid of its own become one (Rossignac and Borrel, 1993,
"Multi-resolution 3D approximations for rendering complex scenes"). The cells of all bodies are about alike,
but none has fewer than a few across: no body vanishes, however small it is among the others.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Float32, Int32, Int64

from mbstudio.core.compiled import compiled
from mbstudio.scene.surfaces import Surface

FEWEST = 2
"""Cells across a body."""
_FINER = 0.7  # than cells whose faces the triangles would just cover
_LARGER = 1.15  # from one try to the next
_SPREAD = 0x1E3779B97F4A7C15  # the golden ratio's digits scatter keys over the table of cells


def thinned(surface: Surface, most: int) -> Surface:
    """Return labelled bodies drawn by about `most` triangles, or as few as show each of them.

    Parameters
    ----------
    surface : Surface
        With labels. One of `most` triangles or fewer is returned as it is.
    most : int
        Triangles.
    """
    if surface.labels is None or len(surface.triangles) <= most:
        return surface
    bodies, body = np.unique(surface.labels, return_inverse=True)
    numbers = body.astype(np.int32)
    low, high = _extents(surface.points, surface.triangles, numbers, len(bodies))
    size = (high - low).max(axis=1)
    edge = _mean_edge(surface.points, surface.triangles)
    cell = _FINER * edge * math.sqrt(len(surface.triangles) / most)
    while True:
        across = np.maximum(FEWEST, np.rint(size / cell)).astype(np.int64)
        triangles, sums, homes, owners = _clustered(
            surface.points, surface.triangles, surface.normals, numbers, low, high, across
        )
        if len(triangles) <= most or across.max() <= FEWEST:
            break
        cell *= _LARGER
    spreads = _spreads(surface.points, surface.triangles, numbers, len(bodies))
    points, normals = _drawn(sums, homes, spreads)
    return Surface(points, triangles, normals, bodies[owners].astype(np.int32))


def _drawn(
    sums: Float[np.ndarray, "c 7"], homes: Int64[np.ndarray, " c"], spreads: Float[np.ndarray, "k 4"]
) -> tuple[Float32[np.ndarray, "c 3"], Float32[np.ndarray, "c 3"]]:
    """Return vertices and their normals: the means, moved outwards until each body is as large as it was."""
    count = sums[:, 6]
    away = sums[:, :3] / count[:, None] - spreads[homes, :3]
    square = np.bincount(homes, count * (away**2).sum(axis=1), len(spreads))
    left = np.sqrt(square / np.maximum(np.bincount(homes, count, len(spreads)), 1))
    scale = spreads[:, 3] / np.where(left > 0, left, np.inf)
    points = spreads[homes, :3] + scale[homes, None] * away
    lengths = np.linalg.norm(sums[:, 3:6], axis=1, keepdims=True)
    normals = sums[:, 3:6] / np.where(lengths > 0, lengths, 1)
    return points.astype(np.float32), normals.astype(np.float32)


@compiled()
def _extents(
    points: Float32[np.ndarray, "m 3"],
    triangles: Int64[np.ndarray, "t 3"],
    body: Int32[np.ndarray, " t"],
    bodies: int,
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Return the lower and the upper corner of the box around each body."""
    low = np.full((bodies, 3), np.inf)
    high = np.full((bodies, 3), -np.inf)
    for t in range(len(triangles)):
        k = body[t]
        for corner in range(3):
            v = triangles[t, corner]
            for axis in range(3):
                place = points[v, axis]
                low[k, axis] = min(low[k, axis], place)
                high[k, axis] = max(high[k, axis], place)
    return low, high


@compiled()
def _mean_edge(points: Float32[np.ndarray, "m 3"], triangles: Int64[np.ndarray, "t 3"]) -> float:
    """Return the mean length of the triangles' first edges."""
    total = 0.0
    for t in range(len(triangles)):
        a, b = triangles[t, 0], triangles[t, 1]
        square = 0.0
        for axis in range(3):
            square += (points[a, axis] - points[b, axis]) ** 2
        total += math.sqrt(square)
    return total / len(triangles)


@compiled()
def _clustered(
    points: Float32[np.ndarray, "m 3"],
    triangles: Int64[np.ndarray, "t 3"],
    normals: Float32[np.ndarray, "m 3"],
    body: Int32[np.ndarray, " t"],
    low: Float[np.ndarray, "k 3"],
    high: Float[np.ndarray, "k 3"],
    across: Int64[np.ndarray, " k"],
) -> tuple[
    Int64[np.ndarray, "s 3"], Float[np.ndarray, "c 7"], Int64[np.ndarray, " c"], Int32[np.ndarray, " s"]
]:
    """Return what is left once cells are one vertex each.

    That is triangles, of each vertex the sums of places and normals that it stands for and their number, the
    body of each vertex, and the body of each triangle.
    """
    # Cells of one body have numbers of their own.
    first = np.zeros(len(across) + 1, dtype=np.int64)
    for k in range(len(across)):
        first[k + 1] = first[k] + across[k] ** 3
    most = min(first[-1], 3 * len(triangles))
    slots = 1
    while slots < 2 * most:
        slots *= 2
    keys = np.full(slots, -1, dtype=np.int64)
    found = np.zeros(slots, dtype=np.int64)
    sums = np.zeros((most, 7))
    homes = np.zeros(most, dtype=np.int64)
    vertices = 0
    kept = np.empty((len(triangles), 3), dtype=np.int64)
    owners = np.empty(len(triangles), dtype=np.int32)
    count = 0
    corners = np.empty(3, dtype=np.int64)
    for t in range(len(triangles)):
        k = body[t]
        size = max(high[k, 0] - low[k, 0], high[k, 1] - low[k, 1], high[k, 2] - low[k, 2])
        for corner in range(3):
            v = triangles[t, corner]
            key = np.int64(0)
            for axis in range(3):
                extent = high[k, axis] - low[k, axis]
                # The box is parted evenly along each axis, in cells that are about cubes.
                cells = max(1, round(across[k] * extent / size)) if size > 0 else 1
                cell = int(cells * (points[v, axis] - low[k, axis]) / extent) if extent > 0 else 0
                key = key * across[k] + min(max(cell, 0), cells - 1)
            key += first[k]
            slot = (key * _SPREAD >> 20) & (slots - 1)
            while keys[slot] != -1 and keys[slot] != key:
                slot = (slot + 1) & (slots - 1)
            if keys[slot] == -1:
                keys[slot] = key
                found[slot] = vertices
                homes[vertices] = k
                vertices += 1
            number = found[slot]
            for axis in range(3):
                sums[number, axis] += points[v, axis]
                sums[number, 3 + axis] += normals[v, axis]
            sums[number, 6] += 1
            corners[corner] = number
        if corners[0] != corners[1] and corners[1] != corners[2] and corners[2] != corners[0]:
            for corner in range(3):
                kept[count, corner] = corners[corner]
            owners[count] = k
            count += 1
    return kept[:count].copy(), sums[:vertices].copy(), homes[:vertices].copy(), owners[:count].copy()


@compiled()
def _spreads(
    points: Float32[np.ndarray, "m 3"],
    triangles: Int64[np.ndarray, "t 3"],
    body: Int32[np.ndarray, " t"],
    bodies: int,
) -> Float[np.ndarray, "k 4"]:
    """Return the mean place of each body's corners, and how far they lie from it (root mean square)."""
    total, square, count = np.zeros((bodies, 3)), np.zeros(bodies), np.zeros(bodies)
    for t in range(len(triangles)):
        k = body[t]
        for corner in range(3):
            v = triangles[t, corner]
            for axis in range(3):
                total[k, axis] += points[v, axis]
            count[k] += 1
    for k in range(bodies):
        for axis in range(3):
            total[k, axis] /= max(count[k], 1)
    for t in range(len(triangles)):
        k = body[t]
        for corner in range(3):
            v = triangles[t, corner]
            for axis in range(3):
                square[k] += (points[v, axis] - total[k, axis]) ** 2
    found = np.empty((bodies, 4))
    for k in range(bodies):
        found[k, :3] = total[k]
        found[k, 3] = math.sqrt(square[k] / max(count[k], 1))
    return found
