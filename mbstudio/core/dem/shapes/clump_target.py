"""Sphere clumps with as few spheres as reach a target: volume, inertia, Hausdorff distance, IoU."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.errors import ExportError
from mbstudio.core.imaging.goals.target import Aim
from mbstudio.core.imaging.goals.target_fit import SmallestNumber
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics import mass_properties
from mbstudio.core.metrics.factors import nominal_diameter

MOST_SPHERES = 320
_FEWEST = 2
MEASURES: Mapping[str, str] = {
    "iou": "volume of the intersection of clump and avatar over that of their union, at least",
    "hausdorff": "largest distance of the surfaces over the avatar's nominal diameter D_n, at most",
    "volume": "error of the volume, at most",
    "inertia": "error of the inertia tensor, at most",
}
_WORD = re.compile(r"(?P<name>[a-z]+)\s*(?:[<>=]+\s*)?(?P<value>\d*\.?\d+(?:e[+-]?\d+)?)\s*(?P<percent>%?)")

Fit = Callable[[Avatar, int], Clump]


@dataclass(frozen=True)
class ClumpTarget:
    """What a sphere clump is to reach with as few spheres as may be.

    Attributes
    ----------
    aims : tuple of Aim
        All are to be met.
    most : int
        Spheres at most.
    """

    aims: tuple[Aim, ...]
    most: int = MOST_SPHERES

    @classmethod
    def parse(cls, text: str) -> ClumpTarget:
        """Read a target such as ``"iou 0.95 and hausdorff 3 % and n 200"``.

        Parameters
        ----------
        text : str
            Measures (volume, inertia, hausdorff, iou) with their limits, joined by "and" or commas; errors in
            percent or as a share below 1; ``n`` is the greatest number of spheres, 320 if not given.

        Raises
        ------
        ExportError
            If a measure is unknown or given twice, a limit impossible, or there is none at all.
        """
        aims: dict[str, Aim] = {}
        most = MOST_SPHERES
        for word in (part.strip() for part in re.split(r"\band\b|[,;&]", text.lower()) if part.strip()):
            match = _WORD.fullmatch(word)
            if match is None or match["name"] not in (*MEASURES, "n"):
                known = ", ".join(MEASURES)
                raise ExportError(
                    f"'{word}' is no target for a clump: write {known} and a limit, as in 'iou 0.95'."
                )
            name, value = match["name"], float(match["value"])
            if name == "n":
                most = _most(word, value, match["percent"])
                continue
            limit = value / 100 if match["percent"] else value
            if name in aims:
                raise ExportError(f"The target '{text}' names {name} twice: give it once.")
            if not 0 < limit < 1:
                raise ExportError(
                    f"The target '{word}' is impossible: a limit lies between 0 and 1, or 0 and 100 %."
                )
            aims[name] = Aim(name, limit)
        if not aims:
            raise ExportError(f"The target '{text}' names nothing to reach: write for example 'iou 0.95'.")
        return cls(tuple(aims.values()), most)

    def __str__(self) -> str:
        most = () if self.most == MOST_SPHERES else (f"n {self.most}",)
        return " and ".join((*map(str, self.aims), *most))

    def values(self, clump: Clump, diameter: float) -> dict[str, float]:
        """Return what a clump has reached of each measure; `diameter` is the avatar's D_n, in its unit."""
        found = {
            "iou": clump.iou,
            "hausdorff": clump.hausdorff / diameter,
            "volume": abs(clump.volume_ratio - 1.0),
            "inertia": clump.inertia_error,
        }
        return {aim.measure: found[aim.measure] for aim in self.aims}

    def is_met(self, values: Mapping[str, float]) -> bool:
        """Return whether every measure is good enough."""
        return all(aim.is_met(values[aim.measure]) for aim in self.aims)

    def shortfall(self, values: Mapping[str, float]) -> float:
        """Return the largest error over its limit: at most 1 where the target is met."""
        return max(aim.shortfall(values[aim.measure]) for aim in self.aims)

    def told(self, values: Mapping[str, float], *, only_missed: bool = False) -> str:
        """Return values in words."""
        aims = [aim for aim in self.aims if not (only_missed and aim.is_met(values[aim.measure]))]
        return ", ".join(aim.told(values[aim.measure]) for aim in aims)


@dataclass(frozen=True, eq=False)
class TargetClump:
    """What came of a search for the smallest clump that reaches a target.

    Attributes
    ----------
    clump : Clump
        The smallest that reaches it, or the nearest to it.
    target : ClumpTarget
    values : mapping of str to float
        What it has reached, as shares.
    tried : mapping of int to mapping
        The values of every number of spheres that was tried, in the order of trying.
    """

    clump: Clump
    target: ClumpTarget
    values: Mapping[str, float]
    tried: Mapping[int, Mapping[str, float]]

    @property
    def is_met(self) -> bool:
        """Whether the target is reached."""
        return self.target.is_met(self.values)

    @property
    def warning(self) -> str:
        """Why the target was not reached and what to do; empty where it was."""
        if self.is_met:
            return ""
        missed = self.target.told(self.values, only_missed=True)
        return (
            f"The target '{self.target}' was not reached with {self.target.most} spheres: the best clump, of "
            f"{len(self.clump.radii)}, has {missed}. Allow more ('... and n {2 * self.target.most}'), "
            "or ask for less."
        )


def clump_for_target(
    avatar: Avatar,
    target: ClumpTarget | str,
    *,
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
    fit: Fit | None = None,
) -> TargetClump:
    """Fit the clump with as few spheres as reach a target.

    The number is doubled from 10 until one will do, then bisected. Every number is a fit of its own: the
    clump is that of ``sphere_clump(avatar, n, seed=seed)`` with the number found.

    Parameters
    ----------
    avatar : Avatar
    target : ClumpTarget or str
        See :meth:`ClumpTarget.parse`.
    seed : int
    progress : callable(fraction, message), optional
        Raising in it cancels.
    fit : callable(avatar, spheres) -> Clump, optional
        In place of :func:`sphere_clump`.

    Raises
    ------
    ExportError
        If the target cannot be read.
    MeasureError
        If the avatar is in several pieces.
    """
    wanted = ClumpTarget.parse(target) if isinstance(target, str) else target
    fit = fit or (lambda body, spheres: sphere_clump(body, spheres, seed=seed))
    diameter = nominal_diameter(mass_properties(avatar, 1.0).volume)
    numbers = SmallestNumber(wanted.most)
    numbers.too_few = _FEWEST - 1
    tried: dict[int, Mapping[str, float]] = {}
    best: tuple[tuple[bool, float, int], Clump] | None = None
    while (n := numbers.next()) is not None:
        if progress is not None:
            progress(len(tried) / 12, f"Trying {n} spheres")
        clump = fit(avatar, n)
        tried[n] = values = wanted.values(clump, diameter)
        met = wanted.is_met(values)
        numbers.tell(n, will_do=met)
        rank = (not met, 0.0 if met else wanted.shortfall(values), n)
        if best is None or rank < best[0]:
            best = rank, clump
    assert best is not None
    return TargetClump(best[1], wanted, tried[len(best[1].radii)], tried)


def _most(word: str, value: float, percent: str) -> int:
    if percent or value != int(value) or value < _FEWEST:
        raise ExportError(f"'{word}' is no number of spheres: write a whole number from 2, as in 'n 200'.")
    return int(value)
