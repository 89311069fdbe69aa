"""``mbstudio export``: avatars as files for a DEM engine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.errors import ExportError

if TYPE_CHECKING:
    from mbstudio.core.dem import SpecimenPlan
    from mbstudio.core.metaball import Avatar
    from mbstudio.core.populations.sieving import SizeDistribution
    from mbstudio.core.project import Project


def _tell_targets(wanted: bool) -> None:
    """Print every target with its options and end, if that is wanted."""
    if not wanted:
        return
    from mbstudio.core.dem import targets

    for name, target in targets().items():
        print(f"{name}: {target.title}{', needs --density' if target.needs_density else ''}")
        console.print_options(target.options)
    raise typer.Exit


HELP = "Write avatars for a DEM engine, each with its centre of mass at the origin."

SourceArgument = Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with avatars.")]
TargetOption = Annotated[
    str, typer.Option("--to", metavar="TARGET", help="Kind of DEM files; --targets lists all.")
]
FolderOption = Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder.")]
DensityOption = Annotated[float | None, typer.Option("--density", help="Density of the grains, in kg/m3.")]
UnitOption = Annotated[str | None, typer.Option("--unit", help="Length unit of the files.")]
SelectOption = Annotated[
    str,
    typer.Option(
        "--select",
        metavar="all|valid|3,5,9|kept",
        help="Avatars to export; labels may be ranges (1-20). 'kept' takes the grains kept in the latent "
        "studio, 'kept:flat one,kept 2' those with these names.",
    ),
]
SpheresOption = Annotated[int | None, typer.Option("--spheres", help="Number of spheres of each clump.")]
ErrorOption = Annotated[
    float | None,
    typer.Option(
        "--error",
        metavar="PERCENT",
        help="Largest distance of a mesh to its avatar in % of D_n; the coarsest such mesh is taken.",
    ),
]
ClumpTargetOption = Annotated[
    str | None,
    typer.Option(
        "--clump-target",
        metavar="TARGET",
        help="Find the fewest spheres that reach this: 'iou 0.95', 'hausdorff 3 %', 'volume 1 %', "
        "'inertia 1 %'; 'and n 200' sets the largest number.",
    ),
]
ExtraOption = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help="An option of the target; repeat for more."),
]
SpecimenOption = Annotated[
    int | None,
    typer.Option(
        "--specimen",
        metavar="N",
        help="Also fill a box with N particles, in the avatars' own sizes or scaled to --curve.",
    ),
]
CurveOption = Annotated[
    str | None,
    typer.Option(
        "--curve",
        metavar="SIZE:FINER,...",
        help="Scale the particles to these sizes and percent finer by mass: 0.1:0,0.3:40,0.8:100 (in mm, or "
        "add a unit at the end).",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of the specimen.")]
ShareOption = Annotated[
    list[str] | None,
    typer.Option("--share", metavar="NAME=SHARE", help="Relative frequency of an avatar in the specimen."),
]
PeriodicOption = Annotated[
    bool, typer.Option("--periodic", help="Give the box of the specimen periodic sides (LAMMPS).")
]
BoxWidthOption = Annotated[
    float | None,
    typer.Option(
        "--box-width",
        help="Width of the specimen's box, in the unit of the curve, without one in that of the files.",
    ),
]
TellTargetsOption = Annotated[
    bool,
    typer.Option(
        "--targets",
        is_eager=True,
        callback=_tell_targets,
        help="List all targets with their options, and exit.",
    ),
]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Write into a folder that contains other files.")
]


def export(
    source: SourceArgument,
    target: TargetOption,
    folder: FolderOption,
    density: DensityOption = None,
    unit: UnitOption = None,
    select: SelectOption = "valid",
    spheres: SpheresOption = None,
    error: ErrorOption = None,
    clump_target: ClumpTargetOption = None,
    option: ExtraOption = None,
    specimen: SpecimenOption = None,
    curve: CurveOption = None,
    seed: SeedOption = 0,
    share: ShareOption = None,
    box_width: BoxWidthOption = None,
    periodic: PeriodicOption = False,
    _targets: TellTargetsOption = False,
    overwrite: OverwriteOption = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio export``; `HELP` says what it does."""
    from mbstudio.core.dem import export as export_avatars
    from mbstudio.core.project import Project

    options = _options(option or [])
    plan = _plan(specimen, curve, seed, share or [], box_width, periodic)
    if spheres is not None:
        options["spheres"] = spheres
    if error is not None:
        options["error"] = error
    if clump_target is not None:
        if spheres is not None:
            raise ExportError("Give either --spheres or --clump-target, not both.")
        options["clump_target"] = clump_target
    project = Project.open(source)
    names: list[str] | None = None
    attachments: dict[str, str] = {}
    if select.partition(":")[0] == "kept":
        avatars, names, attachments = choose_kept(project, select, source)
        left_out = len(project.state.kept) - len(avatars)
    else:
        avatars = choose_avatars(project, select, source)
        left_out = len(project.fits) - len(avatars)
        _tell_changed(project, avatars)
    with console.progress("Exporting") as report:
        done = export_avatars(
            avatars,
            target,
            folder,
            density=density,
            unit=unit,
            names=names,
            overwrite=overwrite,
            progress=report,
            attachments=attachments,
            specimen=plan,
            **options,
        )
    result = {
        "target": done.target,
        "folder": str(done.folder),
        "avatars": len(avatars),
        "left_out": left_out,
        "files": [str(path) for path in done.files],
        "warnings": list(done.warnings),
        "runs": {name: dict(cost) for name, cost in done.runs.items()},
    }
    for name, cost in done.runs.items():
        hours = f"about {cost['hours']:.2g} hours on one core"
        console.tell(f"{name} takes {cost['steps']:,} time steps, {hours}.")
    for warning in done.warnings:
        console.tell(f"Warning: {warning}")
    if as_json:
        console.print_json(result)
    else:
        facts = {**result, "files": len(done.files), "warnings": len(done.warnings)}
        del facts["runs"]
        console.print_facts("Exported", facts)


