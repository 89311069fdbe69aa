"""How a project file keeps grains: label volume, table, verdict, corrections by hand."""

from __future__ import annotations

import json
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from mbstudio.core.errors import EditError, SegmentationError
from mbstudio.core.project.mesh_table import read_meshes, write_meshes
from mbstudio.core.project.stored import ContentError, Stored, json_entries
from mbstudio.core.scan.field_of_view import FieldOfView
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.grains.editing import Edit
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.grains.verdict import SegmentationVerdict

# Shuffled level 1 packs label volumes about as small as level 9 and several times faster; the
# checksum tells of damage that the file's structure does not show.
PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}


def write_place(
    group: h5py.Group | h5py.Dataset, size: VoxelSize, origin: tuple[float, float, float]
) -> None:
    """Write voxel size and origin as attributes."""
    group.attrs.update(voxel_size_zyx=size.zyx, unit=size.unit, origin_xyz=tuple(map(float, origin)))


def read_place(stored: Stored, of: str = "") -> tuple[VoxelSize, tuple[float, float, float]]:
    """Read voxel size and origin."""
    z, y, x = stored.tuple_of("voxel_size_zyx", float, 3, of=of)
    at_x, at_y, at_z = stored.tuple_of("origin_xyz", float, 3, of=of)
    return VoxelSize(z, y, x, stored.attribute("unit", str, of=of)), (at_x, at_y, at_z)


def is_edited(grains: GrainSet) -> bool:
    """Return whether grains hold what versions before the corrections by hand would lose."""
    highest = int(grains.table["label"].max()) if len(grains) else 0
    return bool(grains.edits) or "excluded" in grains.table or grains.last_label > highest


def write_grains(group: h5py.Group, grains: GrainSet) -> None:
    """Write grains into an empty group."""
    labels = group.create_dataset("labels", data=np.asarray(grains.labels), chunks=True, **PACKED)
    write_place(labels, grains.voxel_size, grains.origin)
    if grains.verdict is not None:
        group.attrs["verdict"] = json.dumps(grains.verdict.to_record())
    group.attrs["last_label"] = grains.last_label
    if grains.view is not None:
        view = group.create_dataset("view", data=np.asarray(grains.view.footprint), chunks=True, **PACKED)
        view.attrs.update(axis=grains.view.axis, is_marked=grains.view.is_marked)
    if grains.edits:
        texts = [json.dumps(edit.to_record()) for edit in grains.edits]
        group.create_dataset("edits", data=texts, dtype=h5py.string_dtype("utf-8"))
    table = group.create_group("table")
    table.attrs["columns"] = list(map(str, grains.table.columns))
    for name, column in grains.table.items():
        if column.dtype.kind in "biuf":
            table[str(name)] = column.to_numpy()
        else:
            table.create_dataset(
                str(name), data=column.astype(str).tolist(), dtype=h5py.string_dtype("utf-8")
            )
    if grains.meshes:
        write_meshes(group.create_group("meshes"), grains.meshes)


def read_grains(stored: Stored) -> GrainSet:
    """Read grains.

    Raises
    ------
    ContentError
        If something is missing, or holds what no grains can have.
    """
    from mbstudio.core.grains.editing.label_volume import LabelVolume
    from mbstudio.core.grains.grain_set import GrainSet

    size, origin = read_place(stored, "labels")
    labels = stored.numbers("labels", "iu", axes=3)
    if not labels.size or labels.min() < 0:
        raise ContentError("grains/labels holds no voxels, or labels below 0")
    table = _read_table(stored.group("table"))
    _check_table(table, labels.shape)
    meshes = read_meshes(stored.group("meshes")) if "meshes" in stored else MappingProxyType({})
    if not set(meshes) <= set(table["label"].tolist()):
        raise ContentError("grains/meshes holds meshes of grains that there are not")
    last_label = stored.attribute("last_label", int, 0)
    if not 0 <= last_label < 2**62:
        raise ContentError("the highest number of a grain cannot be")
    return GrainSet(
        LabelVolume(labels),
        table,
        size,
        origin,
        meshes,
        _read_verdict(stored),
        _read_view(stored, labels.shape),
        _read_edits(stored, labels.shape),
        last_label,
    )


def _read_view(stored: Stored, shape: tuple[int, ...]) -> FieldOfView | None:
    """Return the field of view; None in files of older versions."""
    if "view" not in stored:
        return None
    axis, is_marked = stored.attribute("axis", int, of="view"), stored.attribute("is_marked", bool, of="view")
    footprint = stored.numbers("view", "b", axes=2)
    across = tuple(count for other, count in enumerate(shape) if other != axis)
    if axis not in (0, 1, 2) or footprint.shape != across or not footprint.any():
        raise ContentError("grains/view is no cross-section of the scan")
    nz, ny, nx = shape
    return FieldOfView(axis, footprint, (nz, ny, nx), is_marked)


def _read_edits(stored: Stored, shape: tuple[int, ...]) -> tuple[Edit, ...]:
    """Return the corrections by hand."""
    from mbstudio.core.grains.editing import read_edit

    if "edits" not in stored:
        return ()
    try:
        return tuple(read_edit(json_entries(text, "grains/edits"), shape) for text in stored.texts("edits"))
    except EditError as error:
        raise ContentError(str(error)) from None


def _read_verdict(stored: Stored) -> SegmentationVerdict | None:
    """Return the verdict on the grains; None in files of versions that judged otherwise or not at all."""
    from mbstudio.core.grains.verdict import SegmentationVerdict

    if "verdict" not in stored.attributes():
        return None
    record = json_entries(stored.attribute("verdict", str), "attribute verdict of grains")
    if not SegmentationVerdict.is_readable(record):
        return None
    try:
        return SegmentationVerdict.from_record(record)
    except SegmentationError as error:
        raise ContentError(str(error)) from None


def _read_table(stored: Stored) -> pd.DataFrame:
    import pandas as pd  # imported late: it takes a third of a second

    names = stored.attributes().get("columns")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ContentError("the columns of grains/table are not named")
    columns: dict[str, Any] = {}
    rows: int | None = None
    for name in names:
        if stored.array(name).dtype == object:
            columns[name] = stored.texts(name, rows)
        else:
            columns[name] = stored.numbers(name, "biuf", rows=rows, finite=False)
        rows = len(columns[name])
    return pd.DataFrame(columns)


def _check_table(table: pd.DataFrame, shape: tuple[int, ...]) -> None:
    """Refuse a table of grains whose labels, boxes or volumes cannot be."""
    if "label" not in table or table["label"].dtype.kind not in "iu":
        raise ContentError("grains/table has no labels")
    labels = table["label"].to_numpy()
    if len(np.unique(labels)) < len(labels) or (len(labels) and labels.min() < 1):
        raise ContentError("grains/table has a label twice, or one below 1")
    for axis, length in zip("zyx", shape, strict=True):
        if f"{axis}0" in table and f"{axis}1" in table:
            low, high = table[f"{axis}0"].to_numpy(), table[f"{axis}1"].to_numpy()
            if not ((low >= 0) & (low < high) & (high <= length)).all():
                raise ContentError(f"grains/table has boxes that are not inside the scan along {axis}")
    for name in ("touches_border", "excluded", "accepted"):
        if name in table and table[name].dtype.kind != "b":
            raise ContentError(f"grains/table has {name} that are no truth values")
    for name in ("voxels", "volume"):
        if name in table and not (np.isfinite(table[name]) & (table[name] > 0)).all():
            raise ContentError(f"grains/table has {name} that are no positive numbers")
