"""How sure what is shown is: intervals, bands and grains needed, found in a thread for the newest choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.errors import MbstudioError
from mbstudio.core.populations import (
    Band,
    Bootstrap,
    FactorTest,
    Interval,
    Need,
    Population,
    find_differences,
    kernel_density,
    needed_bodies,
)
from mbstudio.core.populations.population import Weighting
from mbstudio.ui.latest_request_worker import LatestRequestWorker

_SAMPLES = 400
_POINTS = 120


@dataclass(frozen=True, eq=False)
class Certainty:
    """Intervals of what is shown; one entry a population, None where there are too few bodies.

    Attributes
    ----------
    populations : list of Population
    factor : str
    by : {'number', 'volume'}
    means, deviations : list of Interval or None
        Of the factor.
    cdf, density, finer : list of Band or None
        Of the factor, and of sizes by mass.
    needs : list of Need
        Of the first population.
    tests : list of FactorTest or None
        Of the factor, against the first population, among all factors.
    """

    populations: list[Population]
    factor: str
    by: Weighting
    means: list[Interval | None]
    deviations: list[Interval | None]
    cdf: list[Band | None]
    density: list[Band | None]
    finer: list[Band | None]
    needs: list[Need]
    tests: list[FactorTest | None]

    def is_of(self, populations: Sequence[Population], factor: str, by: Weighting) -> bool:
        """Whether it is of what is shown."""
        same = len(populations) == len(self.populations)
        same = same and all(a is b for a, b in zip(populations, self.populations, strict=True))
        return same and (factor, by) == (self.factor, self.by)


class CertaintyWork(QObject):
    """Finds how sure the newest choice is.

    Attributes
    ----------
    found : Certainty or None
    changed : signal
    """

    changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.found: Certainty | None = None
        self._asked: tuple[object, ...] = ()
        self.worker = LatestRequestWorker("intervals", self)
        self.worker.done.connect(self._arrived)
        self.worker.failed.connect(lambda _token, _error: self._arrived(None, None))

    def ask(
        self, populations: Sequence[Population], factor: str, by: Weighting, precision: float
    ) -> Certainty | None:
        """Return what is known of a choice; what is not known yet arrives later."""
        given = list(populations)
        asked = (*map(id, given), factor, by, precision)
        if asked != self._asked:
            self._asked, self.found = asked, None
            if given:
                self.worker.ask(lambda: find_certainty(given, factor, by, precision), asked)
        return self.found

    def _arrived(self, token: object, found: Certainty | None) -> None:
        if token == self._asked:
            self.found = found
            self.changed.emit()


def find_certainty(populations: list[Population], factor: str, by: Weighting, precision: float) -> Certainty:
    """Return the intervals of a choice."""
    means: list[Interval | None] = []
    deviations: list[Interval | None] = []
    cdf: list[Band | None] = []
    density: list[Band | None] = []
    finer: list[Band | None] = []
    tests: list[FactorTest | None] = []
    for place, population in enumerate(populations):
        drawn = Bootstrap(population, samples=_SAMPLES)
        values = population.values(factor)
        has_many = len(values) > 0
        means.append(drawn.mean(factor, by) if has_many else None)
        deviations.append(drawn.deviation(factor, by) if has_many else None)
        at = np.linspace(values.min(), values.max(), _POINTS) if has_many else np.zeros(0)
        cdf.append(drawn.cumulative(factor, at, by) if has_many else None)
        density.append(_density(drawn, population, factor, by) if has_many else None)
        sizes = np.unique(population.values("intermediate"))
        step = max(1, len(sizes) // _POINTS)
        finer.append(drawn.finer(np.unique(np.append(sizes[::step], sizes[-1]))) if len(sizes) else None)
        tests.append(_test(populations[0], population, factor) if place else None)
    needs = needed_bodies(populations[0], precision, samples=_SAMPLES)
    return Certainty(populations, factor, by, means, deviations, cdf, density, finer, needs, tests)


def _density(drawn: Bootstrap, population: Population, factor: str, by: Weighting) -> Band | None:
    try:
        smooth = kernel_density(population.values(factor), population.weights(factor, by))
        return drawn.density(factor, smooth.x[:: max(1, len(smooth.x) // _POINTS)], by)
    except MbstudioError:  # all values are equal: there is no density either
        return None


def _test(reference: Population, other: Population, factor: str) -> FactorTest | None:
    is_paired = other.kind == "avatars" and reference.kind == "grains"
    try:
        return find_differences(reference, other, paired=is_paired).get(factor)
    except MbstudioError:  # labels stand twice, or the two were measured otherwise
        return None
