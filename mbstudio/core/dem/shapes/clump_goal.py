"""Sphere clumps with as few spheres as reach a goal: volume, inertia, Hausdorff distance, IoU."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.errors import ExportError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.goals import Goal, Grammar, SmallestNumber
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics import mass_properties

_FEWEST = 2
MEASURES: Mapping[str, str] = {
    "iou": "volume of the intersection of clump and avatar over that of their union, at least",
    "hausdorff": "largest distance of the surfaces over the avatar's nominal diameter D_n, at most",
    "volume": "error of the volume, at most",
    "inertia": "error of the inertia tensor, at most",
}
Fit = Callable[[Avatar, int], Clump]


@dataclass(frozen=True)
class ClumpGoal(Goal):
    """What a sphere clump is to reach with as few spheres as may be, by the measures of `MEASURES`."""

    grammar: ClassVar[Grammar] = Grammar(
        "a clump", "spheres", "iou 0.95", ExportError, lambda: MEASURES, fewest=_FEWEST
    )

    def values(self, clump: Clump, diameter: float) -> dict[str, float]:
        """Return what a clump has reached of each measure; `diameter` is the avatar's D_n, in its unit."""
        found = {
            "iou": clump.iou,
            "hausdorff": clump.hausdorff / diameter,
            "volume": abs(clump.volume_ratio - 1.0),
            "inertia": clump.inertia_error,
        }
        return {aim.measure: found[aim.measure] for aim in self.aims}


@dataclass(frozen=True, eq=False)
class FoundClump:
    """What came of a search for the smallest clump that reaches a goal.

    Attributes
    ----------
    clump : Clump
        The smallest that reaches it, or the nearest to it.
    goal : ClumpGoal
    values : mapping of str to float
        What it has reached, as shares.
    tried : mapping of int to mapping
        The values of every number of spheres that was tried, in the order of trying.
    """

    clump: Clump
    goal: ClumpGoal
    values: Mapping[str, float]
    tried: Mapping[int, Mapping[str, float]]

    @property
    def is_met(self) -> bool:
        """Whether the goal is reached."""
        return self.goal.is_met(self.values)

    @property
    def warning(self) -> str:
        """Why the goal was not reached and what to do; empty where it was."""
        if self.is_met:
            return ""
        missed = self.goal.describe(self.values, only_missed=True)
        return (
            f"The goal '{self.goal}' was not reached with {self.goal.most} spheres: the best clump, of "
            f"{len(self.clump.radii)}, has {missed}. Allow more ('... and n {2 * self.goal.most}'), "
            "or ask for less."
        )


def clump_for_target(
    avatar: Avatar,
    target: ClumpGoal | str,
    *,
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
    fit: Fit | None = None,
) -> FoundClump:
    """Fit the clump with as few spheres as reach a goal.

    The number is doubled from 10 until one will do, then bisected. Every number is a fit of its own: the
    clump is that of ``sphere_clump(avatar, n, seed=seed)`` with the number found.

    Parameters
    ----------
    avatar : Avatar
    target : ClumpGoal or str
        See :meth:`mbstudio.core.goals.Goal.parse`.
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
    wanted = ClumpGoal.parse(target)
    fit = fit or (lambda body, spheres: sphere_clump(body, spheres, seed=seed))
    diameter = nominal_diameter(mass_properties(avatar, 1.0).volume)
    numbers = SmallestNumber(wanted.most, _FEWEST)
    tried: dict[int, Mapping[str, float]] = {}
    best: tuple[tuple[bool, float, int], Clump] | None = None
    while (n := numbers.choose_next()) is not None:
        if progress is not None:
            progress(len(tried) / 12, f"Trying {n} spheres")
        clump = fit(avatar, n)
        tried[n] = values = wanted.values(clump, diameter)
        met = wanted.is_met(values)
        numbers.record(n, will_do=met)
        rank = (not met, 0.0 if met else wanted.shortfall(values), n)
        if best is None or rank < best[0]:
            best = rank, clump
    assert best is not None
    return FoundClump(best[1], wanted, tried[len(best[1].radii)], tried)
