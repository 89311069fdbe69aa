"""The project file ``*.mbs``: an HDF5 file that holds a :class:`ProjectState`.

The first 512 bytes are a header with the file's seal: see mbstudio.core.sealing. Any HDF5 program steps over
it. Layout (schema 4); every text is UTF-8, nothing is pickled::

    /                attributes: format, schema, written_by
    /scan            attributes: where the scan lies and its digest, which part of the file it is, in how
                     large blocks; voxels, if embedded
    /segmentation    attributes: the settings, None as an empty attribute
    /grains/labels   label volume, compressed; attributes: voxel size, unit, origin
    /grains/table    one dataset a column; attribute: order of the columns
    /fit_settings    attributes
    /fits            see mbstudio.core.project.fit_table
    /style, /clones  see mbstudio.core.project.style_table; only where there are some
    /kept            see mbstudio.core.project.kept_table; only where there are some

Schema 1 has neither style nor clones, schema 2 no kept grains, schema 3 no parts of scans: a project is
written in the lowest that holds it.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from mbstudio.core.errors import MbstudioError, ProjectError
from mbstudio.core.project.fit_table import read_fits, write_fits
from mbstudio.core.project.kept_table import read_kept, write_kept
from mbstudio.core.project.sealed_file import open_sealed, warn_unsealed
from mbstudio.core.project.state import FitSettings, ProjectState, ScanReference
from mbstudio.core.project.style_table import read_clones, read_style, write_clones, write_style
from mbstudio.core.replacement import replacing
from mbstudio.core.scan.excerpt import Excerpt
from mbstudio.core.sealing import HEADER_BYTES, seal_image
from mbstudio.core.units import VoxelSize
from mbstudio.core.version import __version__

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.scan.scan import VoxelArray

FORMAT = "mbstudio project"
SCHEMA = 4
_WITHOUT_PARTS, _WITHOUT_KEPT, _WITHOUT_STYLE = 3, 2, 1

# Shuffled level 1 packs label volumes about as small as level 9 and several times faster; the
# checksum tells of damage that the file's structure does not show.
_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}


def write_project(path: Path, state: ProjectState, voxels: VoxelArray | None = None) -> None:
    """Write a project file in place of `path`; if that fails, `path` stays as it was.

    Parameters
    ----------
    path : Path
    state : ProjectState
    voxels : VoxelArray, shape (Z, Y, X), optional
        The scan's voxels; needed (and written) where ``state.scan.embedded``.

    Raises
    ------
    ProjectError
        If the folder is missing, cannot be written, or the disk is full.
    """
    if path.is_dir():
        raise ProjectError(
            f"{path} is a folder: give the name of a file, for example {path / 'project.mbs'}."
        )
    # HDF5 takes the whole process down (bus error) when the disk fills up under it, so it writes
    # to memory; the compressed image then goes to the disk through Python's own file.
    image = io.BytesIO()
    with h5py.File(image, "w", userblock_size=HEADER_BYTES) as file:
        _write_state(file, path, state, voxels)
    seal_image(image.getbuffer())
    try:
        with replacing(path) as temporary, temporary.open("wb") as stream:
            stream.write(image.getbuffer())
    except OSError as error:
        before = "the project saved before is untouched" if path.exists() else "nothing was written"
        raise ProjectError(
            f"{path} cannot be saved ({_reason(error)}): {before}. "
            "Free some space, or save it in another folder."
        ) from error


def read_project(path: Path) -> ProjectState:
    """Read a project file, all but the voxels of an embedded scan.

    Raises
    ------
    ProjectError
        If the file is missing, damaged, no project, or of a newer mbstudio.
    """
    try:
        with open_sealed(path) as (stream, seal), h5py.File(stream, "r") as file:
            _require_readable_schema(file, path)
            state = _read_state(file, path)
    except (OSError, KeyError, RuntimeError, ValueError, TypeError, MbstudioError) as error:
        if isinstance(error, ProjectError):
            raise
        raise ProjectError(
            f"{path} is no project file of mbstudio, or it is damaged ({_reason(error)}): "
            "open a copy that was saved earlier, or copy it here again."
        ) from error
    if seal is None:
        warn_unsealed(path)
    return state


def read_embedded_voxels(path: Path) -> VoxelArray:
    """Read the voxels, shape (Z, Y, X), of the scan that is embedded in a project file.

    Raises
    ------
    ProjectError
        If the file is damaged or holds no voxels.
    """
    try:
        with open_sealed(path) as (stream, _), h5py.File(stream, "r") as file:
            voxels: VoxelArray = file["scan/voxels"][:]
            return voxels
    except (OSError, KeyError, RuntimeError) as error:
        raise ProjectError(f"The scan embedded in {path} cannot be read ({_reason(error)}).") from error


def _reason(error: Exception) -> str:
    """Return the part of an error that helps, without HDF5's inner details."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    text = str(error.args[0]) if error.args else type(error).__name__
    if "errno = " in text:
        return os.strerror(int(text.split("errno = ")[1].split(",")[0].split(")")[0]))
    if "truncated file" in text:
        return "it was cut off"
    return text


