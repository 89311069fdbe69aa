"""Goals: what a fit or a clump is to reach with as few parts as may be, read from words by one grammar.

A goal is a sentence such as ``"volume 0.5 % and hausdorff 2 % and n 120"``: measures with their limits, and
``n``, the greatest number of parts (control points of an avatar, spheres of a clump). :class:`Goal` reads and
judges it; whoever has goals of its own says in a :class:`Grammar` what they may name. What clones are to be
like (:mod:`mbstudio.core.vae.generate.conditions`) names factors by the same rules.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from mbstudio.core.errors import MbstudioError

MOST_PARTS = 320
OVERLAP = "iou"
NUMBER = "n"
UNSIGNED = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
"""A number without sign, as a regular expression."""

_AIM = re.compile(rf"(?P<name>[a-z][a-z_\- ]*?)\s*(?:[<>=]+\s*)?(?P<value>{UNSIGNED})\s*(?P<percent>%?)")
_FIRST = 10


def split_sentence(text: str, marks: str = ",;&") -> list[str]:
    """Return the parts of a text that "and" or one of the marks joins, without those that are empty."""
    return [part.strip() for part in re.split(rf"\band\b|[{re.escape(marks)}]", text) if part.strip()]


def spell_measure(name: str) -> str:
    """Return a measure's name as the tables spell it: ``Sneed-Folk`` and ``D_n`` are sneed_folk and dn."""
    from mbstudio.core.metrics import FACTORS

    spelt = re.sub(r"[\s\-]+", "_", name.strip().lower())
    return next((factor.name for factor in FACTORS.values() if spelt in factor.aliases), spelt)


