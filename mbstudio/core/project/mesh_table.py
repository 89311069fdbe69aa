"""The exact surfaces of grains in a project file: all vertices and all faces end to end."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import h5py
import numpy as np

from mbstudio.core.grains.grain_mesh import GrainMesh
from mbstudio.core.project.stored import ContentError, Stored

_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
_COLUMNS = (("vertices", "f"), ("faces", "i"))


def write_meshes(group: h5py.Group, meshes: Mapping[int, GrainMesh]) -> None:
    """Write meshes into an empty group, by ascending label."""
    labels = sorted(meshes)
    parts = [meshes[label] for label in labels]
    group["labels"] = np.array(labels, dtype=np.int64)
    for name, arrays, dtype in (
        ("vertices", [part.vertices for part in parts], np.float64),
        ("faces", [part.faces for part in parts], np.int32),
    ):
        group[f"{name}_offsets"] = np.cumsum([0, *map(len, arrays)], dtype=np.int64)
        group.create_dataset(name, data=np.concatenate(arrays).astype(dtype), chunks=True, **_PACKED)


def read_meshes(stored: Stored) -> Mapping[int, GrainMesh]:
    """Return the meshes of a group, by label.

    Raises
    ------
    ContentError
        If they are damaged.
    """
    labels = stored.numbers("labels", "iu").tolist()
    vertices, faces = (_parts(stored, name, kinds, len(labels)) for name, kinds in _COLUMNS)
    found = {}
    for label, points, rows in zip(labels, vertices, faces, strict=True):
        if rows.min() < 0 or rows.max() >= len(points):
            raise ContentError(f"the mesh of grain {label} names vertices that it does not have")
        found[int(label)] = GrainMesh(points, rows)
    return MappingProxyType(found)


def _parts(stored: Stored, name: str, kinds: str, count: int) -> list[np.ndarray]:
    """Return the rows of each mesh."""
    rows, ends = stored.numbers(name, kinds, axes=2), stored.numbers(f"{name}_offsets", "iu", rows=count + 1)
    if rows.shape[1] != 3 or ends[0] != 0 or ends[-1] != len(rows) or not (ends[1:] > ends[:-1]).all():
        raise ContentError(f"the {name} of its meshes do not belong together")
    rows.flags.writeable = False
    return [rows[start:end] for start, end in pairwise(ends.tolist())]
