"""Intervals of the factors of scanned grains, as ``mbstudio measure --intervals`` shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mbstudio.cli import console

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.cli.measuring import Row
    from mbstudio.core.metrics.bodies import VoxelSurface
    from mbstudio.core.metrics.measuring import AxisConvention
    from mbstudio.core.project import Project

MOST_SHOWN = 3
"""Grains whose intervals are printed; those of more stand in the files."""


def add_intervals(
    rows: list[Row],
    project: Project,
    *,
    axes: AxisConvention,
    surface: VoxelSurface,
    detail: bool,
    unit: str | None,
) -> None:
    """Add ``interval`` to each row with a measured grain: factor -> (low, high), in the row's unit.

    A grain that has none, because it is too small for it, keeps its row; the message says why.
    """
    from mbstudio.core.errors import MeasureError
    from mbstudio.core.metrics import factor_intervals

    measured = [row for row in rows if "grain" in row]
    with console.progress("Finding intervals") as report:
        for place, row in enumerate(measured):
            report(place / len(measured), f"{place} of {len(measured)} grains")
            grain = project.grains.grain(row["label"])  # type: ignore[union-attr]
            try:
                found = factor_intervals(grain, unit=unit, axes=axes, surface=surface, detail=detail)
            except MeasureError as error:
                console.tell(f"mbstudio: grain {row['label']} has no intervals: {error}")
                continue
            row["interval"] = {name: tuple(bounds) for name, bounds in found.intervals.items()}


def with_intervals(table: pd.DataFrame, rows: list[Row], unit: str) -> pd.DataFrame:
    """Return the table with the columns ``grain_..._low`` and ``grain_..._high`` of every factor."""
    from mbstudio.core.metrics import FACTORS

    found = {row["label"]: row["interval"] for row in rows if "interval" in row}
    names: list[str] = list(next(iter(found.values()), ()))
    extra: dict[str, Any] = {}
    for name in names:
        for side, word in enumerate(("low", "high")):
            extra[f"grain_{FACTORS[name].column(unit)}_{word}"] = [
                found[label][name][side] if label in found else float("nan") for label in table["label"]
            ]
    return table.assign(**extra)


def print_intervals(rows: list[Row]) -> None:
    """Print factor by factor the value of a grain, its interval, and the value of its avatar."""
    shown = [row for row in rows if "interval" in row]
    for row in shown[:MOST_SHOWN]:
        avatar, error = row.get("avatar", {}), row.get("relative_error", {})
        console.print_table(
            f"Grain {row['label']}, lengths in {row['unit']}",
            ("factor", "grain", "from", "to", "avatar", "error %"),
            [
                (name, row["grain"][name], low, high, avatar.get(name), _percent(error.get(name)))
                for name, (low, high) in row["interval"].items()
            ],
        )
    if len(shown) > MOST_SHOWN:
        console.tell(
            f"mbstudio: {len(shown) - MOST_SHOWN} more grains have intervals: "
            "write the table with --csv to see all."
        )


def _percent(error: float | None) -> float | None:
    return None if error is None else 100 * error
