"""The table of a sweep as CSV, and back."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.sweep import SweepRow

_FACTOR = "error_"
_COLUMNS = tuple(one.name for one in fields(SweepRow) if one.name not in ("errors", "error", "options"))
_LAST = ("error", "options")


def table_of(rows: Sequence[SweepRow], factors: Sequence[str]) -> list[dict[str, Any]]:
    """Return rows as flat records; the relative error of a factor is in a column ``error_...``."""
    return [
        {
            **{name: getattr(row, name) for name in _COLUMNS},
            **{f"{_FACTOR}{name}": row.errors.get(name, float("nan")) for name in factors},
            "error": row.error,
            "options": json.dumps(dict(row.options), default=asdict),
        }
        for row in rows
    ]


def write_sweep(path: Path, rows: Sequence[SweepRow]) -> None:
    """Write rows as CSV, replacing the file as a whole.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    from mbstudio.core.metrics import CORE_FACTORS
    from mbstudio.core.project.replacement import replacing

    columns = [*_COLUMNS, *(f"{_FACTOR}{name}" for name in CORE_FACTORS), *_LAST]
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns)
        writer.writeheader()
        writer.writerows(table_of(rows, CORE_FACTORS))


def read_sweep(path: Path) -> list[SweepRow]:
    """Read the rows that :func:`write_sweep` wrote.

    Raises
    ------
    FitError
        If the file is no table of a sweep.
    OSError
        If it cannot be read.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            return [_row_of(cells) for cells in csv.DictReader(stream)]
    except (KeyError, ValueError, TypeError, csv.Error) as error:
        raise FitError(
            f"{path} is no table of a sweep ({type(error).__name__}: {error}): give another file."
        ) from error


def joined(rows: Sequence[SweepRow], earlier: Sequence[SweepRow]) -> list[SweepRow]:
    """Return rows, then those of an earlier table that they do not replace."""

    def key(row: SweepRow) -> tuple[Any, ...]:
        return row.label, row.n, row.method, row.seed, json.dumps(dict(row.options), default=asdict)

    replaced = {key(row) for row in rows}
    return [*rows, *(row for row in earlier if key(row) not in replaced)]


def _row_of(cells: dict[str, str]) -> SweepRow:
    numbers = ("loss", "rms", "volume_error", "iou", "hausdorff", "seconds")
    errors = {
        name.removeprefix(_FACTOR): float(text) for name, text in cells.items() if name.startswith(_FACTOR)
    }
    if cells["valid"] not in ("True", "False"):
        raise ValueError(f"valid is '{cells['valid']}'")
    return SweepRow(
        label=int(cells["label"]),
        name=cells["name"],
        n=int(cells["n"]),
        method=cells["method"],  # type: ignore[arg-type]
        seed=int(cells["seed"]),
        **{name: float(cells[name]) for name in numbers},
        # A row whose factors were not defined has none, rather than unknown ones.
        errors={name: value for name, value in errors.items() if value == value},
        valid=cells["valid"] == "True",
        error=cells["error"],
        options=json.loads(cells["options"]),
    )
