"""Splits, collapses and flips of the edges of a closed triangle mesh, one independent set a pass.

A pass visits the edges in a fixed order and changes one only if nothing near it was changed in the
same pass; so every test sees the mesh as it is, and the result does not depend on anything else.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.compiled import compiled

_FLATTEST_FOLD = 0.3
"""No change turns a triangle's normal by more than the angle of this cosine."""


def edges_of(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "e 2"]]:
    """Return the edges of a closed mesh and the two faces at each.

    The first face has the edge in the order given, the second in the opposite order.
    """
    start = faces.ravel()
    end = np.roll(faces, -1, axis=1).ravel()
    owner = np.repeat(np.arange(len(faces)), 3)
    count = int(faces.max()) + 1
    forward = start < end
    keys = np.where(forward, start * count + end, end * count + start)
    order = np.lexsort((~forward, keys))
    pairs = owner[order].reshape(-1, 2)
    low, high = np.divmod(keys[order][::2], count)
    return np.stack([low, high], axis=1), pairs


def rows_by_vertex(faces: Int[np.ndarray, "f 3"], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each vertex, where its faces stand in a flat list, and that list."""
    of_vertex = faces.ravel()
    order = np.argsort(of_vertex, kind="stable")
    starts = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(np.bincount(of_vertex, minlength=count), out=starts[1:])
    return starts, order // 3


def split_edges(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], longest: float
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    """Halve edges longer than `longest`, the longest first, no face twice."""
    edges, pairs = edges_of(faces)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    long = np.flatnonzero(lengths > longest)
    long = long[np.argsort(-lengths[long], kind="stable")]
    chosen = _independent(pairs[long], len(faces))
    long = long[chosen]
    if not len(long):
        return vertices, faces
    middles = 0.5 * (vertices[edges[long, 0]] + vertices[edges[long, 1]])
    new = len(vertices) + np.arange(len(long))
    faces = faces.copy()
    added = []
    for side in range(2):
        rows = pairs[long, side]
        first, second = edges[long, side], edges[long, 1 - side]
        opposite = faces[rows].sum(axis=1) - first - second
        faces[rows] = np.stack([first, new, opposite], axis=1)
        added.append(np.stack([new, second, opposite], axis=1))
    return np.concatenate([vertices, middles]), np.concatenate([faces, *added])


def collapse_edges(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    shortest: float,
    longest: float,
    only: Bool[np.ndarray, " f"] | None = None,
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    """Collapse edges shorter than `shortest` to their middle, the shortest first.

    An edge is kept where its collapse would change the genus, fold the surface, or make an edge
    longer than `longest`. With `only`, just the edges of the marked faces are looked at.
    """
    edges, pairs = edges_of(faces)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    wanted = lengths < shortest
    if only is not None:
        wanted &= only[pairs].any(axis=1)
    short = np.flatnonzero(wanted)
    short = short[np.argsort(lengths[short], kind="stable")]
    starts, around = rows_by_vertex(faces, len(vertices))
    vertices, faces = vertices.copy(), faces.copy()
    alive = np.ones(len(faces), dtype=np.bool_)
    _collapse(vertices, faces, alive, edges[short], pairs[short], starts, around, longest)
    faces = faces[alive]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    return vertices[used], (np.cumsum(used) - 1)[faces]


def flip_edges(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
    """Flip edges where that raises the smaller of the smallest angles of both triangles."""
    edges, pairs = edges_of(faces)
    keys = edges[:, 0] * len(vertices) + edges[:, 1]
    faces = faces.copy()
    _flip(vertices, faces, edges, pairs, keys)
    return faces


@compiled()
def _independent(pairs: np.ndarray, face_count: int) -> np.ndarray:
    taken = np.zeros(face_count, dtype=np.bool_)
    chosen = np.zeros(len(pairs), dtype=np.bool_)
    for e in range(len(pairs)):
        if not taken[pairs[e, 0]] and not taken[pairs[e, 1]]:
            taken[pairs[e, 0]] = taken[pairs[e, 1]] = True
            chosen[e] = True
    return chosen


@compiled()
def _normal(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    return np.array(
        [
            (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1]),
            (q[2] - p[2]) * (r[0] - p[0]) - (q[0] - p[0]) * (r[2] - p[2]),
            (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]),
        ]
    )


@compiled()
def _turns_too_far(before: np.ndarray, after: np.ndarray) -> bool:
    dot = before[0] * after[0] + before[1] * after[1] + before[2] * after[2]
    lengths = np.sqrt((before**2).sum() * (after**2).sum())
    too_far: bool = dot <= _FLATTEST_FOLD * lengths
    return too_far


@compiled()
def _smallest_angle(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
    smallest = np.pi
    for corner in range(3):
        if corner == 0:
            a, b, c = p, q, r
        elif corner == 1:
            a, b, c = q, r, p
        else:
            a, b, c = r, p, q
        cross = _normal(a, b, c)
        dot = (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1]) + (b[2] - a[2]) * (c[2] - a[2])
        smallest = min(smallest, np.arctan2(np.sqrt((cross**2).sum()), dot))
    return smallest


@compiled()
def _opposite(face: np.ndarray, a: int, b: int) -> int:
    corner: int = face[0] + face[1] + face[2] - a - b
    return corner


@compiled()
def _flip(
    vertices: np.ndarray, faces: np.ndarray, edges: np.ndarray, pairs: np.ndarray, keys: np.ndarray
) -> None:
    locked = np.zeros(len(vertices), dtype=np.bool_)
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if locked[a] or locked[b]:
            continue
        first, second = pairs[e, 0], pairs[e, 1]
        c, d = _opposite(faces[first], a, b), _opposite(faces[second], a, b)
        if locked[c] or locked[d] or c == d:
            continue
        key = min(c, d) * len(vertices) + max(c, d)
        place = np.searchsorted(keys, key)
        if place < len(keys) and keys[place] == key:
            continue
        pa, pb, pc, pd = vertices[a], vertices[b], vertices[c], vertices[d]
        before = min(_smallest_angle(pa, pb, pc), _smallest_angle(pb, pa, pd))
        after = min(_smallest_angle(pa, pd, pc), _smallest_angle(pb, pc, pd))
        if after <= before + 1e-6:
            continue
        mean = _normal(pa, pb, pc) + _normal(pb, pa, pd)
        if _turns_too_far(mean, _normal(pa, pd, pc)) or _turns_too_far(mean, _normal(pb, pc, pd)):
            continue
        faces[first, 0], faces[first, 1], faces[first, 2] = a, d, c
        faces[second, 0], faces[second, 1], faces[second, 2] = b, c, d
        locked[a] = locked[b] = locked[c] = locked[d] = True


@compiled()
def _collapse(
    vertices: np.ndarray,
    faces: np.ndarray,
    alive: np.ndarray,
    edges: np.ndarray,
    pairs: np.ndarray,
    starts: np.ndarray,
    around: np.ndarray,
    longest: float,
) -> None:
    locked = np.zeros(len(vertices), dtype=np.bool_)
    seen = np.full(len(vertices), -1, dtype=np.int64)
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if locked[a] or locked[b]:
            continue
        middle = 0.5 * (vertices[a] + vertices[b])
        if not _may_collapse(
            vertices, faces, a, b, pairs[e], middle, starts, around, longest, locked, seen, e
        ):
            continue
        vertices[a] = middle
        for end in (a, b):
            for i in range(starts[end], starts[end + 1]):
                face = faces[around[i]]
                for corner in range(3):
                    locked[face[corner]] = True
                    if face[corner] == b:
                        face[corner] = a
        alive[pairs[e, 0]] = alive[pairs[e, 1]] = False


@compiled()
def _may_collapse(  # noqa: C901 - one loop over two fans of triangles, compiled
    vertices: np.ndarray,
    faces: np.ndarray,
    a: int,
    b: int,
    pair: np.ndarray,
    middle: np.ndarray,
    starts: np.ndarray,
    around: np.ndarray,
    longest: float,
    locked: np.ndarray,
    seen: np.ndarray,
    mark: int,
) -> bool:
    shared = 0
    for i in range(starts[a], starts[a + 1]):
        face = faces[around[i]]
        for corner in range(3):
            if locked[face[corner]]:
                return False
            seen[face[corner]] = mark
    counted_c = counted_d = -1
    c, d = _opposite(faces[pair[0]], a, b), _opposite(faces[pair[1]], a, b)
    for i in range(starts[b], starts[b + 1]):
        face = faces[around[i]]
        for corner in range(3):
            vertex = face[corner]
            if locked[vertex]:
                return False
            if vertex in (a, b) or seen[vertex] != mark:
                continue
            if vertex == c:
                counted_c = 1
            elif vertex == d:
                counted_d = 1
            else:
                shared += 1
    # Only the two vertices across the edge may neighbour both ends, or a handle would be pinched.
    if shared > 0 or counted_c < 0 or counted_d < 0 or c == d:
        return False
    if starts[c + 1] - starts[c] <= 3 or starts[d + 1] - starts[d] <= 3:
        return False
    for end in (a, b):
        for i in range(starts[end], starts[end + 1]):
            row = around[i]
            if row == pair[0] or row == pair[1]:
                continue
            face = faces[row]
            p, q, r = vertices[face[0]], vertices[face[1]], vertices[face[2]]
            before = _normal(p, q, r)
            if face[0] == end:
                p = middle
            elif face[1] == end:
                q = middle
            else:
                r = middle
            if _turns_too_far(before, _normal(p, q, r)):
                return False
            for corner in range(3):
                if face[corner] != end and ((vertices[face[corner]] - middle) ** 2).sum() > longest**2:
                    return False
    return True
