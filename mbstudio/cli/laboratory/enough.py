"""``mbstudio enough``: whether there are enough grains for a precision."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.laboratory.measured import PrecisionOption, SeedOption, measured_project
from mbstudio.cli.measure import Axes, AxesOption, GrainsOption, LimitOption, Surface, SurfaceOption

HELP = """Tell whether a project has enough grains for a precision.

For the mean size, D10, D50 and D90 by mass, and for the means of all shape factors, it gives the interval,
the precision reached, and the number of grains that the wanted one needs: after ISO 13322-1 for log-normal
sizes, and by drawing the measured grains again. The larger number counts.
"""


def enough(
    source: Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with grains.")],
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
    """Run ``mbstudio enough``; `HELP` says what it does."""
    from mbstudio.core.metrics import FACTORS
    from mbstudio.core.populations.sample_size import needed_bodies

    _, found = measured_project(
        source, grains, limit, unit, axes=axes.value, surface=surface.value, workers=workers
    )
    needs = needed_bodies(found.grains, precision, factors=FACTORS.core, seed=seed)
    rows: list[dict[str, Any]] = [
        {
            "number": need.name, "bodies": need.bodies, "value": need.found.value, "low": need.found.low,
            "high": need.found.high, "reached": need.found.half_width, "by_bootstrap": need.by_bootstrap,
            "by_lognormal": need.by_lognormal, "needed": need.needed, "enough": need.is_enough,
        }
        for need in needs
    ]  # fmt: skip
    if as_json:
        stated = {"precision": precision, "level": 0.95, "seed": seed, "unit": found.grains.unit}
        console.print_json({**stated, "needs": rows})
        return
    console.print_table(
        f"{len(found.grains)} grains of {source.name}, wanted ±{100 * precision:g} %; sizes by mass in "
        f"{found.grains.unit}, factors by number",
        ("", "value", "95 % from", "to", "reached ± %", "needed as drawn", "if log-normal", "enough"),
        [
            (row["number"], row["value"], row["low"], row["high"], 100 * row["reached"],
             row["by_bootstrap"], row["by_lognormal"], _told(row["enough"]))
            for row in rows
        ],
    )  # fmt: skip


def _told(enough: bool | None) -> str:
    return "cannot be told" if enough is None else "yes" if enough else "no"
