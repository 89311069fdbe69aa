"""The project file ``*.mbs``: an HDF5 file that holds a :class:`ProjectState`.

The first 512 bytes are a header with the file's seal: see mbstudio.core.sealing. Any HDF5 program steps over
it. Layout (schema 10); every text is UTF-8, nothing is pickled::

    /                attributes: format, schema, written_by
    /scan            attributes: where the scan lies and its digest, which part of the file it is, in how
                     large blocks; voxels, if embedded
    /segmentation    attributes: the settings, None as an empty attribute
    /grains          attributes: the verdict on the segmentation, as JSON; the highest number of a grain
    /grains/labels   label volume, compressed; attributes: voxel size, unit, origin
    /grains/table    one dataset a column; attribute: order of the columns
    /grains/view     cross-section of the field of view; attributes: its axis, whether the file marks it
    /grains/edits    corrections by hand as JSON texts, in their order; only where there are some
    /grains/meshes   see mbstudio.core.project.mesh_table; only of grains of mesh files
    /fit_settings    attributes
    /fits            see mbstudio.core.project.fit_table; changed: grains edited since they were fitted
    /style, /clones, /surfaces, /surface_clones
                     see mbstudio.core.project.style_table; only where there are some
    /kept, /packing  see mbstudio.core.project.kept_table; only where there are some
    /strokes, /classifier  see mbstudio.core.project.classifier_table; only where there are some
    /twin            see mbstudio.core.project.fit_table; only where there is one
    /log             titles of the changes that led here, oldest first; only where there are some

Schema 1 has neither style nor clones, schema 2 no kept grains, schema 3 no parts of scans, schema 4 no
meshes, schema 5 no corrections by hand, schema 6 neither strokes nor a classifier, schema 7 no styles of
surfaces, schema 8 no packing, schema 9 no twin: a project is written in the lowest that holds it. No version
minds a missing log.
"""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, get_args

import h5py
import numpy as np

from mbstudio.core.errors import MbstudioError, ProjectError
from mbstudio.core.imaging.steps import FitResult, Method
from mbstudio.core.own_files import is_own, mark_of
from mbstudio.core.project.classifier_table import (
    read_classifier,
    read_strokes,
    write_classifier,
    write_strokes,
)
from mbstudio.core.project.fit_table import read_fits, read_twin, write_fits, write_twin
from mbstudio.core.project.grain_table import (
    PACKED,
    is_edited,
    read_grains,
    read_place,
    write_grains,
    write_place,
)
from mbstudio.core.project.kept_table import (
    read_kept,
    read_packing_trial,
    write_kept,
    write_packing_trial,
)
from mbstudio.core.project.sealed_file import open_sealed, warn_unsealed
from mbstudio.core.project.state import LOGGED_CHANGES, FitSettings, ProjectState, ScanReference
from mbstudio.core.project.stored import ContentError, Stored, json_entries
from mbstudio.core.project.stored_reading import read_stored
from mbstudio.core.project.style_table import (
    read_clones,
    read_style,
    read_surface_clones,
    read_surfaces,
    write_clones,
    write_style,
    write_surface_clones,
    write_surfaces,
)
from mbstudio.core.replacement import replacing
from mbstudio.core.scan import Scan, voxel_digest
from mbstudio.core.scan.excerpt import Excerpt
from mbstudio.core.sealing import HEADER_BYTES, Seal, read_seal, seal_image
from mbstudio.core.version import __version__

if TYPE_CHECKING:
    from mbstudio.core.scan.scan import VoxelArray

FORMAT = "mbstudio project"
SCHEMA = 10
_VOXELS = "scan/voxels"
OF_BAD_CONTENTS = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)
"""What numbers and JSON of another kind than expected lead to, wherever they are used."""
_WITHOUT_TWIN, _WITHOUT_PACKING, _WITHOUT_SURFACES, _WITHOUT_STROKES = 9, 8, 7, 6
_WITHOUT_EDITS, _WITHOUT_MESHES = 5, 4
_WITHOUT_PARTS, _WITHOUT_KEPT, _WITHOUT_STYLE = 3, 2, 1