@dataclass(frozen=True)
class Aim:
    """One measure and its limit.

    Attributes
    ----------
    measure : str
        'iou', or a measure whose error is meant: of the surfaces ('hausdorff', 'rms', over D_n), or relative,
        of a shape factor or another figure.
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

    def describe(self, value: float) -> str:
        """Return the value in words."""
        if value != value:
            return f"{self.measure} unknown"
        if self.measure == OVERLAP:
            return f"{self.measure} {value:.4f}"
        return f"{self.measure} {100 * abs(value):.3g} %"

    def __str__(self) -> str:
        if self.measure == OVERLAP:
            return f"{self.measure} {self.limit:g}"
        return f"{self.measure} {100 * self.limit:g} %"


@dataclass(frozen=True)
class Grammar:
    """What one kind of goal may name, and how its errors are said.

    Attributes
    ----------
    owner : str
        For what the goals are: ``a clump``.
    parts : str
        What is counted by ``n``: ``spheres``.
    example : str
        A goal, for messages.
    error : type
        Raised for what cannot be read.
    measures : callable() -> collection of str
        The names that a goal may hold, beside ``n``.
    fewest : int
        The least that ``n`` may be.
    """

    owner: str
    parts: str
    example: str
    error: type[MbstudioError]
    measures: Callable[[], Collection[str]]
    fewest: int = 1

    def read_aims(self, text: str) -> tuple[tuple[Aim, ...], int]:
        """Return the aims that a sentence names, and the greatest number of parts.

        Raises
        ------
        MbstudioError
            The grammar's own, if a measure is unknown or given twice, a limit impossible, or there is none.
        """
        aims: dict[str, Aim] = {}
        most = MOST_PARTS
        for word in split_sentence(text.lower()):
            name, value, percent = self._read_word(word)
            if name == NUMBER:
                most = self._read_number(word, value, percent)
                continue
            if name in aims:
                raise self.error(f"The goal '{text}' names {name} twice: give it once.")
            aims[name] = Aim(name, self._read_limit(word, name, value / 100 if percent else value))
        if not aims:
            raise self.error(f"The goal '{text}' contains no measure: write for example '{self.example}'.")
        return tuple(aims.values()), most

    def _read_word(self, word: str) -> tuple[str, float, bool]:
        match, known = _AIM.fullmatch(word), ", ".join(self.measures())
        refusal = f"'{word}' is not a goal for {self.owner}"
        if match is None:
            raise self.error(
                f"{refusal}: write a measure and its limit, as in '{self.example}'. Known: {known}."
            )
        name = spell_measure(match["name"])
        if name != NUMBER and name not in self.measures():
            raise self.error(f"{refusal}: it names '{name}', which is not known: use {known}, or {NUMBER}.")
        return name, float(match["value"]), bool(match["percent"])

    def _read_limit(self, word: str, name: str, limit: float) -> float:
        if 0 < limit < 1:
            return limit
        if name == OVERLAP:
            cure = f"an {OVERLAP} lies between 0 and 1, as in '{OVERLAP} 0.97'"
        else:
            cure = f"an error lies between 0 and 100 %: write it as '{name} 1 %'"
        raise self.error(f"The goal '{word}' is impossible: {cure}.")

    def _read_number(self, word: str, value: float, percent: bool) -> int:
        if percent or value != int(value) or value < self.fewest:
            raise self.error(
                f"'{word}' is not a number of {self.parts}: write a whole number, {self.fewest} or more, "
                f"as in '{NUMBER} 120'."
            )
        return int(value)


GoalKind = TypeVar("GoalKind", bound="Goal")


@dataclass(frozen=True)
class Goal:
    """What is to be reached with as few parts as may be.

    Attributes
    ----------
    aims : tuple of Aim
        All are to be met.
    most : int
        Parts at most.
    """

    grammar: ClassVar[Grammar]
    aims: tuple[Aim, ...]
    most: int = MOST_PARTS

    @classmethod
    def parse(cls: type[GoalKind], text: str | GoalKind) -> GoalKind:
        """Read a goal such as ``"volume 0.5 % and hausdorff 2 % and n 120"``.

        Parameters
        ----------
        text : str or goal
            Measures and limits, joined by "and", commas, semicolons or &. Errors and distances (the latter
            over D_n) in percent or as a share below 1; ``iou`` as a share or in percent; ``n`` is the
            greatest number of parts, 320 if not given.

        Raises
        ------
        MbstudioError
            The kind's own, if a measure is unknown or given twice, a limit impossible, or there is none.
        """
        return text if isinstance(text, cls) else cls(*cls.grammar.read_aims(str(text)))

    def __str__(self) -> str:
        most = () if self.most == MOST_PARTS else (f"{NUMBER} {self.most}",)
        return " and ".join((*(str(aim) for aim in self.aims), *most))

    def is_met(self, values: Mapping[str, float]) -> bool:
        """Return whether every measure is good enough."""
        return all(aim.is_met(values[aim.measure]) for aim in self.aims)

    def shortfall(self, values: Mapping[str, float]) -> float:
        """Return the largest error over its limit: at most 1 where the goal is met."""
        return max(aim.shortfall(values[aim.measure]) for aim in self.aims)

    def describe(self, values: Mapping[str, float], *, only_missed: bool = False) -> str:
        """Return values in words."""
        aims = [aim for aim in self.aims if not (only_missed and aim.is_met(values[aim.measure]))]
        return ", ".join(aim.describe(values[aim.measure]) for aim in aims)


class SmallestNumber:
    """The order in which numbers of parts are tried: doubled until one will do, then bisected.

    Parameters
    ----------
    most : int
        Tried at most.
    fewest : int
        Tried at least.

    Attributes
    ----------
    too_few : int
        The largest number that is known not to do; none was tried below `fewest`.
    enough : int or None
        The smallest number found that will do.

    Notes
    -----
    The error falls with n but for a few percent of noise. What is found will do, and the number before it
    will not; that no smaller one would, by chance, is not known.
    """

    def __init__(self, most: int, fewest: int = 1) -> None:
        self.most = most
        self.too_few = fewest - 1
        self.enough: int | None = None

    def choose_next(self) -> int | None:
        """Return the number to be tried next; None at the end."""
        if self.enough is not None:
            return (self.too_few + self.enough) // 2 if self.enough - self.too_few > 1 else None
        return min(max(_FIRST, 2 * self.too_few), self.most) if self.too_few < self.most else None

    def record(self, n: int, *, will_do: bool) -> None:
        """Take down what came of a number."""
        if will_do:
            self.enough = n
        else:
            self.too_few = n
