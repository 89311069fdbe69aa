"""Tables of sieve analyses and of dynamic image analysis, as laboratories write them."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError, UnitError
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.core.units import conversion_factor

MOST_BYTES = 4_000_000
_TOLERANCE = 1.0
"""Percent by which sums may miss 100: EN 933-1 and ISO 2591-1 repeat an analysis that lost more."""

# What columns are called in English and German, without accents and signs.
_SIZE = ("size", "sieve", "opening", "aperture", "diameter", "mesh size", "sieb", "maschenweite", "korn",
         "durchmesser", "xc_min", "x_c", "groesse", "grosse", "oeffnung", "offnung")  # fmt: skip
_PASSING = ("passing", "finer", "undersize", "cumulative", "cum", "q3", "durchgang", "unterkorn",
            "summendurchgang", "kumuliert", "passant")  # fmt: skip
_RETAINED = ("retained", "mass", "weight", "ruckstand", "rueckstand", "masse",
             "einwaage", "p3", "auflage")  # fmt: skip
_COARSER = ("oversize", "summenruckstand", "summenrueckstand", "1 q3", "oberkorn")
_SUMMED = ("cum", "summen", "kumul", "total")
_PAN = ("pan", "boden", "schale", "auffang", "rest", "<")
_SUM = ("total", "sum", "summe", "gesamt")


@dataclass(frozen=True, eq=False)
class LaboratoryCurve:
    """A measured size distribution.

    Attributes
    ----------
    name : str
        Of the file.
    curve : SizeDistribution
        Percent finer by mass at the openings, in mm.
    read_as : str
        How the table was understood, in a sentence: column, unit, kind of numbers.
    mass : float or None
        Total mass in grams; None where the table gives percents.
    """

    name: str
    curve: SizeDistribution
    read_as: str
    mass: float | None


def read_laboratory_table(path: Path, *, unit: str | None = None) -> LaboratoryCurve:
    """Read a table of sieve openings and masses: percent passing, percent or grams retained.

    The columns are known by their titles (English or German), commas and points by how the numbers are
    written.
    A table of retained masses may have a row for the pan, and one for the total that is compared with the
    sum.

    Parameters
    ----------
    path : Path
        CSV with semicolons, tabs or commas.
    unit : str, optional
        Of the sizes, where their title does not say it; mm by default.

    Raises
    ------
    MeasureError
        If the file cannot be read or understood, grams and percents are mixed, a column does not rise or
        fall as it must, or masses do not add up.
    UnitError
        If the unit is no length.
    """
    return parse_laboratory_table(_read_text(path), path.name, unit=unit)


def parse_laboratory_table(text: str, name: str = "table", *, unit: str | None = None) -> LaboratoryCurve:
    """Return the curve of a table that was read; see `read_laboratory_table`."""
    rows = _split(text, name)
    head, place = _find_head(rows, name)
    sizes_at = _column_of(head, _SIZE, name, "sizes")
    kind, masses_at = _kind_of(head, sizes_at, name)
    sizes, masses, pan, total = _numbers(rows[place + 1 :], sizes_at, masses_at, name)
    found_unit = _unit_of(head[sizes_at]) or unit or "mm"
    sizes = sizes * conversion_factor(found_unit, "mm")
    grams = _is_in_grams(head[masses_at], masses, pan, kind, name)
    order = np.argsort(sizes, kind="stable")
    sizes, masses = sizes[order], masses[order]
    if (sizes <= 0).any() or len(np.unique(sizes)) < len(sizes):
        raise MeasureError(f"{name}: the openings must be positive and each given once.")
    if kind == "retained":
        finer, mass = _finer_of_retained(masses, pan, total, grams, name)
    else:
        finer, mass = _finer_of_sums(masses, kind, name), None
    what = {
        "passing": "percent passing",
        "coarser": "percent retained in sum",
        "retained": "retained on each sieve",
    }
    words = f"'{head[sizes_at]}' in {found_unit}; '{head[masses_at]}' as {what[kind]}"
    words += " in grams" if grams else " in percent" if kind == "retained" else ""
    return LaboratoryCurve(name, SizeDistribution(sizes, finer, "mm", "laboratory"), words + ".", mass)


def largest_gap(curve: SizeDistribution, other: SizeDistribution) -> tuple[float, float]:
    """Return the largest difference of two curves (percent finer, other less curve), and the size of it.

    Both are read at the openings of `curve` that lie within the sizes of both.

    Raises
    ------
    MeasureError
        If the sizes do not meet.
    """
    at = curve.sizes
    theirs = np.interp(
        np.log(at),
        np.log(other.sizes * conversion_factor(other.unit, curve.unit)),
        other.finer,
        left=0.0 if not other.sieves else np.nan,
        right=100.0 if not other.sieves else np.nan,
    )
    gaps = theirs - curve.finer
    if not np.isfinite(gaps).any():
        raise MeasureError("The two curves have no size in common: check the unit of the table.")
    place = int(np.nanargmax(np.abs(gaps)))
    return float(gaps[place]), float(at[place])


def _read_text(path: Path) -> str:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise MeasureError(
                f"{path} is larger than {MOST_BYTES // 1_000_000} MB: that is no table of sieves."
            )
        data = path.read_bytes()
    except OSError as error:
        raise MeasureError(f"{path} cannot be read: {error.strerror or error}.") from error
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encodings: Sequence[str] = ("utf-16",)
    else:
        encodings = ("utf-8-sig", "cp1252")
    for encoding in encodings:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise MeasureError(f"{path} is no text: export the table as CSV.")


def _split(text: str, name: str) -> list[list[str]]:
    lines = [line for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n") if line.strip()]
    if not lines:
        raise MeasureError(f"{name} is empty.")
    mark = max((";", "\t", ","), key=lambda sign: (sum(sign in line for line in lines), sign != ","))
    return [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=mark)]


def _plain(words: str) -> str:
    table = str.maketrans({"ä": "a", "ö": "o", "ü": "u", "ß": "ss", "-": " "})
    return re.sub(r"\s+", " ", words.lower().translate(table)).strip()


def _find_head(rows: list[list[str]], name: str) -> tuple[list[str], int]:
    for place, row in enumerate(rows[:60]):
        words = [_plain(cell) for cell in row]
        if len(row) > 1 and any(_is_called(w, _SIZE) for w in words) and any(
            _is_called(w, (*_PASSING, *_RETAINED, *_COARSER)) for w in words
        ):  # fmt: skip
            return row, place
    raise MeasureError(
        f"{name} has no row of titles that names a size and a mass: call the columns 'size (mm)' and "
        "'passing (%)', 'retained (%)' or 'retained (g)'."
    )


def _is_called(words: str, names: Sequence[str]) -> bool:
    return any(one in words for one in names)


def _column_of(head: list[str], names: Sequence[str], name: str, what: str) -> int:
    for place, cell in enumerate(head):
        if _is_called(_plain(cell), names) and not _is_mass(_plain(cell)):
            return place
    raise MeasureError(f"{name} has no column of {what}: call it 'size (mm)'.")


def _is_mass(words: str) -> bool:
    """Return whether words name a mass though they name a sieve too, as Siebdurchgang does."""
    return _is_called(words, (*_PASSING, *_RETAINED, *_COARSER))


def _kind_of(head: list[str], sizes_at: int, name: str) -> tuple[str, int]:
    others = [(place, _plain(cell)) for place, cell in enumerate(head) if place != sizes_at]
    for kind, names in (("coarser", _COARSER), ("passing", _PASSING), ("retained", _RETAINED)):
        for place, words in others:
            is_retained = _is_called(words, _RETAINED) and not _is_called(
                words, ("passing", "finer", "durchgang")
            )
            if kind == "coarser" and is_retained and _is_called(words, _SUMMED):
                return kind, place
            if _is_called(words, names) and not (kind == "passing" and is_retained):
                return kind, place
    raise MeasureError(f"{name} has no column of masses: call it 'passing (%)' or 'retained (g)'.")


def _unit_of(title: str) -> str | None:
    found = re.search(r"[\[(/]\s*(nm|[uµμ]m|mm|cm|m|in|inch)\s*[\])]?\s*$", title.strip())
    if found is None:
        return None
    unit = found.group(1).replace("µ", "u").replace("μ", "u")
    if unit in ("in", "inch"):
        raise UnitError("Sizes in inches are not read: give them in mm.")
    return unit


def _is_in_grams(title: str, masses: np.ndarray, pan: float | None, kind: str, name: str) -> bool:
    words = _plain(title)
    grams = re.search(r"[\[(/ ]\s*(k?g|gramm?s?)\s*[\])]?\s*$", words) is not None
    percent = "%" in words or "percent" in words or "prozent" in words
    if grams and percent:
        raise MeasureError(f"{name}: the column '{title}' names grams and percent: give one of them.")
    if kind != "retained":
        if grams:
            raise MeasureError(
                f"{name}: '{title}' gives sums in grams, of which the total is not known: give percent."
            )
        return False
    if not grams and not percent:
        total = float(masses.sum()) + (pan or 0.0)
        if abs(total - 100.0) > _TOLERANCE:
            raise MeasureError(
                f"{name}: the column '{title}' says neither grams nor percent, and its sum is {total:.1f}: "
                "write (g) or (%) into its title."
            )
    return grams


def _number(cell: str, name: str, row: int) -> float:
    text = cell.replace("\u00a0", "").replace(" ", "").rstrip("%")
    text = re.sub(r"(mm|µm|um|μm|g)$", "", text)
    if "," in text and "." in text:
        # The last of the two is the decimal mark, the other sets thousands apart.
        thousands = "." if text.rfind(",") > text.rfind(".") else ","
        text = text.replace(thousands, "")
    text = text.replace(",", ".")
    try:
        value = float(text)
    except ValueError as error:
        raise MeasureError(f"{name}, row {row}: '{cell}' is not a number.") from error
    if not np.isfinite(value):
        raise MeasureError(f"{name}, row {row}: '{cell}' is not finite.")
    return value


def _numbers(
    rows: list[list[str]], sizes_at: int, masses_at: int, name: str
) -> tuple[np.ndarray, np.ndarray, float | None, float | None]:
    sizes, masses = [], []
    pan = total = None
    for place, row in enumerate(rows, 1):
        if (
            len(row) <= max(sizes_at, masses_at)
            or not row[masses_at]
            or not (row[sizes_at] or row[masses_at])
        ):
            if any(row):
                raise MeasureError(f"{name}, row {place}: the size or the mass is missing.")
            continue
        words = _plain(row[sizes_at])
        mass = _number(row[masses_at], name, place)
        if mass < 0:
            raise MeasureError(f"{name}, row {place}: a mass of {mass:g} is negative.")
        if _is_called(words, _SUM):
            total = mass
        elif any(words.startswith(one) for one in _PAN):
            pan = (pan or 0.0) + mass
        else:
            sizes.append(_number(row[sizes_at], name, place))
            masses.append(mass)
    if sizes and 0.0 in sizes and pan is None:  # a sieve of no opening is the pan
        pan = masses.pop(sizes.index(0.0))
        sizes.remove(0.0)
    if len(sizes) < 2:
        raise MeasureError(f"{name} has {len(sizes)} sieves: a curve needs at least two.")
    return np.array(sizes), np.array(masses), pan, total


def _finer_of_retained(
    masses: Float[np.ndarray, " sieves"], pan: float | None, total: float | None, grams: bool, name: str
) -> tuple[Float[np.ndarray, " sieves"], float | None]:
    whole = float(masses.sum()) + (pan or 0.0)
    stated = total if total is not None else None if grams else 100.0
    if not whole > 0:
        raise MeasureError(f"{name}: all masses are zero.")
    if stated is not None and abs(whole - stated) > _TOLERANCE / 100.0 * stated:
        unit = "g" if grams else "%"
        raise MeasureError(
            f"{name}: the masses add up to {whole:.4g} {unit}, not to {stated:.4g} {unit}: a row is missing "
            "(the pan?), or grams and percent are mixed."
        )
    below = np.concatenate([[pan or 0.0], masses])
    finer = 100.0 * np.cumsum(below)[:-1] / whole
    return finer, whole if grams else None


def _finer_of_sums(sums: Float[np.ndarray, " sieves"], kind: str, name: str) -> Float[np.ndarray, " sieves"]:
    finer = 100.0 - sums if kind == "coarser" else sums
    if float(finer.max()) <= 1.0 and float(finer.max()) > 0 and kind == "passing":
        finer = 100.0 * finer  # Q3 as a share
    if (finer < -1e-9).any() or (finer > 100.0 + 1e-9).any():
        raise MeasureError(
            f"{name}: percents finer of {finer.min():.4g} to {finer.max():.4g} lie outside 0 to 100: "
            "are these grams?"
        )
    if (np.diff(finer) < -1e-9).any():
        place = int(np.argmax(np.diff(finer) < -1e-9))
        raise MeasureError(
            f"{name}: the percent finer falls from {finer[place]:.4g} to {finer[place + 1]:.4g} at larger "
            "openings: it must rise."
        )
    if float(finer.max()) < 50.0:
        raise MeasureError(
            f"{name}: only {finer.max():.3g} % pass the coarsest sieve: are these percents retained?"
        )
    return np.clip(finer, 0.0, 100.0)
