"""``mbstudio measure``: shape factors of grains, avatars and meshes."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.going_on import keeping_results
from mbstudio.cli.measuring import (
    Row,
    add_intervals,
    failures_of,
    measure_grains,
    print_intervals,
    require_parquet,
    rows_of,
    summarise,
    table_of,
    with_intervals,
    write_csv,
    write_parquet,
)
from mbstudio.cli.mesh_measuring import measure_meshes, table_of_meshes, tell_meshes
from mbstudio.core.errors import MbstudioError, MeasureError

ROWS_ON_SCREEN = 20
FAILURES_ON_SCREEN = 5


class Axes(StrEnum):
    """Conventions of the axis lengths, by their names in ``mbstudio.core.metrics.measure``."""

    OBB = "obb"
    FERET = "feret"
    INERTIA = "inertia"


class Surface(StrEnum):
    """How the area of a voxel grain is found, by its name in ``mbstudio.core.metrics.measure``."""

    CROFTON = "crofton"
    SMOOTHED = "smoothed"


GrainsOption = Annotated[
    str | None, typer.Option("--grains", metavar="3,5,9", help="Only these labels (1-20 is a range).")
]
LimitOption = Annotated[int | None, typer.Option("--limit", min=1, help="At most this many grains.")]
AxesOption = Annotated[
    Axes,
    typer.Option("--axes", help="How a, b, c are measured: bounding box, calipers, or ellipsoid of inertia."),
]
SurfaceOption = Annotated[Surface, typer.Option("--surface", help="Surface for the area of voxel grains.")]
DetailOption = Annotated[
    bool,
    typer.Option("--detail", help="Add convexity, spheres, Feret diameters, roundness, roughness, bands."),
]


HELP = """Measure the shape factors of a mesh, or of a project's grains and their avatars.

In a project, the grains that have an avatar are measured together with it, with the relative error
of each factor. If no grain has an avatar, all interior grains are measured. With --csv or --parquet, what
is measured is kept beside the table until that is written: the same command goes on where it was ended.
"""


def measure(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="PROJECT|MESHES...",
            help="A project with grains, or closed surface meshes: files, folders or patterns.",
        ),
    ],
    grains: GrainsOption = None,
    limit: LimitOption = None,
    unit: inputs.UnitOption = None,
    axes: AxesOption = Axes.OBB,
    surface: SurfaceOption = Surface.SMOOTHED,
    detail: DetailOption = False,
    cavities: inputs.MeshCavitiesOption = "fill",
    intervals: Annotated[
        bool,
        typer.Option("--intervals", help="Add an interval for each factor of a scanned grain (slow)."),
    ] = False,
    workers: inputs.WorkersOption = None,
    csv_file: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write one row per grain as CSV.")
    ] = None,
    parquet_file: Annotated[
        Path | None, typer.Option("--parquet", metavar="FILE", help="Write the same table as Parquet.")
    ] = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio measure``; `HELP` says what it does."""
    meshes = inputs.meshes_among(sources)
    for output in (csv_file, parquet_file):
        for source in meshes or sources:
            require_table_output(output, source)
    if parquet_file is not None:
        require_parquet()
    if meshes is not None:
        _refuse_intervals(intervals)
        how = {"axes": axes.value, "surface": surface.value, "detail": detail, "workers": workers}
        bodies = inputs.bodies_of_meshes(meshes, unit, cavities, grains, limit)
        with keeping_results(csv_file or parquet_file):
            found = measure_meshes(meshes, bodies, unit, **how)
            _write(table_of_meshes(found), csv_file, parquet_file)
        tell_meshes(found, as_json)
        return
    source = inputs.one_input(sources)
    project, labels = chosen_grains(source, grains, limit)
    _refuse_intervals(intervals and project.grains.meshes)
    with keeping_results(csv_file or parquet_file):
        populations = measure_grains(
            project, labels, unit=unit, axes=axes.value, surface=surface.value, detail=detail, workers=workers
        )
        rows, failures = rows_of(populations, project), failures_of(populations)
        table = table_of(populations, project)
        if intervals:
            add_intervals(rows, project, axes=axes.value, surface=surface.value, detail=detail, unit=unit)
            table = with_intervals(table, rows, populations.grains.unit)
        _write(table, csv_file, parquet_file)
    summary = summarise(rows)
    measured = [row for row in rows if "grain" in row]
    if as_json:
        stated = {"axes": axes.value, "surface": surface.value, "unit": populations.grains.unit}
        console.print_json({**stated, "grains": rows, "summary": summary, "failures": failures})
    else:
        _print_rows(source, measured, summary)
        print_intervals(rows)
    for kind, reasons in failures.items():
        for label, reason in list(reasons.items())[:FAILURES_ON_SCREEN]:
            console.tell(f"mbstudio: {kind.removesuffix('s')} {label} could not be measured: {reason}")
        if len(reasons) > FAILURES_ON_SCREEN:
            console.tell(
                f"mbstudio: and {len(reasons) - FAILURES_ON_SCREEN} more {kind}: "
                "write the table with --csv to see all."
            )
    if not measured:
        raise MeasureError(f"No grain of {source} could be measured: the reasons are listed above.")


