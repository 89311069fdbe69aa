"""``mbstudio report``: grains and avatars of a project on one page."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.measure import (
    Axes,
    AxesOption,
    DetailOption,
    GrainsOption,
    LimitOption,
    Surface,
    SurfaceOption,
    chosen_grains,
    require_table_output,
)
from mbstudio.cli.measuring import failures_of, measure_grains


class Sieves(StrEnum):
    """Standard series of sieves, by their names in ``mbstudio.core.populations``."""

    ISO = "iso"
    ASTM = "astm"


HELP = """Compare the grains and avatars of a project in one HTML file with figures.

The grains are selected as for 'mbstudio measure'.
"""


def report(
    source: Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with grains.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="HTML file; by default beside the project."),
    ] = None,
    grains: GrainsOption = None,
    limit: LimitOption = None,
    unit: inputs.UnitOption = None,
    axes: AxesOption = Axes.OBB,
    surface: SurfaceOption = Surface.SMOOTHED,
    detail: DetailOption = False,
    sieves: Annotated[
        Sieves, typer.Option("--sieves", help="Standard sieves: ISO 3310-1 (R 20/3) or ASTM E11.")
    ] = Sieves.ISO,
    workers: inputs.WorkersOption = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio report``; `HELP` says what it does."""
    path = output or source.with_suffix(".html")
    require_table_output(path, source)
    begun = time.monotonic()
    project, labels = chosen_grains(source, grains, limit)
    populations = measure_grains(
        project, labels, unit=unit, axes=axes.value, surface=surface.value, detail=detail, workers=workers
    )
    from mbstudio.scene.reports.population_report import write_report

    with console.progress("Drawing") as tell:
        write_report(path, project, populations, sieves=sieves.value, progress=tell)
    avatars = populations.avatars
    summary = {
        "report": path,
        "grains": int(populations.grains.measured.sum()),
        "avatars": 0 if avatars is None else int(avatars.measured.sum()),
        "not_measured": sum(len(reasons) for reasons in failures_of(populations).values()),
        "seconds": round(time.monotonic() - begun, 1),
    }
    if as_json:
        console.print_json(summary)
    else:
        console.print_facts(f"Report on {source.name}", summary)
