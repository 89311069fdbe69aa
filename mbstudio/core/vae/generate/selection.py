"""Which candidates become clones: so that the joint distribution of their factors is that of the parents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from mbstudio.core.populations.comparison import PAPER_FACTORS
from mbstudio.core.vae.generate.balancing import Inclusion, draw_balanced, inclusion

BALANCED_FACTORS = PAPER_FACTORS
"""Factors whose means, standard deviations and correlations clones share with their parents."""

_SHARES = (0.2, 0.4, 0.6, 0.8)
_FEWEST_FOR_QUANTILES = 40
_NOVELTY_SHARES = (0.25, 0.5, 0.75)
_LEAST_FREEDOM = 1.1
_SOFTNESS = 0.03
_SOFTER = 0.12
_STAYING = 3.0


@dataclass(frozen=True, eq=False)
class Moments:
    """Means, sample standard deviations and correlations of `BALANCED_FACTORS`.

    Attributes
    ----------
    means, deviations : float array, shape (6,)
    correlations : float array, shape (6, 6)
    bodies : int
        How many they were found from.
    quantiles : float array, shape (4, 6)
        Of 20, 40, 60 and 80 percent; no rows where there are too few bodies to tell.
    """

    means: Float64[np.ndarray, " 6"]
    deviations: Float64[np.ndarray, " 6"]
    correlations: Float64[np.ndarray, "6 6"]
    bodies: int
    quantiles: Float64[np.ndarray, "q 6"]

    @classmethod
    def from_values(cls, values: Float[np.ndarray, "bodies 6"]) -> Moments:
        """Return the moments of bodies that are all measured, two at least."""
        means, deviations = values.mean(axis=0), values.std(axis=0, ddof=1)
        deviations = np.where(deviations > 1e-9 * np.abs(means), deviations, 0.0)
        scaled = (values - means) / np.where(deviations > 0, deviations, np.inf)
        told = _SHARES if len(values) >= _FEWEST_FOR_QUANTILES else ()
        quantiles = np.quantile(values, told, axis=0) if told else np.empty((0, values.shape[1]))
        return cls(means, deviations, scaled.T @ scaled / (len(values) - 1), len(values), quantiles)

    def largest_error(self, values: Float[np.ndarray, "clones 6"]) -> float:
        """Return the largest error of a mean or standard deviation of clones, in deviations of the bodies."""
        spread = self.deviations > 0
        if not spread.any() or len(values) < 2:
            return 0.0
        off = np.abs(values.mean(axis=0) - self.means)[spread] / self.deviations[spread]
        wide = np.abs(values.std(axis=0, ddof=1)[spread] / self.deviations[spread] - 1.0)
        return float(max(off.max(), wide.max()))

    def shrink(self, values: Float[np.ndarray, "candidates 6"]) -> Moments:
        """Return these moments, the correlations partly those of the candidates where there are few bodies.

        Twenty bodies tell fifteen correlations badly. They count as twenty against fifteen of the
        candidates' own, as if these were known from as many bodies as there are correlations.
        """
        pairs = len(self.means) * (len(self.means) - 1) // 2
        share = pairs / (pairs + self.bodies - 1.0)
        theirs = Moments.from_values(values).correlations
        mixed = (1.0 - share) * self.correlations + share * theirs
        return replace(self, correlations=mixed)

    def rows(
        self, values: Float[np.ndarray, "candidates 6"], count: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return what is to be zero on average for `count` clones.

        Columns of means, deviations, correlations, and of shares below the quantiles.

        A factor in which the bodies do not differ is left out.
        """
        spread = self.deviations > 0
        scaled = (values[:, spread] - self.means[spread]) / self.deviations[spread]
        correlations = self.correlations[np.ix_(spread, spread)]
        # The sample variance of so many clones is to be 1.
        share = (count - 1.0) / count
        first, second = np.triu_indices(int(spread.sum()), 1)
        products = scaled[:, first] * scaled[:, second] - share * correlations[first, second]
        shares = [
            (values[:, spread] <= edges[spread]) - below
            for below, edges in zip(_SHARES, self.quantiles, strict=False)
        ]
        below = np.concatenate(shares, axis=1) if shares else np.empty((len(values), 0))
        return scaled, scaled**2 - share, products, below


@dataclass(frozen=True, eq=False)
class Choice:
    """Which candidates were taken.

    Attributes
    ----------
    rows : int array, shape (count,)
        Rising.
    level : int
        How much of the parents' distribution was asked for: 0 all, more if that could not be had.
    how : str
        The same in words.
    effective : float
        Number of candidates really chosen among, as in `Inclusion`.
    """

    rows: Int[np.ndarray, " count"]
    level: int
    how: str
    effective: float


LEVELS = (
    "means, standard deviations and correlations as the parents', quantiles and novelty nearly",
    "means and standard deviations as the parents', correlations, quantiles and novelty nearly",
    "means and standard deviations as the parents'",
    "means and standard deviations nearly as the parents'",
    "means nearly as the parents'",
    "as the style-learner draws them: the candidates do not reach the parents' distribution",
)
"""What is asked for, from the most to the least."""


