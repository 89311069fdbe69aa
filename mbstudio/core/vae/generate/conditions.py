"""What clones are asked to be like: ranges, means and distributions of factors, and sieve curves."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Float64

from mbstudio.core.errors import GenerationError, UnitError
from mbstudio.core.goals import UNSIGNED, spell_measure, split_sentence
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.units import METRES_PER_UNIT, conversion_factor, parse_unit

MEAN_TOLERANCE = 0.005
"""A mean asked for is met to half a percent of it, with few clones to their deviation over their number."""

DEVIATION_TOLERANCE = 0.03
"""A standard deviation asked for is met to three percent of it, with few clones to one over their number."""

CURVE_TOLERANCE = 1.0
"""A point of a curve is met to one percentage point, or to half the share of the largest clone."""

SIEVE_SIZE = "intermediate"
"""The factor that a sieve sorts by."""

_NUMBER = rf"[+-]?{UNSIGNED}"
_QUANTITY = re.compile(rf"^\s*({_NUMBER})\s*([^\d\s.²³]*)\s*\^?([23²³]?)\s*$")
_POWERS = {"": 1, "2": 2, "²": 2, "3": 3, "³": 3}
_PERCENTILE = re.compile(r"^[dD](\d{1,2})$")
_HOW = (
    "write sphericity=0.75..0.8, sphericity=0.78, sphericity=0.78+-0.02, D50=0.4 mm, "
    "sphericity=0.7:10,0.8:60 or sieve=0.3:10,0.4:55,0.6:100 mm"
)


@dataclass(frozen=True)
class Reached:
    """How closely clones came to one figure that was asked for.

    Attributes
    ----------
    what : str
        The figure in words.
    wanted, found : float
        In the factor's unit, or in percent.
    is_met : bool
        Whether within the tolerance.
    """

    what: str
    wanted: float
    found: float
    is_met: bool

    def as_record(self) -> dict[str, Any]:
        """Return the figure as project files and JSON output hold it."""
        return {"what": self.what, "wanted": self.wanted, "found": self.found, "met": self.is_met}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Reached:
        """Return the figure of a record.

        Raises
        ------
        KeyError
            If something is missing from the record.
        """
        return cls(record["what"], record["wanted"], record["found"], record["met"])


@dataclass(frozen=True)
class FactorRange:
    """Every clone's factor lies from `low` to `high` (infinite where open), in the unit of the parents."""

    factor: str
    low: float
    high: float
    unit: str

    def admits(self, values: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Return which values lie in the range."""
        return (values >= self.low) & (values <= self.high)

    def rows(
        self, values: Float[np.ndarray, " n"], volumes: Float[np.ndarray, " n"]
    ) -> Float64[np.ndarray, "n 0"]:
        """Return no constraint on sums: a range is met body by body."""
        return np.empty((len(values), 0))

    def reached(
        self, values: Float[np.ndarray, " n"], volumes: Float[np.ndarray, " n"]
    ) -> tuple[Reached, ...]:
        """Return the least and the largest value against the range."""
        found = []
        if np.isfinite(self.low):
            least = float(values.min())
            found.append(Reached(f"least {self.factor}", self.low, least, least >= self.low))
        if np.isfinite(self.high):
            largest = float(values.max())
            found.append(Reached(f"largest {self.factor}", self.high, largest, largest <= self.high))
        return tuple(found)

    def __str__(self) -> str:
        ends = ("" if not np.isfinite(end) else f"{end:.4g}" for end in (self.low, self.high))
        return f"{self.factor} = {'..'.join(ends)}{_unit_words(self.factor, self.unit)}"


@dataclass(frozen=True)
class FactorMoments:
    """The clones' mean of a factor, and their standard deviation if stated, in the unit of the parents."""

    factor: str
    mean: float
    deviation: float | None
    unit: str

    def admits(self, values: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Return that every body may be taken."""
        return np.ones(len(values), dtype=bool)

    def rows(
        self, values: Float[np.ndarray, " n"], volumes: Float[np.ndarray, " n"]
    ) -> Float64[np.ndarray, "n moments"]:
        """Return what is to be zero on average."""
        away = values - self.mean
        columns = [away]
        if self.deviation is not None:
            columns.append(away**2 - self.deviation**2)
        return np.stack(columns, axis=1)

    def reached(
        self, values: Float[np.ndarray, " n"], volumes: Float[np.ndarray, " n"]
    ) -> tuple[Reached, ...]:
        """Return the moments found against those asked for."""
        mean = float(values.mean())
        allowed = max(MEAN_TOLERANCE * abs(self.mean), float(values.std()) / len(values))
        found = [Reached(f"mean {self.factor}", self.mean, mean, abs(mean - self.mean) <= allowed)]
        if self.deviation is not None:
            deviation = float(values.std(ddof=1)) if len(values) > 1 else 0.0
            allowed = max(DEVIATION_TOLERANCE, 1.0 / len(values))
            close = abs(deviation - self.deviation) <= allowed * self.deviation
            found.append(Reached(f"s.d. of {self.factor}", self.deviation, deviation, close))
        return tuple(found)

    def __str__(self) -> str:
        spread = "" if self.deviation is None else f" +- {self.deviation:.4g}"
        return f"{self.factor} = {self.mean:.4g}{spread}{_unit_words(self.factor, self.unit)}"


@dataclass(frozen=True)
class FactorCurve:
    """Points of the clones' cumulative distribution of a factor, by number or by mass.

    Attributes
    ----------
    factor : str
    points : tuple of float
        Rising, in the unit of the parents.
    percents : tuple of float
        So much of all lies at or below each point, 0 to 100, not falling.
    by : {'number', 'mass'}
    unit : str
    """

    factor: str
    points: tuple[float, ...]
    percents: tuple[float, ...]
    by: Literal["number", "mass"]
    unit: str

    def __post_init__(self) -> None:
        points, percents = np.array(self.points), np.array(self.percents)
        rising = (np.diff(points) > 0).all() and (np.diff(percents) >= 0).all()
        if not (len(points) and rising and percents.min() >= 0 and percents.max() <= 100):
            raise GenerationError(
                f"The curve of {self.factor} must rise from point to point and its percentages lie between "
                "0 and 100: write for example 0.3:10,0.4:55,0.6:100."
            )

    def admits(self, values: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Return which bodies may be taken: none beyond a point of 100 % or below one of 0 %."""
        taken = np.ones(len(values), dtype=bool)
        for point, percent in zip(self.points, self.percents, strict=True):
            if percent == 100:
                taken &= values <= point
            elif percent == 0:
                taken &= values > point
        return taken

    def rows(
        self, values: Float[np.ndarray, " n"], volumes: Float[np.ndarray, " n"]
    ) -> Float64[np.ndarray, "n points"]:
        """Return what is to be zero on average: each body's mass at or below a point, less its share."""
        mass = self._masses(volumes)
        inner = [
            (point, percent)
            for point, percent in zip(self.points, self.percents, strict=True)
            if 0 < percent < 100
        ]
        columns = [mass * ((values <= point) - percent / 100.0) for point, percent in inner]
        return np.stack(columns, axis=1) if columns else np.empty((len(values), 0))

    def reached(
        self, values: Float[np.ndarray, " n"], volumes: Float[np.ndarray, " n"]
    ) -> tuple[Reached, ...]:
        """Return the percentages found at the points."""
        mass = self._masses(volumes)
        tolerance = max(CURVE_TOLERANCE, 50.0 * float(mass.max() / mass.sum()))
        found = []
        for point, percent in zip(self.points, self.percents, strict=True):
            share = 100.0 * float(mass[values <= point].sum() / mass.sum())
            what = (
                f"percent by {self.by} up to {self.factor} {point:.4g}{_unit_words(self.factor, self.unit)}"
            )
            found.append(Reached(what, percent, share, abs(share - percent) <= tolerance))
        return tuple(found)

    def _masses(self, volumes: Float[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
        return volumes / volumes.mean() if self.by == "mass" else np.ones(len(volumes))

    def __str__(self) -> str:
        if self.factor == SIEVE_SIZE and self.by == "mass" and len(self.points) == 1:
            return f"D{self.percents[0]:g} = {self.points[0]:.4g}{_unit_words(self.factor, self.unit)}"
        pairs = ", ".join(f"{x:.4g}:{p:g}" for x, p in zip(self.points, self.percents, strict=True))
        name = "sieve" if self.factor == SIEVE_SIZE and self.by == "mass" else self.factor
        return f"{name} = {pairs}{_unit_words(self.factor, self.unit)}"


Condition = FactorRange | FactorMoments | FactorCurve


def parse_conditions(texts: Sequence[str], unit: str) -> tuple[Condition, ...]:
    """Read what clones are to be like.

    Parameters
    ----------
    texts : sequence of str
        ``sphericity=0.75..0.8`` (a range; one end may be open), ``csf=0.7`` (a mean), ``csf=0.7+-0.05`` (mean
        and standard deviation), ``D50=0.4 mm`` (half of the mass is finer, by the intermediate axis),
        ``sieve=0.3:10,0.4:55,0.6:100 mm`` (a sieve curve, percent finer by mass) and
        ``sphericity=0.7:10,0.8:60`` (a cumulative distribution by number). Several may stand in one text,
        separated by semicolons or "and". A length without a unit is in `unit`.
    unit : str
        Of the parents; the conditions are in it.

    Raises
    ------
    GenerationError
        If a text cannot be read, or names a factor that is not known.
    """
    words = [word for text in texts for word in split_sentence(text, ";")]  # commas part a curve's points
    return tuple(_parsed(word, parse_unit(unit)) for word in words)


def _parsed(text: str, unit: str) -> Condition:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not name or not value:
        raise GenerationError(f"'{text}' cannot be read: {_HOW}.")
    percentile = _PERCENTILE.match(name)
    if percentile:
        percent = float(percentile[1])
        if not 0 < percent < 100:
            raise GenerationError(f"'{text}' cannot be read: give D1 to D99.")
        return FactorCurve(SIEVE_SIZE, (_quantity(value, SIEVE_SIZE, unit, text),), (percent,), "mass", unit)
    name = spell_measure(name)
    if name == "sieve":
        return _curve(value, SIEVE_SIZE, "mass", unit, text)
    if name not in FACTORS:
        known = ", ".join(FACTORS)
        raise GenerationError(
            f"'{name}' in '{text}' is not a factor: use D10 to D90, sieve, or one of {known}."
        )
    if ":" in value:
        return _curve(value, name, "number", unit, text)
    if ".." in value:
        return _range(value, name, unit, text)
    for sign in ("+-", "±", "+/-"):
        if sign in value:
            mean, spread = (part.strip() for part in value.split(sign, 1))
            stated = _unit_in(spread)
            deviation = _quantity(spread, name, unit, text)
            if deviation <= 0:
                raise GenerationError(f"'{text}' cannot be read: a standard deviation must be above 0.")
            return FactorMoments(name, _quantity(mean, name, unit, text, stated), deviation, unit)
    return FactorMoments(name, _quantity(value, name, unit, text), None, unit)


def _range(value: str, name: str, unit: str, text: str) -> FactorRange:
    low, _, high = (part.strip() for part in value.partition(".."))
    if not low and not high:
        raise GenerationError(
            f"'{text}' cannot be read: give the range at least one end, for example 0.75..0.8."
        )
    stated = _unit_in(high) if high else ""
    first = _quantity(low, name, unit, text, stated) if low else -np.inf
    last = _quantity(high, name, unit, text) if high else np.inf
    if not first < last:
        raise GenerationError(f"'{text}' is an empty range: give the smaller end first.")
    return FactorRange(name, first, last, unit)


def _curve(value: str, name: str, by: Literal["number", "mass"], unit: str, text: str) -> FactorCurve:
    pairs = [pair.split(":") for pair in value.replace(";", ",").split(",") if pair.strip()]
    if any(len(pair) != 2 for pair in pairs):
        raise GenerationError(f"'{text}' cannot be read: {_HOW}.")
    # A unit after the last percentage holds for all points.
    match = re.match(rf"^\s*({_NUMBER})\s*%?\s*(.*)$", pairs[-1][1])
    if match is None:
        raise GenerationError(f"'{text}' cannot be read: {_HOW}.")
    pairs[-1][1], stated = match[1], match[2].strip()
    points = tuple(_quantity(point, name, unit, text, stated) for point, _ in pairs)
    try:
        percents = tuple(float(percent.strip().rstrip("%")) for _, percent in pairs)
    except ValueError as error:
        raise GenerationError(f"'{text}' cannot be read: {_HOW}.") from error
    return FactorCurve(name, points, percents, by, unit)


def _unit_in(text: str) -> str:
    """Return the unit in which a quantity is stated, with its power; empty where there is none."""
    match = _QUANTITY.match(text)
    return "" if match is None else match[2] + match[3]


def _quantity(value: str, name: str, unit: str, text: str, stated: str = "") -> float:
    """Return a number of a factor in powers of `unit`; `stated` is its unit where it carries none."""
    match = _QUANTITY.match(value if _unit_in(value) else f"{value} {stated}")
    if match is None:
        raise GenerationError(f"'{text}' cannot be read: {_HOW}.")
    number, given = float(match[1]), match[2]
    if not given:
        return number
    power = FACTORS[name].power
    if not power:
        raise GenerationError(f"'{text}' cannot be read: {name} has no unit.")
    try:
        factor = conversion_factor(given, unit)
    except UnitError as error:
        known = ", ".join(METRES_PER_UNIT)
        raise GenerationError(f"'{given}' in '{text}' is not a length unit: use one of {known}.") from error
    if _POWERS[match[3]] != power:
        raise GenerationError(
            f"'{text}' cannot be read: {name} is in {FACTORS[name].unit(unit)}, not {given}{match[3]}."
        )
    return number * factor**power


def _unit_words(factor: str, unit: str) -> str:
    words = FACTORS[factor].unit(unit)
    return f" {words}" if words else ""


def reach_words(factor: str, values: Float[np.ndarray, " n"], unit: str) -> str:
    """Return in words which values of a factor candidates have: from the 1st to the 99th percentile."""
    low, high = np.percentile(values[np.isfinite(values)], [1, 99])
    return f"{factor} {low:.4g} to {high:.4g}{_unit_words(factor, unit)}"
