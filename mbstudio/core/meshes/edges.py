"""Edges of triangle soups: which triangles meet in them, and what they say about holes and winding."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Faces = Int[np.ndarray, "f 3"]
Points = Float[np.ndarray, "v 3"]


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """All edges of some faces.

    Attributes
    ----------
    ends : int array, shape (e, 2)
        Vertices of each edge, the lower number first.
    uses : int array, shape (e,)
        How many triangles meet in it.
    balance : int array, shape (e,)
        How often it is run through upwards less how often downwards: 0 where the winding agrees.
    of_side : int array, shape (3 f,)
        The edge of each side of each face, face by face.
    upward : bool array, shape (3 f,)
        Whether the face runs through it from the lower vertex to the higher.
    """

    ends: Int[np.ndarray, "e 2"]
    uses: Int[np.ndarray, " e"]
    balance: Int[np.ndarray, " e"]
    of_side: Int[np.ndarray, " s"]
    upward: Bool[np.ndarray, " s"]

    @classmethod
    def from_faces(cls, faces: Faces) -> EdgeTable:
        """Return the edges of faces."""
        sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        low, high = sides.min(axis=1), sides.max(axis=1)
        count = int(faces.max(initial=0)) + 1
        keys, of_side, uses = np.unique(low * count + high, return_inverse=True, return_counts=True)
        upward = sides[:, 0] == low
        balance = np.bincount(of_side, weights=np.where(upward, 1, -1), minlength=len(keys)).astype(np.int64)
        return cls(np.stack(np.divmod(keys, count), axis=1), uses, balance, of_side.ravel(), upward)

    @cached_property
    def is_closed(self) -> bool:
        """Whether no edge bounds a hole."""
        return bool((self.uses % 2 == 0).all())

    @cached_property
    def is_consistent(self) -> bool:
        """Whether neighbouring triangles agree on what is outside."""
        return bool((self.balance == 0).all())

    @property
    def open_edges(self) -> Int[np.ndarray, "o 2"]:
        """Edges in which an odd number of triangles meet."""
        found: np.ndarray = self.ends[self.uses % 2 == 1]
        return found

    def pairs(self) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"], Bool[np.ndarray, " p"]]:
        """Return the two faces at each edge that two triangles share, and whether their windings agree."""
        order = np.argsort(self.of_side, kind="stable")
        first = np.concatenate([[0], np.cumsum(self.uses)[:-1]])[self.uses == 2]
        one, other = order[first], order[first + 1]
        return one // 3, other // 3, self.upward[one] != self.upward[other]


def weld_equal(points: Points, faces: Faces) -> tuple[Points, Faces]:
    """Give corners at equal places one number, and drop vertices that no face uses.

    Vertices are numbered by their coordinates, so that the result does not depend on how the file numbers
    them; the order of faces and of their corners stays.
    """
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    points = points[used] + 0.0  # -0.0 and 0.0 are one place
    order = np.lexsort(points.T)
    ordered = points[order]
    new = (
        np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
        if len(points)
        else np.zeros(0, bool)
    )
    number = np.empty(len(points), np.int64)
    number[order] = np.cumsum(new) - 1
    return ordered[new], number[faces]


def with_three_corners(faces: Faces) -> Bool[np.ndarray, " f"]:
    """Return which faces have three different corners."""
    a, b, c = faces.T
    kept: np.ndarray = (a != b) & (b != c) & (c != a)
    return kept


def pieces_of(faces: Faces, vertex_count: int) -> Int[np.ndarray, " f"]:
    """Return the number of the piece that each face belongs to, joined by common vertices."""
    rows, columns = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]]).T
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(vertex_count, vertex_count))
    _, of_vertex = connected_components(graph, directed=False)
    _, of_face = np.unique(of_vertex[faces[:, 0]], return_inverse=True)
    return _by_first_face(of_face)


def _by_first_face(numbers: Int[np.ndarray, " f"]) -> Int[np.ndarray, " f"]:
    """Number the pieces in the order of their first faces."""
    _, first, inverse = np.unique(numbers, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    found: np.ndarray = rank[inverse.ravel()]
    return found


def sheets_of(faces: Faces, edges: EdgeTable) -> tuple[Int[np.ndarray, " f"], Bool[np.ndarray, " f"]] | None:
    """Return the sheet of each face, and which faces to turn so that each sheet has one winding.

    A sheet is joined by edges that two triangles share. None if a sheet is one-sided, as a Moebius strip is.

    Notes
    -----
    Each face stands for two nodes, as it is and turned; edges join what agrees. A sheet then falls into two
    mirrored halves, or, if it is one-sided, into one.
    """
    count = len(faces)
    one, other, agree = edges.pairs()
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([np.where(agree, other, other + count), np.where(agree, other + count, other)])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    _, half = connected_components(graph, directed=False)
    kept, turned = half[:count], half[count:]
    if (kept == turned).any():
        return None
    sheet = _by_first_face(np.minimum(kept, turned))
    return sheet, kept > turned


def signed_volume(points: Points, faces: Faces) -> float:
    """Return the volume that faces enclose, negative if they are wound inwards."""
    centred = points - points[faces.ravel()].mean(axis=0)
    a, b, c = (centred[faces[:, corner]] for corner in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)