def novelty_rows(
    distances: Float[np.ndarray, " candidates"], among_parents: Float[np.ndarray, " parents"]
) -> Float64[np.ndarray, "candidates q"]:
    """Return what is to be zero on average for clones as far from the parents as these from each other.

    Parameters
    ----------
    distances : float array, shape (candidates,)
        Of each candidate to its nearest parent.
    among_parents : float array, shape (parents,)
        Of each parent to its nearest other parent; too few tell nothing.
    """
    if len(among_parents) < _FEWEST_FOR_QUANTILES:
        return np.empty((len(distances), 0))
    edges = np.quantile(among_parents, _NOVELTY_SHARES)
    excess: np.ndarray = (distances[:, None] <= edges) - np.array(_NOVELTY_SHARES)
    return excess


def parental_inclusion(
    values: Float[np.ndarray, "candidates 6"],
    count: int,
    parents: Moments,
    novel: Float[np.ndarray, "candidates q"] | None = None,
    log_odds: Float[np.ndarray, " candidates"] | None = None,
) -> tuple[Inclusion, int, np.ndarray]:
    """Return inclusion probabilities that give clones the parents' moments, as far as can be had.

    Parameters
    ----------
    values : float array, shape (candidates, 6)
    count : int
    parents : Moments
    novel : float array, shape (candidates, q), optional
    log_odds : float array, shape (candidates,), optional
        Of the probabilities to depart from; even ones by default.

    Returns
    -------
    inclusion : Inclusion
    level : int
        Index into `LEVELS`.
    rows : float array, shape (candidates, constraints)
        The statistics that were balanced.
    """
    means, deviations, products, below = parents.shrink(values).rows(values, count)
    nearness = np.empty((len(values), 0)) if novel is None else novel
    everything = np.concatenate([means, deviations, products, below, nearness], axis=1)
    hard = means.shape[1] + deviations.shape[1]
    softness = np.full(everything.shape[1], _SOFTNESS)
    softness[: hard + products.shape[1]] = 0.0
    softer = np.where(np.arange(everything.shape[1]) < hard, 0.0, _SOFTER)
    both = everything[:, :hard]
    attempts: tuple[tuple[np.ndarray, np.ndarray | float], ...] = (
        (everything, softness),
        (everything, softer),
        (both, 0.0),
        (both, _SOFTNESS),
        (means, _SOFTNESS),
    )
    least = min(_LEAST_FREEDOM * count, 0.5 * (count + len(values)))
    for level, (rows, allowed) in enumerate(attempts):
        found = inclusion(rows, count, log_odds=log_odds, softness=allowed)
        if found.converged and found.effective >= least:
            return found, level, rows
    nothing = np.empty((len(values), 0))
    return inclusion(nothing, count), len(attempts), nothing


def choose(
    values: Float[np.ndarray, "candidates 6"],
    count: int,
    parents: Moments,
    rng: np.random.Generator,
    *,
    novel: Float[np.ndarray, "candidates q"] | None = None,
    admitted: Bool[np.ndarray, " candidates"] | None = None,
    asked: Float[np.ndarray, "candidates constraints"] | None = None,
    kept: Sequence[int] = (),
) -> Choice | None:
    """Choose clones: like the parents, or as little unlike as what is asked for allows.

    Parameters
    ----------
    values : float array, shape (candidates, 6)
        `BALANCED_FACTORS` of every candidate.
    count : int
    parents : Moments
    rng : numpy.random.Generator
    novel : float array, shape (candidates, q), optional
        Of `novelty_rows`: nearly zero on average, too.
    admitted : bool array, shape (candidates,), optional
        Which may be taken.
    asked : float array, shape (candidates, constraints), optional
        What is to be zero on average over the clones, instead of the parents' moments.
    kept : sequence of int
        Candidates that are rather taken than others.

    Returns
    -------
    Choice or None
        None if what is asked for cannot be had from these candidates.
    """
    if len(values) < count:
        return None
    if len(values) == count and admitted is None and asked is None:
        return Choice(np.arange(count), len(LEVELS) - 1, LEVELS[-1], float(count))
    staying = None
    if len(kept) and admitted is None and asked is None:
        staying = np.zeros(len(values))
        staying[list(kept)] = _STAYING
    like_parents, level, rows = parental_inclusion(values, count, parents, novel, staying)
    p, effective, places = like_parents.probabilities, like_parents.effective, np.arange(len(values))
    if admitted is not None or asked is not None:
        places = np.arange(len(values)) if admitted is None else np.flatnonzero(admitted)
        if len(places) <= count:
            return None
        wanted = np.empty((len(values), 0)) if asked is None else asked
        clipped = np.clip(p, 1e-12, 1.0 - 1e-12)
        odds = np.log(clipped / (1.0 - clipped))
        odds[list(kept)] += _STAYING
        found = inclusion(wanted[places], count, log_odds=odds[places])
        if not found.converged:
            return None
        p, effective = found.probabilities, found.effective
        rows = np.concatenate([wanted, rows], axis=1)[places]
    most = max(1, min(count, len(places) - count) // 3)
    taken = draw_balanced(p, rows[:, :most], rng)
    return Choice(places[taken], level, LEVELS[level], effective)
