"""Export avatars to a DEM engine, all or nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.dem.body import DemBody, choose_names, prepare_bodies, state_difference
from mbstudio.core.dem.folder import check_replaceable, replaced_folder
from mbstudio.core.dem.manifest import (
    FILE_NAME,
    check_digests,
    describe_body,
    files_of_earlier_export,
    make_manifest,
    read_manifest,
    write_manifest,
)
from mbstudio.core.dem.specimen.specimen import SpecimenPlan, make_specimen
from mbstudio.core.dem.specimen.specimen_files import FILE_NAME as SPECIMEN_NAME
from mbstudio.core.dem.specimen.specimen_files import check_specimen, describe_specimen, write_specimen
from mbstudio.core.dem.target import Job, Progress, Target, complete_options, find_target
from mbstudio.core.errors import ExportError, MbstudioError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.units import parse_unit

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class ExportReport:
    """What an export wrote.

    Attributes
    ----------
    folder : Path
    target : str
    files : tuple of Path
        Every file written, the manifest last.
    manifest : mapping
        What manifest.json says.
    items : tuple of mappings
        The manifest's entry for each avatar: name, files, volume, mass, moments, pose, details.
    warnings : tuple of str
        What the engine will find hard about an avatar, naming it.
    """

    folder: Path
    target: str
    files: tuple[Path, ...]
    manifest: Mapping[str, Any]
    items: tuple[Mapping[str, Any], ...]
    warnings: tuple[str, ...] = ()

    @property
    def runs(self) -> Mapping[str, Mapping[str, Any]]:
        """What each deck costs, by its name: time steps, the step in s, about how many hours on one core."""
        runs: Mapping[str, Mapping[str, Any]] = self.manifest.get("runs", {})
        return runs


def export(
    avatars: Avatar | Sequence[Avatar],
    target: str,
    folder: str | Path,
    *,
    density: float | None = None,
    unit: str | None = None,
    names: Sequence[str] | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    attachments: Mapping[str, str | bytes] | None = None,
    specimen: SpecimenPlan | None = None,
    surfaces: Sequence[trimesh.Trimesh] | None = None,
    **options: Any,
) -> ExportReport:
    """Write avatars for a DEM engine: each with its centre of mass at the origin and principal axes.

    The pose, mass and moments stand in manifest.json. Every file is read back and checked before
    the folder is swapped in; if anything fails or `progress` raises, nothing has changed.

    Parameters
    ----------
    avatars : Avatar or sequence of Avatar
    target : str
        A name from :func:`mbstudio.core.dem.targets`.
    folder : path
        A new or empty folder, or one with an earlier export, whose files are replaced; other
        files in it are kept.
    density : float, optional
        In kg/m**3; needed by targets whose files state a mass.
    unit : str, optional
        Length unit of the files; the target's own default otherwise.
    names : sequence of str, optional
        A file name for each avatar.
    overwrite : bool
        Write into a folder that contains other files and no earlier export.
    progress : callable(fraction, message), optional
        Raising in it cancels.
    attachments : mapping of str to str or bytes, optional
        Further files, by their names, that the folder is to hold: they come and go with the export.
    specimen : SpecimenPlan, optional
        Particles of a wanted size distribution: written as specimen.csv for every target, and as decks
        that pour them for LIGGGHTS and LAMMPS.
    surfaces : sequence of trimesh.Trimesh, optional
        The closed surface that each avatar was fitted to, in the avatar's frame and unit. Targets that hand
        over meshes take it in the avatar's place, as it is; whatever is taken, the manifest says how the two
        differ.
    **options
        The target's options.

    Raises
    ------
    ExportError
        If something given cannot be, an avatar cannot be exported, or the folder cannot be written.
    UnitError
        If the unit is unknown.
    """
    avatars = _listed(avatars, surfaces)
    chosen = find_target(target)
    unit = _choose_unit(chosen, unit, avatars[0].unit)
    density = _checked_density(chosen.title, chosen.needs_density, density)
    settings = complete_options(chosen, options)
    names = choose_names(avatars, names)
    folder, report_progress = Path(folder).expanduser(), progress or _ignore
    replaced = check_replaceable(folder, files_of_earlier_export, overwrite)

    with replaced_folder(folder, replaced, overwrite) as temporary:
        taken = surfaces if chosen.geometry == "mesh" else None
        bodies = _prepare_with(report_progress, avatars, names, unit, density, taken)
        particles = None if specimen is None else make_specimen(bodies, specimen, unit)
        job = Job(
            bodies, temporary, unit, density, settings, lambda f, m: report_progress(0.4 + 0.5 * f, m),
            particles,
        )  # fmt: skip
        _state_differences(job, surfaces)
        manifest = _write_files(job, chosen, attachments or {}, specimen)
        report_progress(0.9, "Reading back")
        _validate_before(temporary, folder)
    report_progress(1.0, "Exported")
    return _report_on(folder, manifest)


def _listed(avatars: Avatar | Sequence[Avatar], surfaces: Sequence[trimesh.Trimesh] | None) -> list[Avatar]:
    """Return the avatars, of which there are some, and with surfaces as many as these."""
    found = [avatars] if isinstance(avatars, Avatar) else list(avatars)
    if not found:
        raise ExportError("There is no avatar to export: fit a grain first.")
    if surfaces is not None and len(surfaces) != len(found):
        raise ExportError(f"{len(surfaces)} surfaces were given for {len(found)} avatars: give one for each.")
    return found


def _state_differences(job: Job, surfaces: Sequence[trimesh.Trimesh] | None) -> None:
    """Have the manifest say how each avatar differs from the surface that it was fitted to."""
    for body, surface in zip(job.bodies, surfaces or (), strict=surfaces is not None):
        job.remarks[body.name] = {"surface_of_record": state_difference(body, surface)}


def _validate_before(temporary: Path, folder: Path) -> None:
    """Read back what is still to be moved to its folder, and name that in errors."""
    try:
        validate(temporary)
    except ExportError as error:
        raise ExportError(str(error).replace(str(temporary), str(folder))) from error


def _report_on(folder: Path, manifest: Mapping[str, Any]) -> ExportReport:
    """Return the report of an export that lies in its folder."""
    files = tuple(folder / name for name in [*manifest["files"], FILE_NAME])
    items = tuple(manifest["items"])
    warnings = tuple(warning for item in items for warning in item["details"].get("warnings", ()))
    return ExportReport(folder, manifest["target"], files, manifest, items, warnings)


def _choose_unit(target: Target, asked: str | None, own: str) -> str:
    """Return the unit of the files: that asked for, the target's or the avatars' own."""
    unit = parse_unit(asked or target.default_unit or own)
    if target.units and unit not in target.units:
        raise ExportError(f"{target.title} are always in {' or '.join(target.units)}: leave the unit out.")
    return unit


def _prepare_with(
    report_progress: Progress,
    avatars: Sequence[Avatar],
    names: Sequence[str],
    unit: str,
    density: float | None,
    surfaces: Sequence[trimesh.Trimesh] | None,
) -> list[DemBody]:
    """Return the bodies of avatars, telling of each."""
    bodies: list[DemBody] = []
    for place, (name, avatar) in enumerate(zip(names, avatars, strict=True)):
        report_progress(0.4 * len(bodies) / len(avatars), f"Mass properties of {name}")
        surface = None if surfaces is None else surfaces[place]
        bodies += prepare_bodies([avatar], [name], unit, density, [surface])
    return bodies


def _write_files(
    job: Job, target: Target, attachments: Mapping[str, str | bytes], plan: SpecimenPlan | None
) -> dict[str, Any]:
    """Write all files of an export into the job's folder, the manifest last; return what that says."""
    written = target.write(job)
    for name, content in attachments.items():
        (job.folder / name).write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    shared = (*written.shared_files, *attachments)
    if job.specimen is not None:
        write_specimen(job.folder, job.specimen)
        shared = (*shared, SPECIMEN_NAME)
    items = [
        describe_body(body, job.density, files, {**details, **job.remarks.get(body.name, {})})
        for body, files, details in zip(job.bodies, written.item_files, written.item_details, strict=True)
    ]
    manifest = make_manifest(target.name, job.unit, job.density, job.options, items, shared, job.folder)
    if written.runs:
        manifest["runs"] = {name: dict(cost) for name, cost in written.runs.items()}
    if job.specimen is not None and plan is not None:
        manifest["specimen"] = describe_specimen(job.specimen, plan)
    write_manifest(job.folder, manifest)
    return manifest


