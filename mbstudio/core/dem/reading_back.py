"""What validators share: text, rows of numbers and stated values read back, refused where they are off."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import ExportError

_WORDS = {2: "two", 3: "three", 4: "four", 5: "five", 9: "nine"}


def read_text(path: Path) -> str:
    """Return the text of a file; ExportError if it cannot be read or is not plain ASCII."""
    try:
        return path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error


def read_lines(path: Path) -> list[str]:
    """Return the lines of a file without those that are empty, stripped."""
    return [line.strip() for line in read_text(path).splitlines() if line.strip()]


def number_rows(
    path: Path, lines: Sequence[str], columns: int, separator: str | None = None
) -> Float[np.ndarray, "rows columns"]:
    """Return lines of numbers as rows.

    Parameters
    ----------
    path : Path
        For messages.
    lines : sequence of str
    columns : int
        How many numbers each line must hold.
    separator : str, optional
        Between the numbers; None for blanks.

    Raises
    ------
    ExportError
        If a line holds anything else, or a number that is not finite.
    """
    rows = []
    for line in lines:
        try:
            row = [float(part) for part in line.split(separator)]
        except ValueError:
            row = []
        if len(row) != columns:
            raise ExportError(
                f"{path} has the line '{line}', which is not {_WORDS.get(columns, columns)} numbers."
            )
        rows.append(row)
    table = np.array(rows, dtype=float).reshape(-1, columns)
    if not np.isfinite(table).all():
        raise ExportError(f"{path} has numbers that are not finite.")
    return table


def agrees(
    values: Sequence[str], wanted: Sequence[str | float], tolerance: float = 1e-7, zero: float = 0.0
) -> bool:
    """Return whether words say what is wanted: texts exactly, numbers to a relative tolerance.

    Parameters
    ----------
    values : sequence of str
    wanted : sequence of str or float
    tolerance : float
        Relative.
    zero : float
        What counts as nothing, absolute: for numbers that stand beside larger ones.
    """
    if len(values) != len(wanted):
        return False
    for value, target in zip(values, wanted, strict=True):
        if isinstance(target, str):
            if value != target:
                return False
            continue
        try:
            number = float(value)
        except ValueError:
            return False
        if not abs(number - target) <= tolerance * abs(target) + zero:
            return False
    return True


def require_agreement(
    path: Path, what: str, values: Sequence[str], wanted: Sequence[str | float], tolerance: float = 1e-7
) -> None:
    """Raise ExportError unless words say what the manifest says; numbers near nothing beside large ones pass.

    Parameters
    ----------
    path : Path
    what : str
        Name of the value in the message.
    values, wanted : sequences
    tolerance : float
        Relative.
    """
    numbers = [abs(float(value)) for value in wanted if not isinstance(value, str)]
    if not agrees(values, wanted, tolerance, 1e-12 * max(numbers, default=0.0)):
        said = " ".join(map(str, wanted))
        raise ExportError(f"{path} has {what} {' '.join(values)}; the manifest says {said}.")