def _require_readable_schema(file: h5py.File, path: Path) -> None:
    if file.attrs.get("format") != FORMAT:
        raise ProjectError(
            f"{path} is an HDF5 file, but no project of mbstudio: open it with the program that wrote it."
        )
    schema = int(file.attrs["schema"])
    if schema > SCHEMA:
        raise ProjectError(
            f"{path} was written by {file.attrs.get('written_by', 'a newer mbstudio')} in format {schema}; "
            f"mbstudio {__version__} reads up to format {SCHEMA}: update mbstudio to open it."
        )


def _write_state(file: h5py.File, path: Path, state: ProjectState, voxels: VoxelArray | None) -> None:
    # What older versions would lose unseen keeps them away; all else stays readable to them.
    if state.scan is not None and state.scan.excerpt is not None:
        schema = SCHEMA
    elif state.kept:
        schema = _WITHOUT_PARTS
    else:
        styled = state.style is not None or state.clones is not None
        schema = _WITHOUT_KEPT if styled else _WITHOUT_STYLE
    file.attrs.update(format=FORMAT, schema=schema, written_by=f"mbstudio {__version__}")
    if state.scan is not None:
        _write_scan(file.create_group("scan"), path, state.scan, voxels)
    if state.segmentation is not None:
        _write_record(file.create_group("segmentation"), state.segmentation)
    if state.grains is not None:
        _write_grains(file.create_group("grains"), state.grains)
    _write_record(file.create_group("fit_settings"), state.fit_settings)
    write_fits(file.create_group("fits"), state.fits)
    if state.style is not None:
        write_style(file.create_group("style"), state.style)
    if state.clones is not None:
        write_clones(file.create_group("clones"), state.clones)
    if state.kept:
        write_kept(file.create_group("kept"), state.kept)


def _read_state(file: h5py.File, path: Path) -> ProjectState:
    segmentation = None
    if "segmentation" in file:
        # Imported late: segmentation brings scikit-image, which opening a project does not need.
        from mbstudio.core.grains.segmentation import SegmentationSettings

        segmentation = _read_record(file["segmentation"], SegmentationSettings)
    return ProjectState(
        scan=_read_scan(file["scan"], path) if "scan" in file else None,
        segmentation=segmentation,
        grains=_read_grains(file["grains"]) if "grains" in file else None,
        fits=MappingProxyType(read_fits(file["fits"])),
        fit_settings=_read_record(file["fit_settings"], FitSettings),
        style=read_style(file["style"], path) if "style" in file else None,
        clones=read_clones(file["clones"], path) if "clones" in file else None,
        kept=read_kept(file["kept"]) if "kept" in file else (),
    )


def _write_record(group: h5py.Group, record: Any) -> None:
    """Write the fields of a flat record as attributes; None becomes an empty one, a mapping JSON."""
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, Mapping):
            value = json.dumps(dict(value))
        group.attrs[field.name] = h5py.Empty("f8") if value is None else value


def _read_record(group: h5py.Group, kind: type) -> Any:
    """Read a flat record; a field that the file does not have takes its default."""
    known = {field.name for field in fields(kind)}
    values = {name: _plain(value) for name, value in group.attrs.items() if name in known}
    for field in fields(kind):
        if field.default_factory is dict and field.name in values:
            values[field.name] = json.loads(values[field.name])
    return kind(**values)


def _plain(value: Any) -> Any:
    """Return an attribute as Python's own type."""
    if isinstance(value, h5py.Empty):
        return None
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    return value.item() if isinstance(value, np.generic) else value


def _write_place(
    group: h5py.Group | h5py.Dataset, size: VoxelSize, origin: tuple[float, float, float]
) -> None:
    group.attrs.update(voxel_size_zyx=size.zyx, unit=size.unit, origin_xyz=tuple(map(float, origin)))


