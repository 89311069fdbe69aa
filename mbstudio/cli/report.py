"""``mbstudio report``: grains and avatars of a project on one page."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.laboratory.measured import (
    BorderOption,
    LaboratoryOption,
    PrecisionOption,
    SeedOption,
    counts_for_border,
)
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


HELP = """Compare the grains and avatars of a project in one file with figures: HTML, PDF or JSON by its
ending.

The grains are selected as for 'mbstudio measure'. Intervals, numbers of grains needed, classes and indices of
standards, tests, porosity, methods with citations, and what is needed to repeat it stand in it.
"""


def report(
    source: Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with grains.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="File ending with .html, .pdf or .json; by default HTML."
        ),
    ] = None,
    certificate: Annotated[
        Path | None,
        typer.Option("--certificate", metavar="PDF", help="Also write a certificate on one page."),
    ] = None,
    laboratory: LaboratoryOption = None,
    border: BorderOption = False,
    precision: PrecisionOption = 0.05,
    seed: SeedOption = 0,
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
    from mbstudio.core.populations.findings import find_sizes
    from mbstudio.core.populations.laboratory import read_laboratory_table

    path = output or source.with_suffix(".html")
    for output in (path, certificate):
        require_table_output(output, source)
    tables = [read_laboratory_table(table) for table in laboratory or ()]
    begun = time.monotonic()
    project, labels = chosen_grains(source, grains, limit)
    populations = measure_grains(
        project, labels, unit=unit, axes=axes.value, surface=surface.value, detail=detail, workers=workers
    )
    from mbstudio.scene.figures.population_style import select_measured
    from mbstudio.scene.reports.certificate import write_certificate
    from mbstudio.scene.reports.population_report import write_report

    select_measured([populations.grains])
    findings = find_sizes(
        populations.grains, counts=counts_for_border(project, populations) if border else None,
        tables=tables, precision=precision, seed=seed,
    )  # fmt: skip
    with console.progress("Drawing") as tell:
        write_report(path, project, populations, sieves=sieves.value, findings=findings, progress=tell)
    if certificate is not None:
        write_certificate(certificate, project, populations, findings)
    avatars = populations.avatars
    summary = {
        "report": path,
        **({} if certificate is None else {"certificate": certificate}),
        "grains": int(populations.grains.measured.sum()),
        "avatars": 0 if avatars is None else int(avatars.measured.sum()),
        "not_measured": sum(len(reasons) for reasons in failures_of(populations).values()),
        "seconds": round(time.monotonic() - begun, 1),
    }
    if as_json:
        console.print_json(summary)
    else:
        console.print_facts(f"Report on {source.name}", summary)