def require_table_output(output: Path | None, source: Path) -> None:
    """Refuse an output that is what is measured, or that has no folder, before the work begins."""
    if output is None:
        return
    if output.resolve() == source.resolve():
        raise MbstudioError(f"{output} is the input: give the output another name.")
    if output.is_dir():
        raise MbstudioError(f"{output} is a folder: give the name of a file.")
    if not output.resolve().parent.is_dir():
        raise MbstudioError(
            f"{output} cannot be written: the folder {output.resolve().parent} does not exist."
        )


def chosen_grains(source: Path, grains: str | None, limit: int | None) -> tuple[Any, list[int]]:
    """Open a project and return it with the labels to be measured."""
    if not inputs.is_project(source):
        raise MbstudioError(
            f"{source} is neither a project (.mbs) nor a mesh ({', '.join(inputs.mesh_endings())})."
        )
    from mbstudio.core.project import Project

    project = Project.open(source)
    if project.grains is None:
        raise MeasureError(f"{source} has no grains yet: find them with 'mbstudio segment' first.")
    labels = inputs.included_numbers(grains, "--grains", project.grains)
    labels = labels or list(project.state.included_fits) or project.grains.interior_labels
    if not labels:
        raise MeasureError(
            f"All grains of {source} are cut by the border or excluded: select some with --grains."
        )
    return project, list(dict.fromkeys(labels))[:limit]


def _refuse_intervals(of_meshes: object) -> None:
    if of_meshes:
        raise MeasureError(
            "--intervals applies to scanned grains only; a mesh is exact. Leave the option out."
        )


def _write(table: Any, csv_file: Path | None, parquet_file: Path | None) -> None:
    if csv_file is not None:
        write_csv(csv_file, table)
    if parquet_file is not None:
        write_parquet(parquet_file, table)


def _print_rows(source: Path, rows: list[Row], summary: dict[str, dict[str, float | None]]) -> None:
    shown = ("volume", "sphericity", "circularity", "csf", "dns")
    named = any("name" in row for row in rows)
    table = [[_called(row), *(_with_error(row, name) for name in shown)] for row in rows[:ROWS_ON_SCREEN]]
    has_avatars = any("avatar" in row for row in rows)
    if table:
        headings = [
            "grain, mesh" if named else "grain",
            *(f"{name} (avatar)" if has_avatars else name for name in shown),
        ]
        console.print_table(
            f"Grains of {source.name}, lengths in {rows[0]['unit']}, axes {rows[0]['axes']}", headings, table
        )
    if len(rows) > ROWS_ON_SCREEN:
        print(f"... and {len(rows) - ROWS_ON_SCREEN} more: write them all with --csv FILE")
    medians = [
        [
            name,
            item["grain"],
            item["avatar"],
            None if item["error"] is None else f"{100 * item['error']:.2f} %",
        ]
        for name, item in summary.items()
    ]
    console.print_table(f"Medians over {len(rows)} grains", ("", "grain", "avatar", "|error|"), medians)
    if has_avatars:
        print(
            "The search for avatars fits volume and area: errors of these, of sphericity and of dn are small "
            "by construction.\n"
            "'mbstudio judge --fits' compares edge angles, curvature and harmonics, which are not fitted."
        )


def _called(row: Row) -> str:
    return f"{row['label']}, {row['name']}" if "name" in row else str(row["label"])


def _with_error(row: Row, name: str) -> str:
    cell = f"{row['grain'][name]:.4g}"
    return f"{cell} ({100 * row['relative_error'][name]:+.1f} %)" if "relative_error" in row else cell