def _read_place(group: h5py.Group | h5py.Dataset) -> tuple[VoxelSize, tuple[float, float, float]]:
    z, y, x = _plain(group.attrs["voxel_size_zyx"])
    return VoxelSize(z, y, x, group.attrs["unit"]), _plain(group.attrs["origin_xyz"])


def _write_scan(group: h5py.Group, path: Path, scan: ScanReference, voxels: VoxelArray | None) -> None:
    _write_place(group, scan.voxel_size, scan.origin)
    group.attrs.update(
        shape_zyx=scan.shape, dtype=scan.dtype, digest=scan.digest, embedded=scan.embedded,
        header_bytes=scan.header_bytes, big_endian=scan.big_endian,
    )  # fmt: skip
    if scan.excerpt is not None:
        part = scan.excerpt
        group.attrs.update(
            file_shape_zyx=part.whole, start_zyx=part.start, stop_zyx=part.stop, bin_zyx=part.bin
        )
    if scan.path is not None:
        place = scan.path.resolve()
        group.attrs["path"] = str(place)
        try:
            # A project that is moved together with its scan finds it again.
            relative = os.path.relpath(place, path.resolve().parent)
        except ValueError:  # another drive on Windows
            relative = ""
        group.attrs["path_from_project"] = relative.replace(os.sep, "/")
    if scan.embedded:
        if voxels is None:
            raise ProjectError(
                f"{path} cannot be saved: the scan to embed is not open. Open it, or do not embed it."
            )
        depth, height, width = scan.shape
        stored = group.create_dataset(
            "voxels", scan.shape, dtype=voxels.dtype, chunks=(1, min(height, 512), min(width, 512)), **_PACKED
        )
        for index in range(depth):
            stored[index] = voxels[index]


def _read_scan(group: h5py.Group, path: Path) -> ScanReference:
    size, origin = _read_place(group)
    place = Path(group.attrs["path"]) if "path" in group.attrs else None
    relative = group.attrs.get("path_from_project", "")
    if relative and (path.resolve().parent / relative).exists():
        place = (path.resolve().parent / relative).resolve()
    depth, height, width = _plain(group.attrs["shape_zyx"])
    return ScanReference(
        path=place,
        shape=(depth, height, width),
        dtype=group.attrs["dtype"],
        voxel_size=size,
        origin=origin,
        digest=group.attrs["digest"],
        embedded=bool(group.attrs["embedded"]),
        header_bytes=int(group.attrs["header_bytes"]),
        big_endian=bool(group.attrs["big_endian"]),
        excerpt=_read_excerpt(group, (depth, height, width)),
    )


def _read_excerpt(group: h5py.Group, shape: tuple[int, int, int]) -> Excerpt | None:
    """Return which part of its file the scan is, None for all of it."""
    if "file_shape_zyx" not in group.attrs:
        return None
    whole, start, stop, factors = (
        _plain(group.attrs[name]) for name in ("file_shape_zyx", "start_zyx", "stop_zyx", "bin_zyx")
    )
    excerpt = Excerpt(whole, start, stop, factors, int(group.attrs["header_bytes"]))
    excerpt.require_possible(shape)
    return excerpt


def _write_grains(group: h5py.Group, grains: GrainSet) -> None:
    labels = group.create_dataset("labels", data=np.asarray(grains.labels), chunks=True, **_PACKED)
    _write_place(labels, grains.voxel_size, grains.origin)
    table = group.create_group("table")
    table.attrs["columns"] = list(map(str, grains.table.columns))
    for name, column in grains.table.items():
        if column.dtype.kind in "biuf":
            table[str(name)] = column.to_numpy()
        else:
            table.create_dataset(
                str(name), data=column.astype(str).tolist(), dtype=h5py.string_dtype("utf-8")
            )


def _read_grains(group: h5py.Group) -> GrainSet:
    from mbstudio.core.grains.grain_set import GrainSet

    size, origin = _read_place(group["labels"])
    labels = group["labels"][:]
    labels.flags.writeable = False
    return GrainSet(labels, _read_table(group["table"]), size, origin)


def _read_table(group: h5py.Group) -> pd.DataFrame:
    import pandas as pd  # imported late: it takes a third of a second

    columns = {}
    for name in group.attrs["columns"]:
        column = group[name]
        columns[name] = column.asstr()[:] if h5py.check_string_dtype(column.dtype) else column[:]
    return pd.DataFrame(columns)