def validate(folder: str | Path, *, digests: bool = True) -> dict[str, Any]:
    """Read every file of an export back and refuse what an engine would silently misread.

    Parameters
    ----------
    folder : path
    digests : bool
        Also refuse files that were changed after the export, however harmlessly.

    Returns
    -------
    dict
        The manifest.

    Raises
    ------
    ExportError
        Naming the file and what is wrong with it.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    chosen = find_target(manifest["target"])
    for name in manifest["files"]:
        if not (folder / name).is_file():
            raise ExportError(f"{folder / name} is missing: export again.")
    try:
        chosen.validate(folder, manifest)
        if "specimen" in manifest:
            check_specimen(folder, manifest)
    except ExportError:
        raise
    except MbstudioError as error:  # of what is made of the files: an avatar in two pieces
        raise ExportError(f"{folder} holds what cannot be used: {error} Export again.") from error
    except (AttributeError, LookupError, OverflowError, RecursionError, TypeError, ValueError) as error:
        told = " ".join(str(error).split())[:200]
        raise ExportError(
            f"{folder / FILE_NAME} or a file that it names has a missing or invalid entry {told}: "
            "export again."
        ) from error
    if digests:
        check_digests(folder, manifest)
    return manifest


def _checked_density(title: str, needed: bool, density: float | None) -> float | None:
    if density is None:
        if needed:
            raise ExportError(
                f"{title} needs the density of the grains: give it in kg/m3, for example density=2650."
            )
        return None
    if not (np.isfinite(density) and density > 0):
        raise ExportError(
            f"A density of {density:g} kg/m3 is impossible: give a positive number such as 2650."
        )
    return float(density)


def _ignore(fraction: float, message: str) -> None:
    """No one listens to the progress."""
