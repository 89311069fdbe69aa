"""``mbstudio grading``: sizes of the grains as a laboratory states them, beside its own table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.laboratory.measured import (
    BorderOption,
    LaboratoryOption,
    PrecisionOption,
    SeedOption,
    counts_for_border,
    measured_project,
)
from mbstudio.cli.measure import Axes, AxesOption, GrainsOption, LimitOption, Surface, SurfaceOption

if TYPE_CHECKING:
    from mbstudio.core.populations.findings import Findings

HELP = """Give the size distribution of a project's grains as a laboratory states it.

D10 to D90, C_u and C_c with 95 % intervals, classes by Wentworth, ASTM D2487 and ISO 14688, the symbol by
ASTM D2487,
flakiness, elongation and shape indices by BS 812, EN 933 and ASTM D4791. With --laboratory it compares with
the table of a sieve analysis (English or German CSV: percent passing, percent or grams retained).
"""


def grading(
    source: Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with grains.")],
    laboratory: LaboratoryOption = None,
    border: BorderOption = False,
    precision: PrecisionOption = 0.05,
    grains: GrainsOption = None,
    limit: LimitOption = None,
    unit: inputs.UnitOption = None,
    axes: AxesOption = Axes.OBB,
    surface: SurfaceOption = Surface.SMOOTHED,
    seed: SeedOption = 0,
    workers: inputs.WorkersOption = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio grading``; `HELP` says what it does."""
    from mbstudio.core.populations.findings import find_sizes
    from mbstudio.core.populations.findings_record import record_of
    from mbstudio.core.populations.laboratory import read_laboratory_table

    tables = [read_laboratory_table(path) for path in laboratory or ()]
    project, found = measured_project(
        source, grains, limit, unit, axes=axes.value, surface=surface.value, workers=workers
    )
    counts = counts_for_border(project, found) if border else None
    findings = find_sizes(found.grains, counts=counts, tables=tables, precision=precision, seed=seed)
    if as_json:
        console.print_json(record_of(findings))
    else:
        _print(findings, source.name)


def _print(findings: Findings, name: str) -> None:
    unit, curve = findings.population.unit, findings.curve
    corrected = ("corrected for the border",) if findings.is_corrected else ()
    rows: list[tuple[Any, ...]] = []
    for title, found in findings.sizes.items():
        value = getattr(curve, title) if title in ("cu", "cc") else curve.diameter(int(title[1:]))
        rows.append((title, found.value, found.low, found.high, *((value,) if corrected else ())))
    console.print_table(
        f"Sizes of {int(findings.population.measured.sum())} grains of {name} by mass in {unit}, 95 % "
        "intervals",
        ("", "value", "from", "to", *corrected), rows,
    )  # fmt: skip
    for scale, shares in findings.classes.items():
        there = [(words, share) for words, share in shares.items() if share > 0]
        console.print_table(f"Percent of the mass by {scale}", ("class", "%"), there)
    symbol, why = findings.symbol
    console.print_facts("ASTM D2487", {"symbol": symbol or "–", "because": why})
    tested = [one for one in findings.indices if one.bodies]
    if tested:
        console.print_table(
            "Indices of form, percent of the mass tested",
            ("", "standard", "%", "grains"), [(one.name, one.standard, one.percent, one.bodies) for one in
            tested], )  # fmt: skip
    else:
        print("No grain is of a size that BS 812, EN 933 or ASTM D4791 test (from 4 mm on).")
    for one in findings.against:
        print(f"{one.table.name}: {one.table.read_as}")
        console.print_table(
            f"Percent finer; the largest difference is {one.gap:+.1f} at {one.gap_at:g} mm",
            ("opening (mm)", "laboratory", "scan", "difference"),
            [
                (f"{size:g}", lab, scan, scan - lab)
                for size, lab, scan in zip(
                    one.table.curve.sizes.tolist(), one.table.curve.finer.tolist(), one.scan.finer.tolist(),
                    strict=True,
                )
            ],
        )  # fmt: skip
