"""What the commands make of measured populations: rows, intervals, summaries and tables on the disk."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.cli import console
from mbstudio.core.errors import MbstudioError

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.metrics.bodies import VoxelSurface
    from mbstudio.core.metrics.measuring import AxisConvention
    from mbstudio.core.populations import Population
    from mbstudio.core.project import Project
    from mbstudio.core.project.measuring import ProjectPopulations

Row = dict[str, Any]

MOST_SHOWN = 3
"""Grains whose intervals are printed; those of more stand in the files."""


def measure_grains(
    project: Project,
    labels: list[int],
    *,
    unit: str | None = None,
    axes: AxisConvention = "obb",
    surface: VoxelSurface = "smoothed",
    detail: bool = False,
    workers: int | None = None,
) -> ProjectPopulations:
    """Measure grains and their avatars, showing how far it has come."""
    from mbstudio.core.project.measuring import measure_project

    with console.progress("Measuring") as report:
        return measure_project(
            project,
            labels,
            unit=unit,
            axes=axes,
            surface=surface,
            detail=detail,
            workers=workers,
            progress=report,
        )


def rows_of(populations: ProjectPopulations, project: Project) -> list[Row]:
    """Return one row a grain.

    A row holds ``label``, ``unit``, ``axes``, of grains of meshes their ``name``, and, where measured,
    ``grain`` and ``avatar`` (their factors and ``warning``) and ``relative_error`` (avatar over grain,
    minus one).
    """
    rows: list[Row] = []
    grains, avatars = populations.grains, populations.avatars
    places = {} if avatars is None else {int(label): place for place, label in enumerate(avatars.labels)}
    for place, label in enumerate(grains.labels.tolist()):
        row: Row = {"label": label, "unit": grains.unit, "axes": grains.axes}
        if project.grains is not None and project.grains.is_of_meshes:
            row["name"] = project.grains.name_of(label)
        if grains.measured[place]:
            row["grain"] = _body(grains, place)
        if avatars is not None and label in places and avatars.measured[places[label]]:
            row["avatar"] = _body(avatars, places[label])
        if "grain" in row and "avatar" in row:
            row["relative_error"] = {
                name: _relative_error(row["avatar"][name], row["grain"][name]) for name in grains.factors
            }
        rows.append(row)
    return rows


def failures_of(populations: ProjectPopulations) -> dict[str, dict[int, str]]:
    """Return why bodies could not be measured, by kind and label."""
    given = (populations.grains, populations.avatars)
    return {population.kind: population.failures for population in given if population is not None}


def _body(population: Population, place: int) -> dict[str, Any]:
    factors = {name: float(column[place]) for name, column in population.factors.items()}
    return {**factors, "warning": population.warnings[place]}


def _relative_error(avatar: float, grain: float) -> float:
    return avatar / grain - 1 if grain else float("nan")


def summarise(rows: list[Row]) -> dict[str, dict[str, float | None]]:
    """Return medians over the grains: of the grains, of the avatars, and of the absolute error."""
    import numpy as np

    names = next((list(row["grain"]) for row in rows if "grain" in row), [])

    def median(key: str, name: str) -> float | None:
        values = np.array([abs(row[key][name]) for row in rows if key in row])
        values = values[np.isfinite(values)]
        return float(np.median(values)) if len(values) else None

    return {
        name: {
            "grain": median("grain", name),
            "avatar": median("avatar", name),
            "error": median("relative_error", name),
        }
        for name in names
        if name != "warning"
    }


def table_of(populations: ProjectPopulations, project: Project) -> pd.DataFrame:
    """Return one row a grain as a table: factors, their unit in the column, and what went wrong."""
    import numpy as np

    from mbstudio.core.metrics import FACTORS

    grains, avatars = populations.grains, populations.avatars
    frame = grains.table().drop(columns=["unit", "axes"]).set_index("label").add_prefix("grain_")
    if avatars is not None:
        right = avatars.table().drop(columns=["unit", "axes"]).set_index("label").add_prefix("avatar_")
        valid = {label: project.fits[label].verdict for label in avatars.labels.tolist()}
        right["avatar_valid"] = [valid[label].valid for label in right.index]
        right["avatar_not_valid"] = [" ".join(valid[label].reasons) for label in right.index]
        frame = frame.join(right)
        for name, column in ((name, FACTORS[name].column(grains.unit)) for name in grains.factors):
            with np.errstate(divide="ignore", invalid="ignore"):
                errors = frame[f"avatar_{column}"] / frame[f"grain_{column}"] - 1
            frame[f"relative_error_{name}"] = errors.where(np.isfinite(errors))
    if project.grains is not None and project.grains.is_of_meshes:
        frame.insert(0, "name", [project.grains.name_of(int(label)) for label in frame.index])
    frame.insert(0, "axes", grains.axes)
    frame.insert(0, "unit", grains.unit)
    return frame.reset_index()


def require_parquet() -> None:
    """Refuse Parquet where nothing can write it, before the work begins."""
    from importlib.util import find_spec

    if find_spec("pyarrow") is None:
        raise MbstudioError(
            "Parquet files need pyarrow, which is not installed: run pip install 'mbstudio[parquet]', "
            "or write the table with --csv."
        )


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table as CSV; what is not a number is an empty cell."""
    from mbstudio.core.replacement import replacing

    with replacing(path) as temporary:
        table.to_csv(temporary, index=False, lineterminator="\r\n", encoding="utf-8")


def write_parquet(path: Path, table: pd.DataFrame) -> None:
    """Write a table as Parquet."""
    from mbstudio.core.replacement import replacing

    require_parquet()
    with replacing(path) as temporary:
        table.to_parquet(temporary, index=False, engine="pyarrow")


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
    if measured and project.state.segmentation is not None:
        console.tell(
            "mbstudio: the intervals are those of the labels as they are. What finding the grains in the "
            "scan did to them is not in: for grains that touch that is several times more. Volumes of a "
            "twin ('mbstudio twin') are nearer to the truth."
        )
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
