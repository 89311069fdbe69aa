"""What an avatar is to reach: errors at most, overlap at least, read from words."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mbstudio.core.errors import FitError, MbstudioError
from mbstudio.core.imaging.steps import FitResult

if TYPE_CHECKING:
    from mbstudio.core.imaging.goals.likeness import Likeness

MOST_CONTROL_POINTS = 320
OVERLAP = "iou"
NUMBER = "n"
_OF_SURFACES = ("rms", "hausdorff", OVERLAP)
_ALIASES = {"d_n": "dn", "d_s": "ds", "d_ns": "dns", "corey": "csf"}
_AIM = re.compile(
    r"(?P<name>[a-z][a-z_\- ]*?)\s*(?:[<>=]+\s*)?(?P<value>\d*\.?\d+(?:e[+-]?\d+)?)\s*(?P<percent>%?)"
)


def target_measures() -> tuple[str, ...]:
    """Return the names that a target may hold, beside ``n``."""
    from mbstudio.core.metrics import CORE_FACTORS

    return (*_OF_SURFACES, *CORE_FACTORS)


@dataclass(frozen=True)
class Aim:
    """One measure and its limit.

    Attributes
    ----------
    measure : str
        'iou'; 'hausdorff' or 'rms' distance of the surfaces over D_n; or the relative error of a shape
        factor, by its name.
    limit : float
        At least, for the overlap; at most for the others. A share, not percent.
    """

    measure: str
    limit: float

    def is_met(self, value: float) -> bool:
        """Return whether a value is good enough; NaN is not."""
        return value >= self.limit if self.measure == OVERLAP else abs(value) <= self.limit

    def shortfall(self, value: float) -> float:
        """Return how many times the limit the error is; of the overlap, that of what is not shared."""
        if value != value:
            return float("inf")
        if self.measure == OVERLAP:
            return (1.0 - value) / max(1.0 - self.limit, 1e-12)
        return abs(value) / self.limit

    def told(self, value: float) -> str:
        """Return the value in words."""
        if value != value:
            return f"{self.measure} unknown"
        if self.measure == OVERLAP:
            return f"{self.measure} {value:.4f}"
        return f"{self.measure} {100 * abs(value):.3g} %"

    def __str__(self) -> str:
        return (
            f"{self.measure} {self.limit:g}"
            if self.measure == OVERLAP
            else f"{self.measure} {100 * self.limit:g} %"
        )


@dataclass(frozen=True)
class FitTarget:
    """What an avatar is to reach with as few control points as may be.

    Attributes
    ----------
    aims : tuple of Aim
        All are to be met, by an avatar that is valid.
    most : int
        Control points at most.
    """

    aims: tuple[Aim, ...]
    most: int = MOST_CONTROL_POINTS

    @classmethod
    def parse(cls, text: str | FitTarget) -> FitTarget:
        """Read a target such as ``"volume 0.5 % and hausdorff 2 % and n 120"``.

        Parameters
        ----------
        text : str or FitTarget
            Measures and limits, joined by "and" or commas. Errors and distances (the latter over D_n) in
            percent or as a share below 1; ``iou`` as a share or in percent; ``n`` is the greatest number of
            control points, 320 if not given.

        Raises
        ------
        FitError
            If a measure is unknown or given twice, a limit impossible, or there is none at all.
        """
        if isinstance(text, FitTarget):
            return text
        words = [word.strip() for word in re.split(r"\band\b|[,;&]", text.lower()) if word.strip()]
        aims: list[Aim] = []
        most = MOST_CONTROL_POINTS
        for word in words:
            name, value, percent = _read(word)
            if name == NUMBER:
                most = _number(word, value, percent)
                continue
            if name in (aim.measure for aim in aims):
                raise FitError(f"The target '{text}' names {name} twice: give it once.")
            aims.append(_aim(name, value / 100 if percent else value, word))
        if not aims:
            raise FitError(f"The target '{text}' names nothing to reach: write for example 'volume 0.5 %'.")
        return cls(tuple(aims), most)

    def __str__(self) -> str:
        most = () if self.most == MOST_CONTROL_POINTS else (f"n {self.most}",)
        return " and ".join((*(str(aim) for aim in self.aims), *most))

    def values(self, result: FitResult, likeness: Likeness) -> dict[str, float]:
        """Return what a fit has reached of each measure; NaN where it is not defined for this avatar."""
        found: dict[str, float] = {}
        verdict, names = result.verdict, [aim.measure for aim in self.aims]
        if "volume" in names:
            found["volume"] = abs(verdict.volume_error)
        if "rms" in names:
            found["rms"] = verdict.rms / likeness.grain.nominal_diameter
        if OVERLAP in names:
            found[OVERLAP] = likeness.iou(result.avatar)
        if "hausdorff" in names:
            found["hausdorff"] = likeness.hausdorff(result.avatar)
        wanted = [name for name in names if name not in found]
        if wanted:
            errors = _factor_errors(result, likeness)
            found.update({name: abs(errors.get(name, float("nan"))) for name in wanted})
        return {name: found[name] for name in names}

    def is_met(self, values: Mapping[str, float]) -> bool:
        """Return whether every measure is good enough."""
        return all(aim.is_met(values[aim.measure]) for aim in self.aims)

    def shortfall(self, values: Mapping[str, float]) -> float:
        """Return the largest error over its limit: at most 1 where the target is met."""
        return max(aim.shortfall(values[aim.measure]) for aim in self.aims)

    def told(self, values: Mapping[str, float], *, only_missed: bool = False) -> str:
        """Return values in words."""
        aims: Iterable[Aim] = self.aims
        if only_missed:
            aims = [aim for aim in self.aims if not aim.is_met(values[aim.measure])]
        return ", ".join(aim.told(values[aim.measure]) for aim in aims)


def _factor_errors(result: FitResult, likeness: Likeness) -> dict[str, float]:
    _ = likeness.factors  # a grain that cannot be measured is an error of the target, not of an avatar
    try:
        return likeness.factor_errors(result.avatar)
    except MbstudioError:  # an avatar in several pieces has no factors, so it does not reach the target
        return {}


def _read(word: str) -> tuple[str, float, bool]:
    match = _AIM.fullmatch(word)
    known = ", ".join(target_measures())
    if match is None:
        raise FitError(
            f"'{word}' is no target: write a measure and its limit, as in 'volume 0.5 %'. Known: {known}."
        )
    name = re.sub(r"[\s\-]+", "_", match["name"].strip())
    name = _ALIASES.get(name, name)
    if name != NUMBER and name not in target_measures():
        raise FitError(f"The target '{word}' names '{name}', which is not known: use {known}, or n.")
    return name, float(match["value"]), bool(match["percent"])


def _aim(name: str, limit: float, word: str) -> Aim:
    if name == OVERLAP and not 0 < limit < 1:
        raise FitError(f"The target '{word}' is impossible: an iou lies between 0 and 1, as in 'iou 0.97'.")
    if not 0 < limit < 1:
        raise FitError(f"The target '{word}' is no error between 0 and 100 %: write it as '{name} 1 %'.")
    return Aim(name, limit)


def _number(word: str, value: float, percent: bool) -> int:
    if percent or value != int(value) or value < 1:
        raise FitError(f"'{word}' is no number of control points: write a whole number, as in 'n 120'.")
    return int(value)