def write_project(
    path: Path,
    state: ProjectState,
    voxels: VoxelArray | None = None,
    announce: Callable[[str], object] | None = None,
) -> None:
    """Write a project file in place of `path`; if that fails, `path` stays as it was.

    Parameters
    ----------
    path : Path
    state : ProjectState
    voxels : VoxelArray, shape (Z, Y, X), optional
        The scan's voxels; needed (and written) where ``state.scan.embedded``.
    announce : callable, optional
        Gets what will tell the file from all others (see `sealed_file.identify`) before it is written.

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
    seal_image(image.getbuffer(), mark_of)
    seal = read_seal(bytes(image.getbuffer()[:HEADER_BYTES]))
    assert seal is not None
    if announce is not None:
        announce(seal.header)
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
    with _told(path), open_sealed(path) as (stream, seal):
        stored = read_stored(
            stream, f"-{_VOXELS}", path, lambda root: _accept(root, path), trusted=_is_own(seal)
        )
        state = _read_state(stored, path)
    if seal is None:
        warn_unsealed(path)
    return state


def read_embedded_scan(path: Path, reference: ScanReference) -> Scan:
    """Read the scan that is embedded in a project file.

    Raises
    ------
    ProjectError
        If the file is damaged, or holds other voxels than the reference says.
    """
    with _told(path), open_sealed(path) as (stream, seal):
        stored = read_stored(stream, _VOXELS, path, lambda root: _accept(root, path), trusted=_is_own(seal))
        voxels = stored.numbers(_VOXELS, "biuf", axes=3, finite=False)
    scan = Scan(voxels, reference.voxel_size, reference.origin, reference.path, excerpt=reference.excerpt)
    if scan.shape != reference.shape or voxel_digest(scan) != reference.digest:
        raise ProjectError(
            f"The voxels in {path} are not those of the scan that the project was made with (their digest "
            "differs): open an earlier copy of the project."
        )
    return scan


def is_project_file(path: Path) -> bool:
    """Return whether a file is a project of mbstudio, of any version; it may be damaged.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        if read_seal(stream.read(HEADER_BYTES)) is not None:
            return True
        try:
            read_stored(stream, _VOXELS, path, lambda root: _accept(root, path))
        except ProjectError:
            return False
    return True


def _is_own(seal: Seal | None) -> bool:
    return seal is not None and is_own(seal.digest, seal.mark)


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Name the file in whatever goes wrong while it is read."""
    try:
        yield
    except ProjectError:
        raise
    except (*OF_BAD_CONTENTS, MbstudioError, OSError) as error:
        raise ProjectError(
            f"{path} is not an mbstudio project, or it is damaged ({_reason(error)}): "
            "open a copy that was saved earlier, or copy it here again."
        ) from error


def _reason(error: Exception) -> str:
    """Return the part of an error that helps."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    return str(error.args[0]) if error.args else type(error).__name__


def _accept(root: Mapping[str, Any], path: Path) -> None:
    """Refuse a file by the attributes of its root: another program's, or of a newer mbstudio."""
    if root.get("format") != FORMAT:
        raise ProjectError(
            f"{path} is an HDF5 file, but not an mbstudio project: open it with the program that wrote it."
        )
    schema = root.get("schema")
    if type(schema) is not int or schema < 1:
        raise ContentError("it does not say its format")
    if schema > SCHEMA:
        raise ProjectError(
            f"{path} was written by {root.get('written_by', 'a newer mbstudio')} in format {schema}; "
            f"mbstudio {__version__} reads up to format {SCHEMA}: update mbstudio to open it."
        )


def _lowest_schema(state: ProjectState) -> int:
    """Return the lowest schema that holds a state: what older versions would lose unseen keeps them away."""
    if state.twin is not None:
        return SCHEMA
    if state.packing is not None:
        return _WITHOUT_TWIN
    if state.surfaces is not None or state.surface_clones is not None:
        return _WITHOUT_PACKING
    if state.strokes or state.classifier is not None:
        return _WITHOUT_SURFACES
    if state.grains is not None and is_edited(state.grains):
        return _WITHOUT_STROKES
    if state.grains is not None and state.grains.meshes:
        return _WITHOUT_EDITS
    if state.scan is not None and state.scan.excerpt is not None:
        return _WITHOUT_MESHES
    if state.kept:
        return _WITHOUT_PARTS
    styled = state.style is not None or state.clones is not None
    return _WITHOUT_KEPT if styled else _WITHOUT_STYLE


