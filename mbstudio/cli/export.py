"""``mbstudio export``: avatars as files for a DEM engine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.errors import ExportError

if TYPE_CHECKING:
    from mbstudio.core.metaball import Avatar
    from mbstudio.core.project import Project


def export(
    source: Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with avatars.")],
    target: Annotated[
        str, typer.Option("--to", metavar="TARGET", help="stl, obj, ply, metaball or liggghts.")
    ],
    folder: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the files go.")],
    density: Annotated[float | None, typer.Option("--density", help="Of the grains, in kg/m3.")] = None,
    unit: Annotated[str | None, typer.Option("--unit", help="Length unit of the files.")] = None,
    select: Annotated[
        str,
        typer.Option(
            "--select", metavar="all|valid|3,5,9", help="Which avatars; labels may be ranges (1-20)."
        ),
    ] = "valid",
    spheres: Annotated[int | None, typer.Option("--spheres", help="Spheres of each clump.")] = None,
    option: Annotated[
        list[str] | None,
        typer.Option("--option", metavar="NAME=VALUE", help="A further option of the target."),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write into a folder that holds other files too.")
    ] = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Write avatars for a DEM engine, each with its centre of mass at the origin."""
    from mbstudio.core.dem import export as export_avatars
    from mbstudio.core.project import Project

    options = _options(option or [])
    if spheres is not None:
        options["spheres"] = spheres
    project = Project.open(source)
    avatars = choose_avatars(project, select, source)
    with console.progress("Exporting") as report:
        done = export_avatars(
            avatars,
            target,
            folder,
            density=density,
            unit=unit,
            overwrite=overwrite,
            progress=report,
            **options,
        )
    result = {
        "target": done.target,
        "folder": str(done.folder),
        "avatars": len(avatars),
        "left_out": len(project.avatars) - len(avatars),
        "files": [str(path) for path in done.files],
    }
    if as_json:
        console.print_json(result)
    else:
        console.print_facts("Exported", {**result, "files": len(done.files)})


def choose_avatars(project: Project, select: str, source: Path) -> list[Avatar]:
    """Return the avatars that ``--select`` names.

    Raises
    ------
    ExportError
        If there is none, or a grain that is named has none.
    """
    if not project.fits:
        raise ExportError(f"{source} holds no avatars yet: fit them with 'mbstudio fit {source}' first.")
    if select == "all":
        return project.avatars
    if select == "valid":
        chosen = [
            project.fits[label].avatar for label in sorted(project.fits) if project.fits[label].verdict.valid
        ]
        if not chosen:
            raise ExportError(
                f"None of the {len(project.fits)} avatars of {source} is valid: "
                "use --select all to have them anyway."
            )
        return chosen
    labels = inputs.numbers_in(select, "--select") or []
    missing = [label for label in labels if label not in project.fits]
    if missing:
        raise ExportError(
            f"Grain {missing[0]} of {source} has no avatar: fit it first, or leave it out of --select."
        )
    return [project.fits[label].avatar for label in labels]


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
