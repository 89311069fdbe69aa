"""Triangles as a file holds them: corners and faces, before anything is mended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.errors import MeshError

MOST_TRIANGLES = 40_000_000
"""More would take tens of gigabytes before the first number is known."""


@dataclass(frozen=True, eq=False)
class MeshData:
    """What a mesh file holds.

    Attributes
    ----------
    vertices : float array, shape (v, 3)
        Points (x, y, z), as often as the file names them.
    faces : int array, shape (f, 3)
        Rows of `vertices`, all in range.
    parts : int array, shape (f,), optional
        The file's object that each triangle belongs to, where it tells objects apart.
    unit : str, optional
        Length unit of the coordinates, where the format knows it.
    notes : list of str
        What the user should know: phrases that continue "the file ...".
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    parts: Int[np.ndarray, " f"] | None = None
    unit: str | None = None
    notes: list[str] = field(default_factory=list)


def require_few_triangles(count: int, source: str) -> None:
    """Refuse what cannot be held in memory, before memory is taken."""
    if count > MOST_TRIANGLES:
        raise MeshError(
            f"{source} contains {count:,} triangles, more than {MOST_TRIANGLES:,}: reduce them first, "
            "for example in MeshLab with Filters > Remeshing > Quadric Edge Collapse Decimation."
        )


def numbers_from(words: Sequence[bytes], source: str, what: str) -> Float[np.ndarray, " n"]:
    """Return words of a text file as numbers; MeshError names the first that is none."""
    try:
        return np.array(words, dtype=np.bytes_).astype(np.float64) if len(words) else np.zeros(0)
    except ValueError:
        for word in words:
            try:
                float(word)
            except ValueError:
                shown = word[:30].decode("latin-1")
                hint = " (decimal points are needed, not commas)" if b"," in word else ""
                raise MeshError(
                    f"{source} has '{shown}' where {what} should be a number{hint}: export it again."
                ) from None
        raise


def triangulate(
    vertices: Float[np.ndarray, "v 3"],
    sizes: Int[np.ndarray, " p"],
    corners: Int[np.ndarray, " c"],
    source: str,
) -> tuple[Int[np.ndarray, "f 3"], Int[np.ndarray, " f"]]:
    """Split polygons into triangles.

    Parameters
    ----------
    sizes : int array, shape (p,)
        Corners of each polygon; those of fewer than three are dropped.
    corners : int array, shape (sum of sizes,)
        Rows of `vertices`, polygon by polygon.

    Returns
    -------
    faces : int array, shape (f, 3)
        In the order of their polygons.
    polygon : int array, shape (f,)
        Which polygon each triangle is of.

    Raises
    ------
    MeshError
        If a corner is not among the vertices, or there are too many triangles.
    """
    sizes = np.asarray(sizes, dtype=np.int64)
    corners = np.asarray(corners, dtype=np.int64)
    require_few_triangles(int(np.maximum(sizes - 2, 0).sum()), source)
    require_known_corners(corners, len(vertices), source)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]) if len(sizes) else np.zeros(0, np.int64)
    found, polygon = [], []
    threes, fours = np.flatnonzero(sizes == 3), np.flatnonzero(sizes == 4)
    found.append(corners[starts[threes, None] + np.arange(3)])
    polygon.append(threes)
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused later
        halves = _halve_quads(vertices, corners[starts[fours, None] + np.arange(4)])
        found.append(halves)
        polygon.append(np.repeat(fours, 2))
        for which in np.flatnonzero(sizes > 4):
            ring = corners[starts[which] : starts[which] + sizes[which]]
            parts = _clip_ears(vertices[ring])
            found.append(ring[parts])
            polygon.append(np.full(len(parts), which))
    faces, of = np.concatenate(found).reshape(-1, 3), np.concatenate(polygon)
    order = np.argsort(of, kind="stable")
    return faces[order], of[order]


def require_known_corners(corners: Int[np.ndarray, "..."], count: int, source: str) -> None:
    """Refuse faces whose corners are not among the vertices."""
    if corners.size and (int(corners.min()) < 0 or int(corners.max()) >= count):
        wrong = int(corners.max()) if int(corners.max()) >= count else int(corners.min())
        raise MeshError(
            f"{source} is damaged: a face names vertex {wrong}, but there are only {count} vertices "
            "(from 0): export it again."
        )


def _halve_quads(vertices: Float[np.ndarray, "v 3"], quads: Int[np.ndarray, "q 4"]) -> Int[np.ndarray, "t 3"]:
    """Split each quad along the diagonal that lies inside it."""
    a, b, c, d = (vertices[quads[:, corner]] for corner in range(4))
    folded = np.einsum("ij,ij->i", np.cross(b - a, c - a), np.cross(c - a, d - a)) < 0
    first = np.where(folded[:, None], quads[:, [0, 1, 3]], quads[:, [0, 1, 2]])
    second = np.where(folded[:, None], quads[:, [1, 2, 3]], quads[:, [0, 2, 3]])
    return np.stack([first, second], axis=1).reshape(-1, 3)


def _clip_ears(ring: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "t 3"]:
    """Split one polygon: a fan where it is convex, ear by ear where it is not."""
    count = len(ring)
    fan = np.array([[0, i, i + 1] for i in range(1, count - 1)])
    steps = np.roll(ring, -1, axis=0) - ring
    centred = ring - ring.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    turns = np.cross(np.roll(steps, 1, axis=0), steps) @ normal
    if not np.isfinite(turns).all() or (turns >= 0).all():
        return fan
    flat = np.argsort(np.abs(normal))[:2]  # seen along the axis that it faces most
    x, y = ring[:, flat[0]], ring[:, flat[1]]
    area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    left, found = list(range(count)), []
    while len(left) > 3:
        for place in range(len(left)):
            before, here, after = left[place - 1], left[place], left[(place + 1) % len(left)]
            if _is_ear(x, y, before, here, after, left, area):
                found.append([before, here, after])
                del left[place]
                break
        else:
            return fan  # crosses itself: any split is as good
    return np.array([*found, left])


def _is_ear(x: np.ndarray, y: np.ndarray, a: int, b: int, c: int, left: list[int], area: float) -> bool:
    def side(i: int, j: int, k: int) -> float:
        return float(((x[j] - x[i]) * (y[k] - y[i]) - (y[j] - y[i]) * (x[k] - x[i])) * area)

    if side(a, b, c) <= 0:
        return False
    return not any(
        side(a, b, k) >= 0 and side(b, c, k) >= 0 and side(c, a, k) >= 0 for k in left if k not in (a, b, c)
    )