def _write_state(file: h5py.File, path: Path, state: ProjectState, voxels: VoxelArray | None) -> None:
    schema = _lowest_schema(state)
    file.attrs.update(format=FORMAT, schema=schema, written_by=f"mbstudio {__version__}")
    if state.scan is not None:
        _write_scan(file.create_group("scan"), path, state.scan, voxels)
    if state.segmentation is not None:
        _write_record(file.create_group("segmentation"), state.segmentation)
    if state.grains is not None:
        write_grains(file.create_group("grains"), state.grains)
    _write_record(file.create_group("fit_settings"), state.fit_settings)
    write_fits(file.create_group("fits"), state.fits)
    if state.changed_labels:
        file["fits"]["changed"] = np.array(sorted(state.changed_labels), dtype=np.int64)
    _write_styles(file, state)
    if state.kept:
        write_kept(file.create_group("kept"), state.kept)
    if state.strokes:
        write_strokes(file.create_group("strokes"), state.strokes)
    if state.classifier is not None:
        write_classifier(file.create_group("classifier"), state.classifier)
    if state.packing is not None:
        write_packing_trial(file.create_group("packing"), state.packing)
    if state.twin is not None:
        write_twin(file.create_group("twin"), state.twin)
    if state.log:
        file.create_dataset("log", data=list(state.log), dtype=h5py.string_dtype("utf-8"))


def _write_styles(file: h5py.File, state: ProjectState) -> None:
    if state.style is not None:
        write_style(file.create_group("style"), state.style)
    if state.clones is not None:
        write_clones(file.create_group("clones"), state.clones)
    if state.surfaces is not None:
        write_surfaces(file.create_group("surfaces"), state.surfaces)
    if state.surface_clones is not None:
        write_surface_clones(file.create_group("surface_clones"), state.surface_clones)


def _read_state(stored: Stored, path: Path) -> ProjectState:
    segmentation = None
    if "segmentation" in stored:
        # Imported late: segmentation brings scikit-image, which opening a project does not need.
        from mbstudio.core.grains.segmentation import SegmentationSettings

        segmentation = _read_record(stored.group("segmentation"), SegmentationSettings)
    fit_settings = _read_record(stored.group("fit_settings"), FitSettings)
    if fit_settings.n < 1 or fit_settings.method not in get_args(Method):
        raise ContentError("fit_settings are none")
    fits = read_fits(stored.group("fits"))
    return ProjectState(
        scan=_read_scan(stored.group("scan"), path) if "scan" in stored else None,
        segmentation=segmentation,
        grains=read_grains(stored.group("grains")) if "grains" in stored else None,
        fits=MappingProxyType(fits),
        fit_settings=fit_settings,
        style=read_style(stored.group("style"), path) if "style" in stored else None,
        clones=read_clones(stored.group("clones"), path) if "clones" in stored else None,
        surfaces=read_surfaces(stored.group("surfaces")) if "surfaces" in stored else None,
        surface_clones=(
            read_surface_clones(stored.group("surface_clones")) if "surface_clones" in stored else None
        ),
        kept=read_kept(stored.group("kept")) if "kept" in stored else (),
        outdated=_read_outdated(stored.group("fits"), fits),
        strokes=read_strokes(stored.group("strokes")) if "strokes" in stored else (),
        classifier=read_classifier(stored.group("classifier"), path) if "classifier" in stored else None,
        packing=read_packing_trial(stored.group("packing")) if "packing" in stored else None,
        twin=read_twin(stored.group("twin")) if "twin" in stored else None,
        log=tuple(stored.texts("log"))[-LOGGED_CHANGES:] if "log" in stored else (),
    )


