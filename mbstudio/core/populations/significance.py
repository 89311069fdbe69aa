"""Several factors of two populations tested at once, and what the tests would miss."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations.comparison import compare, relative_errors
from mbstudio.core.populations.population import Population

LEVEL = 0.05
POWER = 0.8
_FEWEST_PAIRS = 6
"""Pairs below which a signed-rank test can find nothing at 5 %."""


@dataclass(frozen=True)
class FactorTest:
    """Whether one factor of two populations differs by more than chance, among several factors tested.

    Attributes
    ----------
    factor : str
    numbers : tuple of int
        Bodies of either population that have it; of a paired test the pairs twice.
    ks : float
        Kolmogorov-Smirnov statistic; NaN in a paired test.
    p : float
        Probability of such a difference by chance, of this factor alone.
    p_adjusted : float
        The same after Holm, for all factors tested: below `LEVEL` for none of equal factors in 19 of 20
        cases.
    detectable : float
        Smallest true distance of the two cumulative distributions that the test finds with a
        probability of `POWER` at least; NaN in a paired test.
    detectable_mean : float
        Smallest true difference of means that a test of means finds with that probability, in standard
        deviations of one population (of the differences, in a paired test).
    is_paired : bool
        Whether each body was compared with its own partner (signed ranks, Wilcoxon 1945).
    """

    factor: str
    numbers: tuple[int, int]
    ks: float
    p: float
    p_adjusted: float
    detectable: float
    detectable_mean: float
    is_paired: bool = False

    @property
    def differs(self) -> bool:
        """Whether the difference is more than chance, at `LEVEL` for all factors together."""
        return self.p_adjusted < LEVEL


def adjust_by_holm(probabilities: Sequence[float]) -> list[float]:
    """Return probabilities adjusted for testing several at once; NaN stays NaN and does not count.

    References
    ----------
    Holm (1979), A simple sequentially rejective multiple test procedure, Scandinavian J. Statistics 6, 65-70.
    """
    given = np.asarray(probabilities, dtype=float)
    adjusted = np.full(given.shape, np.nan)
    places = np.flatnonzero(np.isfinite(given))
    if ((given[places] < 0) | (given[places] > 1)).any():
        raise MeasureError("Probabilities lie between 0 and 1.")
    order = places[np.argsort(given[places], kind="stable")]
    steps = given[order] * np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return [float(value) for value in adjusted]


def find_differences(
    reference: Population, other: Population, factors: Sequence[str] | None = None, *, paired: bool = False
) -> dict[str, FactorTest]:
    """Test factors of two populations for differences, with probabilities adjusted for their number.

    Parameters
    ----------
    reference, other : Population
        Measured alike. Independent samples; with `paired` bodies of the same labels (avatars and their
        grains).
    factors : sequence of str, optional
        All that both hold by default.
    paired : bool
        Compare each body with its partner of the same label by signed ranks. The Kolmogorov-Smirnov test
        takes avatars for an independent sample, and misses what they all have in common.

    Raises
    ------
    MeasureError
        If the populations were not measured alike, or a factor is not there.

    Notes
    -----
    The power of the Kolmogorov-Smirnov test is bounded from below for any shape of distribution: at the
    place of the largest true distance D the observed one spreads by at most 1/2 sqrt(1/n + 1/m), and
    must exceed the critical value at level / (number of factors).
    """
    if paired:
        return _test_pairs(reference, other, factors)
    found = compare(reference, other, factors)
    adjusted = adjust_by_holm([one.p for one in found.values()])
    count = max(1, len(found))
    tests = {}
    for one, p in zip(found.values(), adjusted, strict=True):
        n, m = one.numbers
        tests[one.factor] = FactorTest(
            one.factor, one.numbers, one.ks, one.p, p, _detectable_distance(n, m, LEVEL / count),
            _detectable_mean(1.0 / n + 1.0 / m, LEVEL / count),
        )  # fmt: skip
    return tests


def _test_pairs(
    reference: Population, other: Population, factors: Sequence[str] | None
) -> dict[str, FactorTest]:
    from scipy.stats import wilcoxon

    names = factors or [name for name in reference.factors if name in other.factors]
    pairs: Mapping[str, np.ndarray] = {
        name: np.array([e for e in relative_errors(reference, other, name).values() if np.isfinite(e)])
        for name in names
    }
    pairs = {name: errors for name, errors in pairs.items() if len(errors)}
    raw = []
    for errors in pairs.values():
        moved = errors[errors != 0]
        enough = len(moved) >= _FEWEST_PAIRS
        raw.append(float(wilcoxon(moved).pvalue) if enough else 1.0 if not len(moved) else float("nan"))
    count = max(1, len(pairs))
    return {
        name: FactorTest(
            name, (len(errors), len(errors)), float("nan"), p, adjusted, float("nan"),
            _detectable_mean(1.0 / len(errors), LEVEL / count), is_paired=True,
        )
        for (name, errors), p, adjusted in zip(pairs.items(), raw, adjust_by_holm(raw), strict=True)
    }  # fmt: skip


def _detectable_distance(n: int, m: int, level: float) -> float:
    """Return the distance of distributions that the test finds with probability `POWER`, at most 1."""
    both = 1.0 / n + 1.0 / m
    critical = np.sqrt(-np.log(level / 2.0) / 2.0 * both)
    return float(min(1.0, critical + ndtri(POWER) * 0.5 * np.sqrt(both)))


def _detectable_mean(variance: float, level: float) -> float:
    return float((ndtri(1.0 - level / 2.0) + ndtri(POWER)) * np.sqrt(variance))
