"""What the commands work on: a scan, a project or a mesh, told apart by the file's ending."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console
from mbstudio.core.errors import MbstudioError, ProjectError

if TYPE_CHECKING:
    from mbstudio.core.grains import Grain, GrainSet
    from mbstudio.core.project import Project
    from mbstudio.core.scan import Scan

PROJECT_ENDING = ".mbs"
MESH_ENDINGS = (".stl", ".ply", ".obj", ".off")

VoxelSizeOption = Annotated[
    str | None,
    typer.Option(
        "--voxel-size", metavar="LENGTH", help="Voxel size, '14 um' or '20 x 14 x 14 um' (z, y, x)."
    ),
]
ShapeOption = Annotated[
    str | None, typer.Option("--shape", metavar="Z,Y,X", help="Voxels of a RAW file along each axis.")
]
DtypeOption = Annotated[
    str | None, typer.Option("--dtype", metavar="TYPE", help="Data type of a RAW file, such as uint16.")
]
HeaderOption = Annotated[int, typer.Option("--header-bytes", help="Bytes before the voxels of a RAW file.")]
EndianOption = Annotated[bool, typer.Option("--big-endian", help="The RAW file is big-endian.")]
SplittingOption = Annotated[
    float | None, typer.Option("--splitting", help="How readily touching grains are split, 0 to 1.")
]
SmallestOption = Annotated[
    int | None, typer.Option("--smallest", metavar="VOXELS", help="Volume of the smallest grain that counts.")
]
ThresholdOption = Annotated[
    str | None,
    typer.Option(
        "--threshold",
        metavar="GREY",
        help="Grey value between void and grain, or ranges of grain as 90:140,200:255; found by default.",
    ),
]
DarkOption = Annotated[
    bool | None,
    typer.Option("--dark/--bright", help="Grains are darker, or brighter, than the void; found by default."),
]
LabelsOption = Annotated[
    Path | None, typer.Option("--labels", metavar="FILE", help="Use this label image instead of segmenting.")
]
ScanOption = Annotated[
    Path | None, typer.Option("--scan", metavar="PATH", help="Where the project's scan is now.")
]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", help="Number of processes; one per core by default.")
]
UnitOption = Annotated[
    str | None, typer.Option("--unit", help="Length unit of a mesh's coordinates: nm, um, mm, cm or m.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print only the result, as JSON, on stdout.")]


def is_project(path: Path) -> bool:
    """Return whether a file is a project, by its ending."""
    return path.suffix.lower() == PROJECT_ENDING


def is_mesh(path: Path) -> bool:
    """Return whether a file is a surface mesh, by its ending."""
    return path.suffix.lower() in MESH_ENDINGS


def open_input_scan(
    path: Path,
    voxel_size: str | None,
    shape: str | None = None,
    dtype: str | None = None,
    header_bytes: int = 0,
    big_endian: bool = False,
) -> Scan:
    """Open a scan as the options of a command describe it."""
    from mbstudio.core.scan import open_scan

    return open_scan(
        path,
        voxel_size,
        shape=_three_numbers(shape),
        dtype=dtype,
        header_bytes=header_bytes,
        big_endian=big_endian,
    )


def _three_numbers(text: str | None) -> tuple[int, int, int] | None:
    if text is None:
        return None
    try:
        z, y, x = (int(word) for word in text.replace("x", ",").replace(" ", ",").split(",") if word)
    except ValueError as error:
        raise MbstudioError(
            f"--shape '{text}' is not three whole numbers: write it as 400,512,512 (z, y, x)."
        ) from error
    return z, y, x


def numbers_in(text: str | None, option: str) -> list[int] | None:
    """Read labels as in ``3,5,9`` or ``1-20,33``."""
    if text is None:
        return None
    labels: list[int] = []
    try:
        for word in text.replace(" ", ",").split(","):
            if word:
                first, _, last = word.partition("-")
                labels.extend(range(int(first), int(last or first) + 1))
    except ValueError as error:
        raise MbstudioError(
            f"{option} '{text}' cannot be read: write whole numbers as 3,5,9 or 1-20."
        ) from error
    if not labels:
        raise MbstudioError(f"{option} '{text}' holds no number: write whole numbers as 3,5,9 or 1-20.")
    return labels


def segmentation_options(
    splitting: float | None, smallest: int | None, threshold: str | None, dark: bool | None = None
) -> dict[str, Any]:
    """Return the settings that were given, by their names in ``segment``."""
    given = {"splitting": splitting, "smallest_voxels": smallest, "dark": dark, **_grey_values(threshold)}
    return {name: value for name, value in given.items() if value is not None}


def _grey_values(text: str | None) -> dict[str, Any]:
    """Read a threshold as ``120``, or ranges as ``90:140,200:255``."""
    from mbstudio.core.grains.grey_ranges import read_ranges

    if text is None:
        return {}
    if ":" in text:
        return {"ranges": read_ranges(text)}
    try:
        return {"threshold": float(text)}
    except ValueError as error:
        raise MbstudioError(
            f"--threshold '{text}' cannot be read: write one grey value as 120, or ranges as 90:140,200:255."
        ) from error


def find_grains(project: Project, labels: Path | None, settings: dict[str, Any]) -> GrainSet:
    """Segment the project's scan, or load a label image made elsewhere, into the project."""
    from mbstudio.core.grains import load_labels, segment
    from mbstudio.core.grains.segmentation import SegmentationSettings

    scan = project.scan
    if scan is None:
        raise ProjectError(
            "The project has no scan to segment: make a project from a scan with 'mbstudio segment'."
        )
    if labels is not None:
        grains = load_labels(labels, scan, splitting=settings.get("splitting"))
        project.change("Load labels", grains=grains, segmentation=None, fits={})
        return grains
    chosen = SegmentationSettings(**settings)
    with console.progress("Finding grains") as report:
        grains = segment(scan, chosen, progress=report)
    project.change("Find grains", grains=grains, segmentation=chosen, fits={})
    return grains


def grains_of_mesh(grain: Grain) -> GrainSet:
    """Return the set of one grain that was made of a mesh, so that a project can hold it."""
    import numpy as np

    from mbstudio.core.grains.labelling import build_grain_set

    # A margin of one voxel: the grain is whole, no border cuts it off.
    labels = np.pad(grain.mask.astype(np.int32), 1)
    x, y, z = (float(place - edge) for place, edge in zip(grain.origin, grain.voxel_size.xyz, strict=True))
    return build_grain_set(labels, grain.voxel_size, (x, y, z))


def require_project_output(path: Path) -> Path:
    """Refuse an output that cannot be written, or would replace something else, before the work begins."""
    import h5py

    from mbstudio.core.project.file import FORMAT

    folder = path.resolve().parent
    if not folder.is_dir():
        raise ProjectError(f"{path} cannot be written: the folder {folder} does not exist.")
    if not os.access(folder, os.W_OK):
        raise ProjectError(f"{path} cannot be written: you may not write into the folder {folder}.")
    if path.is_dir():
        raise ProjectError(f"{path} is a folder: give the name of a project file ending in {PROJECT_ENDING}.")
    if path.exists():
        ours = False
        if h5py.is_hdf5(path):
            with h5py.File(path, "r", locking=False) as file:
                ours = file.attrs.get("format") == FORMAT
        if not ours:
            raise ProjectError(
                f"{path} exists and is not an mbstudio project: choose another name for the project."
            )
    return path