def _read_outdated(stored: Stored, fits: Mapping[int, FitResult]) -> Mapping[int, FitResult]:
    """Return the fits whose grain has changed since."""
    labels = stored.numbers("changed", "iu").tolist() if "changed" in stored else []
    if not set(labels) <= fits.keys():
        raise ContentError("fits/changed names grains that are not fitted")
    return MappingProxyType({label: fits[label] for label in labels})


def _write_record(group: h5py.Group, record: Any) -> None:
    """Write the fields of a flat record as attributes; None becomes an empty one, a mapping JSON."""
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, Mapping):
            value = json.dumps(dict(value))
        group.attrs[field.name] = h5py.Empty("f8") if value is None else value


def _read_record(stored: Stored, kind: type) -> Any:
    """Read a flat record; a field that the file does not have takes its default."""
    default = kind()
    values: dict[str, Any] = {}
    for field in fields(kind):
        if field.name not in stored.attributes():
            continue
        value, usual = stored.attributes()[field.name], getattr(default, field.name)
        place = f"attribute {field.name} of {stored.path}"
        if isinstance(usual, Mapping):
            value = json_entries(stored.attribute(field.name, str), place)
        elif isinstance(usual, tuple):
            value = stored.tuple_of(field.name, float, len(value) if isinstance(value, list) else 0)
        elif usual is not None and type(value) is not type(usual):
            value = stored.attribute(field.name, type(usual))
        elif usual is None and not (value is None or isinstance(value, bool | int | float)):
            raise ContentError(f"{place} is neither a number nor empty")
        values[field.name] = value
    return kind(**values)


def _write_scan(group: h5py.Group, path: Path, scan: ScanReference, voxels: VoxelArray | None) -> None:
    write_place(group, scan.voxel_size, scan.origin)
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
            "voxels", scan.shape, dtype=voxels.dtype, chunks=(1, min(height, 512), min(width, 512)), **PACKED
        )
        for index in range(depth):
            stored[index] = voxels[index]


def _read_scan(stored: Stored, path: Path) -> ScanReference:
    size, origin = read_place(stored)
    told, relative = stored.attribute("path", str, ""), stored.attribute("path_from_project", str, "")
    if "\0" in told + relative:
        raise ContentError("the path of the scan holds a zero byte")
    place = Path(told) if told else None
    if relative and (path.resolve().parent / relative).exists():
        place = (path.resolve().parent / relative).resolve()
    depth, height, width = stored.tuple_of("shape_zyx", int, 3)
    dtype, digest = stored.attribute("dtype", str), stored.attribute("digest", str)
    header_bytes = stored.attribute("header_bytes", int)
    if min(depth, height, width) < 1 or header_bytes < 0 or np.dtype(dtype).kind not in "biuf":
        raise ContentError(f"a scan of {depth} x {height} x {width} voxels of type {dtype:.40} cannot be")
    if not re.fullmatch(r"[0-9a-f]{64}", digest):
        raise ContentError("the digest of the scan is none")
    return ScanReference(
        path=place,
        shape=(depth, height, width),
        dtype=dtype,
        voxel_size=size,
        origin=origin,
        digest=digest,
        embedded=stored.attribute("embedded", bool),
        header_bytes=header_bytes,
        big_endian=stored.attribute("big_endian", bool),
        excerpt=_read_excerpt(stored, (depth, height, width), header_bytes),
    )


def _read_excerpt(stored: Stored, shape: tuple[int, int, int], header_bytes: int) -> Excerpt | None:
    """Return which part of its file the scan is, None for all of it."""
    if "file_shape_zyx" not in stored.attributes():
        return None
    names = ("file_shape_zyx", "start_zyx", "stop_zyx", "bin_zyx")
    (wz, wy, wx), (z0, y0, x0), (z1, y1, x1), (bz, by, bx) = (stored.tuple_of(name, int, 3) for name in names)
    excerpt = Excerpt((wz, wy, wx), (z0, y0, x0), (z1, y1, x1), (bz, by, bx), header_bytes)
    excerpt.require_possible(shape)
    return excerpt
