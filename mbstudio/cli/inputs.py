"""What the commands work on: a scan, a project or a mesh, told apart by the file's ending."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console
from mbstudio.core.errors import MbstudioError, ProjectChangedError, ProjectError

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.grains import GrainSet
    from mbstudio.core.grains.segmentation import SegmentationSettings
    from mbstudio.core.meshes.bodies import Cavities
    from mbstudio.core.project import Project
    from mbstudio.core.scan import Scan

PROJECT_ENDING = ".mbs"

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
CropOption = Annotated[
    str | None,
    typer.Option(
        "--crop",
        metavar="Z0:Z1,Y0:Y1,X0:X1",
        help="Take only this region, in voxels of the file, with ends as Python slices them: 100:300,:,50:",
    ),
]
BinOption = Annotated[
    str | None,
    typer.Option("--bin", metavar="N", help="Average blocks of N voxels; 1,2,2 (z, y, x) if they differ."),
]
SplittingOption = Annotated[
    float | None, typer.Option("--splitting", help="How strongly touching grains are split, 0 to 1.")
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
    typer.Option(
        "--dark/--bright", help="Grains are darker, or brighter, than the void; detected by default."
    ),
]
ClassifierOption = Annotated[
    Path | None,
    typer.Option(
        "--classifier",
        metavar="FILE",
        help="Voxels are grain where this classifier (*.mbclf), learned from strokes, takes them for it.",
    ),
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
MeshCavitiesOption = Annotated[
    str,
    typer.Option("--cavities", help="'fill' cavities that the body of a mesh encloses, or 'keep' them."),
]
AnywayOption = Annotated[
    bool, typer.Option("--anyway", help="Find the grains even if the memory seems too small for it.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print only the result, as JSON, on stdout.")]


def is_project(path: Path) -> bool:
    """Return whether a file is a project, by its ending."""
    return path.suffix.lower() == PROJECT_ENDING


def meshes_among(sources: Sequence[Path]) -> list[Path] | None:
    """Return the mesh files that are meant by files, folders and patterns; None if it is one scan or project.

    Raises
    ------
    MbstudioError
        If there are several inputs and one of them is no mesh, or a folder or pattern holds none.
    """
    from mbstudio.core.meshes.listing import find_meshes, means_meshes

    if len(sources) == 1 and not means_meshes(sources[0]):
        return None
    for source in sources:
        if not means_meshes(source):
            if not source.exists():
                raise MbstudioError(f"{source} does not exist: check the name and the folder.")
            raise MbstudioError(
                f"{source} is not a mesh or a folder of meshes: give several inputs only if all are meshes  "
                f"({', '.join(mesh_endings())}), and scans or projects one at a time."
            )
    return find_meshes(sources)


def is_mesh(path: Path) -> bool:
    """Return whether a file is a surface mesh, by its ending."""
    return path.suffix.lower() in mesh_endings()


def mesh_endings() -> tuple[str, ...]:
    """Return the endings of mesh files."""
    from mbstudio.core.meshes.endings import MESH_ENDINGS

    return MESH_ENDINGS


def one_input(sources: Sequence[Path]) -> Path:
    """Return the scan or project that was given."""
    (source,) = sources
    return source


def title_of(sources: Sequence[Path]) -> str:
    """Return what to call inputs in a heading."""
    return sources[0].name if len(sources) == 1 else f"{len(sources)} inputs"


def open_input_scan(
    path: Path,
    voxel_size: str | None,
    shape: str | None = None,
    dtype: str | None = None,
    header_bytes: int = 0,
    big_endian: bool = False,
    crop: str | None = None,
    binning: str | None = None,
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
        crop=crop,
        binning=binning,
    )


def require_scan_to_crop(source: Path, crop: str | None, binning: str | None) -> None:
    """Refuse a region or a bin of what is no scan file."""
    if crop is None and binning is None:
        return
    from mbstudio.core.meshes.listing import means_meshes

    option = "--crop" if crop is not None else "--bin"
    if is_project(source):
        raise MbstudioError(
            f"{source} is a project, whose scan stays as it is: "
            f"make another one of the scan's file with {option}."
        )
    if means_meshes(source):
        raise MbstudioError(f"{source} is no scan, and {option} is of voxels: leave it out.")


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
        raise MbstudioError(f"{option} '{text}' contains no number: write whole numbers as 3,5,9 or 1-20.")
    return labels


def included_numbers(text: str | None, option: str, grains: GrainSet | None) -> list[int] | None:
    """Read labels as `numbers_in`, and refuse those of grains that were excluded by hand.

    Raises
    ------
    MbstudioError
        If one is excluded.
    """
    labels = numbers_in(text, option)
    if labels is not None and grains is not None:
        excluded = grains.excluded_labels.intersection(labels)
        if excluded:
            raise MbstudioError(
                f"{option}: grain {min(excluded)} is excluded by hand: leave it out, or include it with "
                f"'mbstudio edit ... --include {min(excluded)}'."
            )
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


def find_grains(
    project: Project,
    labels: Path | None,
    settings: dict[str, Any],
    anyway: bool = False,
    classifier: Path | None = None,
) -> GrainSet:
    """Segment the project's scan, or load a label image made elsewhere, into the project.

    A scan that the memory is too small for is refused, unless it is to be tried anyway. Grains that the
    project has already keep their avatars.

    Raises
    ------
    ClassifierError
        If the classifier cannot be read, or does not fit the scan.
    """
    from mbstudio.core.grains import load_labels, segment
    from mbstudio.core.grains.segmentation import SegmentationSettings

    scan = project.scan
    if scan is None:
        raise ProjectError(
            "The project has no scan to segment: make a project from a scan with 'mbstudio segment'."
        )
    if labels is not None:
        if classifier is not None:
            raise MbstudioError("--labels and --classifier both say what is grain: give one of them.")
        grains = load_labels(labels, scan, splitting=settings.get("splitting"))
        _use_grains(project, "Load labels", grains, None)
        return grains
    learned = None
    if classifier is not None:
        from mbstudio.core.grains.classifying import load_classifier

        learned = load_classifier(classifier)
    chosen = SegmentationSettings(**settings, by_classifier=learned is not None)
    _tell_memory(scan, anyway)
    with console.progress("Finding grains") as report:
        grains = segment(scan, chosen, classifier=learned, progress=report)
    if learned is not None:
        project.change("Load classifier", classifier=learned)
    _use_grains(project, "Find grains", grains, chosen)
    return grains


def _use_grains(
    project: Project, title: str, grains: GrainSet, settings: SegmentationSettings | None
) -> None:
    """Bring grains into a project; avatars stay whose grain has the same voxels as before."""
    from mbstudio.core.project.fit_journal import grains_digest

    before = project.grains
    if before is not None and grains_digest(before) == grains_digest(grains):
        project.change(title, segmentation=settings)
    else:
        regraining = project.use_grains(grains, settings, title)
        if regraining.discarded:
            console.tell(
                f"mbstudio: {len(regraining.discarded)} avatars are discarded, as their grains have other "
                f"voxels now; {regraining.kept} stay."
            )
        for edit, reason in regraining.left_out:
            console.tell(f"mbstudio: A correction by hand is left out: {edit.described()}: {reason}")
    _tell_doubts(grains)


def _tell_doubts(grains: GrainSet) -> None:
    """Say what the scan does not bear out, and what to do."""
    if grains.verdict is not None:
        for doubt in grains.verdict.described:
            console.tell(f"The grains are in doubt. {doubt}")


def _tell_memory(scan: Scan, anyway: bool) -> None:
    """Tell how much memory finding the grains takes, if that is much; refuse it if it is too much."""
    from mbstudio.core.batch.memory_estimate import need_of_segmentation

    need = need_of_segmentation(scan)
    told = f"finding the grains of {scan.path or 'the scan'} needs {need.describe()}"
    if not need.fits and not anyway:
        raise MbstudioError(
            f"{told[0].upper()}{told[1:]}: take a region of the scan (--crop) or larger voxels (--bin), "
            "close other programs, or try it all the same (--anyway)."
        )
    if need.is_worth_telling:
        console.tell(f"mbstudio: {told}.")


def grains_of_meshes(meshes: Sequence[Path], resolution: int, unit: str | None, cavities: str) -> GrainSet:
    """Return the bodies of meshes as one set of grains, so that a project can hold them.

    Files that cannot be read are told, unless there is no other.
    """
    from mbstudio.core.grains.mesh_set import grain_set_from_meshes

    return grain_set_from_meshes(
        meshes,
        resolution,
        unit,
        require_cavities(cavities),
        on_failure=tell_failure if len(meshes) > 1 else None,
    )


def bodies_of_meshes(
    meshes: Sequence[Path], unit: str | None, cavities: str, grains: str | None, limit: int | None
) -> list[trimesh.Trimesh]:
    """Return the bodies of meshes, or those of these numbers; files that cannot be read are told.

    Raises
    ------
    MbstudioError
        If no file can be read, or there is no body of a number.
    """
    from mbstudio.core.meshes.bodies import bodies_of

    wanted = numbers_in(grains, "--grains")
    bodies = bodies_of(
        meshes, unit, require_cavities(cavities), tell_failure if len(meshes) > 1 else None,
        most=limit if wanted is None else None,
    )  # fmt: skip
    if wanted is None:
        return bodies
    for number in wanted:
        if not 1 <= number <= len(bodies):
            raise MbstudioError(f"There is no grain {number}: the meshes hold 1 to {len(bodies)}.")
    return [bodies[number - 1] for number in dict.fromkeys(wanted)][:limit]


def refuse_for_meshes(segmentation: Mapping[str, object], **options: object) -> None:
    """Refuse options of scans that were given with meshes, where they would mean nothing."""
    named = {"smallest_voxels": "smallest", "ranges": "threshold"}
    given = [name for name, value in options.items() if value is not None]
    given += [named.get(name, name) for name in segmentation]
    if given:
        option = "--" + given[0].replace("_", "-")
        hint = " Give the unit of the coordinates with --unit." if given[0] == "voxel_size" else ""
        raise MbstudioError(f"{option} is an option of scans: leave it out for meshes.{hint}")


def require_cavities(word: str) -> Cavities:
    """Return what to do with cavities, or refuse the word."""
    if word == "fill":
        return "fill"
    if word == "keep":
        return "keep"
    raise MbstudioError(f"--cavities '{word}' is not known: use 'fill' or 'keep'.")


def tell_failure(_path: Path, error: MbstudioError) -> None:
    """Tell why one of many files was left out."""
    console.tell(f"mbstudio: left out: {error}")


def save_results(project: Project, output: Path, embed_scan: bool | None = None) -> Path:
    """Save a project; where others have written its file meanwhile, save a copy beside it and say so.

    Raises
    ------
    ProjectError
        If it cannot be written, or a copy was.
    """
    try:
        return project.save(output, embed_scan=embed_scan)
    except ProjectChangedError as error:
        copy = next(
            path
            for number in range(2, 1000)
            if not (path := output.with_stem(f"{output.stem} ({number})")).exists()
        )
        project.save(copy, embed_scan=embed_scan)
        raise ProjectError(f"{error} Nothing is lost: what this command found lies in {copy}.") from error


def require_project_output(path: Path) -> Path:
    """Refuse an output that cannot be written, or would replace something else, before the work begins."""
    from mbstudio.core.project.file import is_project_file

    folder = path.resolve().parent
    if not folder.is_dir():
        raise ProjectError(f"{path} cannot be written: the folder {folder} does not exist.")
    if not os.access(folder, os.W_OK):
        raise ProjectError(f"{path} cannot be written: you may not write into the folder {folder}.")
    if path.is_dir():
        raise ProjectError(f"{path} is a folder: give the name of a project file ending in {PROJECT_ENDING}.")
    if path.exists() and not is_project_file(path):
        raise ProjectError(
            f"{path} exists and is not an mbstudio project: choose another name for the project."
        )
    return path
