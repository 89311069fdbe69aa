"""Contacts as a label image shows them: where voxels of two grains share a face."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from jaxtyping import Float64, Int64

from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.twin.contacts import COLUMNS

_FACET_FACES = 30
_FEWEST_FOR_PLANE = 6


def _shared_faces(
    labels: np.ndarray,
) -> tuple[Int64[np.ndarray, "m 2"], Float64[np.ndarray, "m 3"], Float64[np.ndarray, "m 3"]]:
    """Return pairs (the lower first), middles (x, y, z in voxels), and normals from the lower on."""
    pairs, places, normals = [], [], []
    for axis in range(3):
        low = np.moveaxis(labels, axis, 0)[:-1]
        high = np.moveaxis(labels, axis, 0)[1:]
        where = np.argwhere((low != high) & (low > 0) & (high > 0))
        one, other = low[tuple(where.T)].astype(np.int64), high[tuple(where.T)].astype(np.int64)
        index = where.astype(float)
        index[:, 0] += 0.5
        order = [*range(1, axis + 1), 0, *range(axis + 1, 3)]
        places.append(index[:, order][:, ::-1])
        pairs.append(np.column_stack((np.minimum(one, other), np.maximum(one, other))))
        normal = np.zeros((len(where), 3))
        normal[:, 2 - axis] = np.where(one < other, 1.0, -1.0)
        normals.append(normal)
    return np.concatenate(pairs), np.concatenate(places), np.concatenate(normals)


def _normal_of(places: np.ndarray, faces: np.ndarray) -> Float64[np.ndarray, "3"]:
    """Return the normal of the plane through faces, on the side of the sum of their own."""
    total = faces.sum(axis=0)
    if len(places) >= _FEWEST_FOR_PLANE:
        away = places - places.mean(axis=0)
        values, vectors = np.linalg.eigh(away.T @ away)
        if values[1] > 1e-9:
            plane: np.ndarray = vectors[:, 0]
            return plane if plane @ total >= 0 else -plane
    length = float(np.linalg.norm(total))
    normal: np.ndarray = total / length if length > 0 else faces[0]
    return normal


def contacts_of_labels(grains: GrainSet) -> pd.DataFrame:
    """Return a row a pair of grains whose voxels share a face.

    Parameters
    ----------
    grains : GrainSet

    Returns
    -------
    pandas.DataFrame
        The columns of :func:`~mbstudio.core.twin.contacts.contact_table`: the contact lies in the middle of
        the shared faces, its normal is that of the plane through them, its area that of the faces as
        the plane sees them. Gap and deviation are not known (NaN), the probability is 1. Labels that meet
        along edges or corners alone are not in contact.
    """
    pairs, places, normals = _shared_faces(grains.labels)
    edges, origin = np.array(grains.voxel_size.xyz), np.array(grains.origin)
    sizes = np.prod(edges) / edges
    table = grains.table.set_index("label")
    middles = {int(label): table.loc[label, ["x", "y", "z"]].to_numpy(float) for label in table.index}
    border = {int(label): bool(cut) for label, cut in table["touches_border"].items()}
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, places, normals = pairs[order], places[order] * edges + origin, normals[order]
    news = np.r_[True, (np.diff(pairs, axis=0) != 0).any(axis=1)][: len(pairs)]
    starts = np.flatnonzero(news).tolist()
    rows = []
    for first, last in pairwise([*starts, len(pairs)]):
        a, b = (int(label) for label in pairs[first])
        some, faces = places[first:last], normals[first:last]
        normal = _normal_of(some, faces)
        area = float(abs((faces * sizes).sum(axis=0) @ normal))
        kind = "facet" if last - first >= _FACET_FACES else "point"
        rows.append(
            (a, b, *some.mean(axis=0), *normal, np.nan, np.nan, 1.0, area, kind, *(middles[b] - middles[a]),
             border[a] or border[b])
        )  # fmt: skip
    return pd.DataFrame(rows, columns=list(COLUMNS))