def _tell_changed(project: Project, avatars: list[Avatar]) -> None:
    """Tell avatars of grains that have changed since they were fitted."""
    taken = {id(avatar) for avatar in avatars}
    changed = [label for label in project.state.changed_labels if id(project.fits[label].avatar) in taken]
    if changed:
        console.tell(
            f"mbstudio: {len(changed)} grains have changed since they were fitted, such as grain "
            f"{min(changed)}: fit the project again for avatars of what they are now."
        )


def choose_avatars(project: Project, select: str, source: Path) -> list[Avatar]:
    """Return the avatars that ``--select`` names.

    Raises
    ------
    ExportError
        If there is none, or a grain that is named has none.
    """
    if not project.fits:
        raise ExportError(f"{source} has no avatars yet: fit them with 'mbstudio fit {source}' first.")
    if select == "all":
        return project.avatars
    if select == "valid":
        chosen = [fit.avatar for fit in project.state.included_fits.values() if fit.verdict.valid]
        if not chosen:
            raise ExportError(
                f"None of the {len(project.fits)} avatars of {source} is valid: "
                "use --select all to export them anyway."
            )
        return chosen
    labels = inputs.included_numbers(select, "--select", project.grains) or []
    missing = [label for label in labels if label not in project.fits]
    if missing:
        raise ExportError(
            f"Grain {missing[0]} of {source} has no avatar: fit it first, or leave it out of --select."
        )
    return [project.fits[label].avatar for label in labels]


def choose_kept(
    project: Project, select: str, source: Path
) -> tuple[list[Avatar], list[str], dict[str, str]]:
    """Return the kept grains that ``--select kept`` or ``kept:name,name`` names, as export takes them.

    Raises
    ------
    ExportError
        If there is none, or none of a name.
    """
    from mbstudio.core.vae.shaping.kept_grain import prepare_export, select_style

    style = project.state.style
    kept = select_style(project.state.kept, style)
    if style is None or not kept:
        there = len(project.state.kept)
        raise ExportError(
            f"The {there} kept grains of {source} were made with another style-learner than the project's: "
            "open that one at station Latent and save the project."
            if there
            else f"{source} has no kept grains: keep some at station Latent and save the project."
        )
    wanted = [name.strip() for name in select.partition(":")[2].split(",") if name.strip()]
    known = {grain.name: grain for grain in kept}
    for name in wanted:
        if name not in known:
            raise ExportError(f"{source} has no kept grain '{name}': choose from {', '.join(known)}.")
    return prepare_export(style, [known[name] for name in wanted] or kept)


def _plan(
    count: int | None,
    curve: str | None,
    seed: int,
    shares: list[str],
    width: float | None,
    periodic: bool,
) -> SpecimenPlan | None:
    """Return the specimen that was asked for.

    Raises
    ------
    ExportError
        If a part of it is missing or cannot be read.
    """
    from mbstudio.core.dem import SpecimenPlan

    if count is None:
        if curve or shares or width is not None or periodic:
            raise ExportError(
                "--curve, --share, --box-width and --periodic need a specimen: give --specimen N too."
            )
        return None
    numbers = {}
    for name, value in _options(shares).items():
        if isinstance(value, str | bool):
            raise ExportError(f"--share {name}={value} cannot be read: write a number after the name.")
        numbers[name] = float(value)
    wanted = None if curve is None else _curve(curve)
    return SpecimenPlan(count, wanted, seed, numbers, width, periodic=periodic)


def _curve(text: str) -> SizeDistribution:
    """Read ``size:finer,size:finer,... unit``; without a unit the sizes are in mm."""
    from mbstudio.core.dem import target_curve

    points, _, unit = text.strip().partition(" ")
    pairs = [point.split(":") for point in points.strip(",").split(",")]
    try:
        sizes, finer = zip(*((float(size), float(percent)) for size, percent in pairs), strict=True)
    except ValueError as error:
        raise ExportError(
            f"--curve {text} cannot be read: write size:percent finer, as in 0.1:0,0.3:40,0.8:100 mm."
        ) from error
    return target_curve(sizes, finer, unit.strip() or "mm")


def _options(words: list[str]) -> dict[str, Any]:
    """Read ``name=value``; numbers become numbers, ``yes`` and ``no`` become booleans."""
    options: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name:
            raise ExportError(f"--option {word} cannot be read: write it as name=value.")
        options[name] = _value(value)
    return options


def _value(text: str) -> Any:
    if text in ("yes", "true", "no", "false"):
        return text in ("yes", "true")
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
