"""The order of slices by the numbers in their names, and what is wrong with it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from mbstudio.core.errors import ScanError

# A sign belongs to the number if no letter or digit stands before it: in "z_-5", not in "slice-005".
_NUMBER = re.compile(r"(?:(?<![A-Za-z0-9])[-+])?\d+")
# Where some names have a sign and some have none ("z-1", "z0"), it is one everywhere.
_SIGNED_NUMBER = re.compile(r"[-+]?\d+")
# So many files that are of another name are told by name and left out; more are a second series.
_FEW = 3


@dataclass(frozen=True)
class SliceOrder:
    """Files that are the slices of one scan.

    Attributes
    ----------
    files : tuple of Path
        In the order of their numbers.
    left_out : tuple of Path
        Images that are none of the slices.
    notes : tuple of str
        What was taken for granted.
    """

    files: tuple[Path, ...]
    left_out: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return a sorting key in which ``slice2`` comes before ``slice10``."""
    parts = re.split(r"(\d+)", name.lower())
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]


def order_slices(images: Sequence[Path], folder: Path) -> SliceOrder:
    """Put the images of a folder in the order of their numbers.

    Raises
    ------
    ScanError
        If they are two series, numbers are missing or occur twice, or images have names of other
        kinds than the rest.
    """
    by_name = sorted(images, key=lambda file: (natural_key(file.stem), file.name))
    if len(by_name) == 1:
        return SliceOrder(tuple(by_name))
    number = _NUMBER
    series = _series(by_name, number)
    if len(series) > 1:
        signed = _series(by_name, _SIGNED_NUMBER)
        if len(signed) < len(series):
            number, series = _SIGNED_NUMBER, signed
    numbered = {name: files for name, files in series.items() if "#" in name}
    if not numbered:
        note = f"contains slices without numbers, taken in the order of their names, {_run(by_name)}."
        return SliceOrder(tuple(by_name), notes=(note,))
    largest = max(series, key=lambda name: len(series[name]))
    rest = [file for name, files in series.items() if name != largest for file in files]
    if "#" not in largest or (rest and (len(rest) > _FEW or len(rest) >= len(series[largest]))):
        kinds = "; ".join(f"{len(files)} like {files[0].name}" for files in list(series.values())[:5])
        raise ScanError(
            f"The folder {folder} contains images with {len(series)} kinds of names ({kinds}): "
            "keep the slices of one scan in a folder of their own."
        )
    files, notes = _numbered(series[largest], folder, number)
    return SliceOrder(tuple(files), tuple(rest), notes)


def _series(files: Sequence[Path], number: re.Pattern[str]) -> dict[str, list[Path]]:
    """Return the files by their names without the numbers."""
    series: dict[str, list[Path]] = {}
    for file in files:
        series.setdefault(number.sub("#", file.stem).lower(), []).append(file)
    return series


def _numbered(files: list[Path], folder: Path, number: re.Pattern[str]) -> tuple[list[Path], tuple[str, ...]]:
    """Return files whose names differ in numbers alone in their order; ScanError on gaps and doubles."""
    if len(files) == 1:
        return files, ()
    rows = [[int(word) for word in number.findall(file.stem)] for file in files]
    changing = [column for column in range(len(rows[0])) if len({row[column] for row in rows}) > 1]
    if not changing:
        raise ScanError(
            f"The folder {folder} contains slices with the same number ({files[0].name}, {files[1].name}): "
            "keep one image of each slice."
        )
    positions = _decimal_positions(files, changing, number)
    if positions is None:
        column = _counter(rows, changing, files, folder)
        positions = [float(row[column]) for row in rows]
    order = sorted(range(len(files)), key=lambda index: positions[index])
    files, places = [files[index] for index in order], [positions[index] for index in order]
    return files, _require_even(files, places, folder)


def _decimal_positions(
    files: Sequence[Path], changing: Sequence[int], number: re.Pattern[str]
) -> list[float] | None:
    """Return heights such as 9.5 and 10.0 in the names, None where there are none."""
    if len(changing) != 2 or changing[1] != changing[0] + 1:
        return None
    positions = []
    for file in files:
        found = list(number.finditer(file.stem))
        first, second = found[changing[0]], found[changing[1]]
        if file.stem[first.end() : second.start()] != ".":
            return None
        positions.append(float(file.stem[first.start() : second.end()]))
    return positions


def _counter(rows: list[list[int]], changing: list[int], files: Sequence[Path], folder: Path) -> int:
    """Return which number counts the slices."""
    if len(changing) == 1:
        return changing[0]
    distinct = [column for column in changing if len({row[column] for row in rows}) == len(rows)]
    if not distinct:
        column = max(changing, key=lambda column: len({row[column] for row in rows}))
        others = [other for other in changing if other != column]
        groups = {tuple(row[other] for other in others) for row in rows}
        raise ScanError(
            f"The folder {folder} contains {len(groups)} or more series of slices "
            f"({files[0].name} and {files[-1].name} differ in more than one number): "
            "keep the slices of one scan in a folder of their own."
        )
    if len(changing) > 1 and len(distinct) < len(changing):
        # Two numbers change, and one of them repeats: the other must count through all the same.
        column = distinct[-1]
        steps = _steps(sorted(row[column] for row in rows))
        if len(set(steps)) > 1:
            raise ScanError(
                f"The folder {folder} contains slices whose names differ in {len(changing)} numbers "
                f"({files[0].name}, {files[-1].name}): keep the slices of one scan in a folder of their own."
            )
        return column
    # Of several that all differ (a time beside a counter), the one that counts evenly.
    return min(distinct, key=lambda column: len(set(_steps(sorted(row[column] for row in rows)))))


def _steps(numbers: Sequence[float]) -> list[float]:
    return [round(after - before, 9) for before, after in pairwise(numbers)]


def _require_even(files: Sequence[Path], positions: Sequence[float], folder: Path) -> tuple[str, ...]:
    """Raise ScanError if numbers are missing or doubled; return a note where they are not every one."""
    steps = _steps(positions)
    for index, step in enumerate(steps):
        if step == 0:
            raise ScanError(
                f"The folder {folder} contains two slices with the same number ({files[index].name} and "
                f"{files[index + 1].name}): keep one of them."
            )
    counts = Counter(steps)
    usual = min(step for step, count in counts.items() if count == max(counts.values()))
    tolerance = 1e-6 * max(abs(position) for position in (*positions, 1.0)) if usual != int(usual) else 0.0
    gaps = [index for index, step in enumerate(steps) if abs(step - usual) > tolerance]
    if gaps:
        told = "; ".join(
            f"between {files[index].name} and {files[index + 1].name}"
            + (f" ({round(steps[index] / usual) - 1} missing)" if steps[index] > usual else "")
            for index in gaps[:3]
        )
        more = f" and at {len(gaps) - 3} more places" if len(gaps) > 3 else ""
        raise ScanError(
            f"The folder {folder} has gaps in the numbers of its slices {told}{more}: copy the missing "
            "slices, "
            "or renumber the slices if none are missing."
        )
    if usual != 1 and usual == int(usual) and len(files) > 2:
        return (
            f"numbers its slices in steps of {int(usual)} ({files[0].name}, {files[1].name}): if only every "
            f"{int(usual)}th slice was kept, state the distance between slices, as in '28 x 14 x 14 um' "
            "(z, y, x).",
        )
    return ()


def _run(files: Sequence[Path]) -> str:
    return f"from {files[0].name} to {files[-1].name}"
