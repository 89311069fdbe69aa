"""Directions of meaning in the latent space: flatter, rounder, rougher, larger, the rest held still.

A step along a meaning is the smallest change of the latents, measured by the parents' covariance, that
gives the factor what is asked for and leaves the others as they are. It is found on the decoded grain
itself, with the exact derivatives of its factors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.metrics.form_bound import FLATTEST, highest_sphericity
from mbstudio.core.vae.models.sampling import flip_moments
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.serialize.serialization import Serialization
from mbstudio.core.vae.shaping.factor_search import FactorSearch, Place
from mbstudio.core.vae.shaping.latent import align_to, check_latent, farthest
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS, meaning_factors

_PARTS = 50
"""Grains measured between two reports of progress."""
_ROUNDS = 8
_ASKED, _HELD = 0.05, 0.2
"""Standard deviations by which an asked factor may be missed for every one by which others drift."""
_LEAST_STEP = 0.25
_BEYOND = 0.5
"""Standard deviations beyond the parents' own range that a step may strive for."""
_SUMMED, _ROUGHER = 0.05, 5.0
"""Share of a factor's change that a sum of grains may miss, and how many times more of roughness."""
_SHARES_OF_WAY = (1.0, 0.5, 0.0)
_SHARED = 5.0
"""How many times more than its share a factor may miss before less of a sum's way is gone."""
_STARTS = 4
_PRICES = (0.05, 0.002, 0.0001)
_DESIGN_ROUNDS = 15
_CONTENT = 0.25
"""Share of the tolerance within which a design asks for no other start."""

HELD: Mapping[str, tuple[str, ...]] = {
    name: tuple(other for other in MEANINGS if other != name) for name in MEANINGS
}
"""What each meaning holds still."""


@dataclass(frozen=True, eq=False)
class Meanings:
    """The meaning directions of a style-learner.

    Attributes
    ----------
    learner : StyleLearner
    known : float array, shape (parents, 5)
        Factors of `MEANINGS` of the parents, as the learner rebuilds them.
    """

    learner: StyleLearner
    known: Float[np.ndarray, "parents 5"]

    @classmethod
    def measure(
        cls, learner: StyleLearner, *, on_progress: Callable[[float], object] | None = None
    ) -> Meanings:
        """Return the meaning directions of a style-learner: its parents are measured.

        Parameters
        ----------
        learner : StyleLearner
        on_progress : callable, optional
            Told how far it is, 0 to 1; what it raises ends the work.

        Raises
        ------
        StyleError
            If the parents are all alike in a factor.
        """
        known = _measured_in_parts(learner.decode(learner.latents), on_progress)
        deviation = known.std(axis=0, ddof=1) if len(known) > 1 else np.zeros(len(MEANINGS))
        flat = [name for name, value in zip(MEANINGS, deviation, strict=True) if not value > 1e-9]
        if flat:
            raise StyleError(
                f"The parents do not differ in {', '.join(flat)}: such a direction would have no meaning. "
                "Learn from grains that differ."
            )
        return cls(learner, known)

    @cached_property
    def mean(self) -> Float64[np.ndarray, "5"]:
        """Mean of the factors among the parents."""
        return np.asarray(self.known.mean(axis=0))

    @cached_property
    def deviation(self) -> Float64[np.ndarray, "5"]:
        """Standard deviation of the factors among the parents: one unit along a meaning."""
        return np.asarray(self.known.std(axis=0, ddof=1))

    @cached_property
    def reach(self) -> Float64[np.ndarray, "2 5"]:
        """Lowest and highest factor that a step strives for: those of the parents, and a little beyond."""
        low, high = self.known.min(axis=0), self.known.max(axis=0)
        reach = np.stack([low - _BEYOND * self.deviation, high + _BEYOND * self.deviation])
        # Ratios are at most 1, and roughness is at least 0.
        reach[1, 1:4] = np.minimum(reach[1, 1:4], 0.5 + 0.5 * high[1:4])
        reach[0, 4] = max(float(reach[0, 4]), 0.5 * float(low[4]))
        return reach

    @cached_property
    def search(self) -> FactorSearch:
        """How latent vectors of given factors are looked for."""
        signs = self.learner.signs
        signs = np.ones((8, self.learner.dimension)) if signs is None else signs
        centre, covariance = flip_moments(self.learner.latents, signs)
        most = farthest(self.learner)
        return FactorSearch(self.learner, self.mean, self.deviation, centre, covariance, most)

    def factors(self, latents: Float[np.ndarray, "grains d"]) -> Float64[np.ndarray, "grains 5"]:
        """Return the factors of `MEANINGS` of decoded latent vectors."""
        return meaning_factors(self.learner.decode(latents))

    def units(self, factors: Float[np.ndarray, "... 5"]) -> Float64[np.ndarray, "... 5"]:
        """Return factors in standard deviations about the parents' mean."""
        standard: np.ndarray = (factors - self.mean) / self.deviation
        return standard

    def move_along(
        self, latent: Float[np.ndarray, " d"], steps: Mapping[str, float], *, corrections: int = _ROUNDS
    ) -> Float64[np.ndarray, " d"]:
        """Return a latent vector moved along meanings, every other factor held still.

        Parameters
        ----------
        latent : float array, shape (d,)
        steps : mapping of str to float
            Meaning -> by how many of the parents' standard deviations its factor is to change.
        corrections : int
            How often the grain is measured on the way; 2 follow a slider.

        Raises
        ------
        StyleError
            If a meaning is not known, or a step is not finite.

        Notes
        -----
        Steps end where the parents' range does. What cannot be had with all others still is shared: a
        grain as flat as it can be for its sphericity becomes a little less spherical.
        """
        here = check_latent(self.learner, latent)
        self._require_known(steps)
        change = np.array([float(steps.get(name, 0.0)) for name in MEANINGS])
        if not change.any():
            return here
        start = self.search.place(here)
        return self._move(start, start.units + change, change != 0.0, corrections)

    def bring_to(
        self, latent: Float[np.ndarray, " d"], values: Mapping[str, float], *, corrections: int = _ROUNDS
    ) -> Float64[np.ndarray, " d"]:
        """Return a latent vector moved along meanings to given values, every other factor held still.

        Parameters
        ----------
        latent : float array, shape (d,)
        values : mapping of str to float
            Meaning -> factor, in standard deviations about the parents' mean.
        corrections : int
            As in :meth:`move_along`.

        Raises
        ------
        StyleError
            If a meaning is not known, or a value is not finite.
        """
        here = check_latent(self.learner, latent)
        self._require_known(values)
        start = self.search.place(here)
        goal = np.array([values.get(name, now) for name, now in zip(MEANINGS, start.units, strict=True)])
        asked = np.array([name in values for name in MEANINGS])
        return self._move(start, goal, asked, corrections)

    def _move(self, start: Place, goal: np.ndarray, asked: np.ndarray, rounds: int) -> np.ndarray:
        goal = self._within_reach(start.units, goal)
        longest = max(float(np.abs(goal - start.units).max()), _LEAST_STEP)
        slack = np.where(asked, _ASKED, _HELD * longest)
        return self.search.nearest(start, goal, slack, max(1, rounds)).latent

    def design(
        self, targets: Mapping[str, float], start: Float[np.ndarray, " d"] | None = None, *,
        tolerance: float = 0.02,
    ) -> Design:  # fmt: skip
        """Return a latent vector near the parents whose grain has given factors: inverse design.

        Parameters
        ----------
        targets : mapping of str to float
            Meaning -> factor; `size` is the nominal diameter in the unit of the learner.
        start : float array, shape (d,), optional
            Where to begin. By default with the parents whose factors are nearest, one after another until
            the targets are met.
        tolerance : float
            Relative error that is meant to be undercut: the search strives for a quarter of it.

        Raises
        ------
        StyleError
            If a meaning is not known, or a target is not finite.
        """
        self._require_known(targets)
        if not targets or not all(np.isfinite(value) and value > 0 for value in targets.values()):
            raise StyleError("Give at least one target, each a finite number above 0: for example csf=0.6.")
        if not tolerance > 0:
            raise StyleError(f"The relative error must be above 0, not {tolerance}.")
        goal, slack = np.zeros(len(MEANINGS)), np.full(len(MEANINGS), np.inf)
        for name, value in targets.items():
            row = MEANINGS.index(name)
            # An error of ln D_n is a relative one of D_n.
            goal[row], error = (np.log(value), 1.0) if name == "size" else (value, value)
            slack[row] = 0.25 * tolerance * error / self.deviation[row]
        asked = np.isfinite(slack)
        goal = np.where(asked, (goal - self.mean) / self.deviation, 0.0)
        given = None if start is None else check_latent(self.learner, start)
        starts = self._nearest_parents(goal, slack) if given is None else [given]
        best: Design | None = None
        for latent in starts:
            begin = self.search.place(latent)
            # The dearer the way, the nearer the grain stays; where the targets are missed it gets cheaper.
            for price in _PRICES:
                begin = self.search.nearest(begin, goal, slack, _DESIGN_ROUNDS, price=price)
                design = self._design(targets, begin)
                if best is None or design.residual < best.residual:
                    best = design
                if best.residual <= _CONTENT * tolerance:
                    return best
        assert best is not None
        return best

    def _design(self, targets: Mapping[str, float], found: Place) -> Design:
        reached = found.units * self.deviation + self.mean
        values = {name: float(reached[MEANINGS.index(name)]) for name in targets}
        if "size" in values:
            values["size"] = float(np.exp(values["size"]))
        return Design(found.latent, {name: float(value) for name, value in targets.items()}, values)

    def change_factors(
        self, latent: Float[np.ndarray, " d"], way: Float[np.ndarray, " d"], change: Float[np.ndarray, "5"]
    ) -> Float64[np.ndarray, " d"]:
        """Return the latent vector nearest to a way's end whose factors change as told.

        Parameters
        ----------
        latent, way : float array, shape (d,)
        change : float array, shape (5,)
            Of the factors of `MEANINGS`, in standard deviations; what goes beyond the parents' range is
            left out, and roughness may miss more than the others.
        """
        here = self.search.place(check_latent(self.learner, latent))
        goal = self._within_reach(here.units, here.units + change)
        # What cannot be had is shared: each factor misses by a like share of its change, in its direction.
        size = np.maximum(np.abs(goal - here.units), _LEAST_STEP)
        slack = _SUMMED * size * np.where(np.array(MEANINGS) == "roughness", _ROUGHER, 1.0)
        best, least = here, np.inf
        for share in _SHARES_OF_WAY:
            begin = self.search.place(latent + share * way) if share else here
            found = self.search.nearest(begin, goal, slack, _ROUNDS)
            missed = float((np.abs(found.units - goal) / slack).max())
            if missed < least:
                best, least = found, missed
            if missed <= _SHARED:
                break
        return best.latent

    def _within_reach(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Return a goal no farther out than the parents, or than the start lies already."""
        low, high = self.units(self.reach)
        reachable: np.ndarray = np.clip(goal, np.minimum(low, start), np.maximum(high, start))
        return reachable

    def _nearest_parents(self, goal: np.ndarray, slack: np.ndarray) -> list[np.ndarray]:
        away = np.square((self.units(self.known) - goal) / slack).sum(axis=1)
        return [np.array(self.learner.latents[row]) for row in np.argsort(away, kind="stable")[:_STARTS]]

    def _require_known(self, names: Mapping[str, float]) -> None:
        for name, value in names.items():
            if name not in MEANINGS:
                raise StyleError(f"'{name}' is not a meaning of the latent space: use {', '.join(MEANINGS)}.")
            if not np.isfinite(value):
                raise StyleError(f"The value of '{name}' must be a finite number, not {value}.")


def _measured_in_parts(
    grains: Serialization, on_progress: Callable[[float], object] | None
) -> Float64[np.ndarray, "avatars 5"]:
    parts = []
    for start in range(0, len(grains), _PARTS):
        parts.append(meaning_factors(grains.take(range(start, min(start + _PARTS, len(grains))))))
        if on_progress is not None:
            on_progress((start + len(parts[-1])) / len(grains))
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Design:
    """What inverse design found.

    Attributes
    ----------
    latent : float array, shape (d,)
    targets, reached : dict of str to float
        What was asked for, and what the decoded grain has.
    """

    latent: Float[np.ndarray, " d"]
    targets: dict[str, float]
    reached: dict[str, float]

    @property
    def residual(self) -> float:
        """Largest relative error of the factors."""
        return max(abs(self.reached[name] / value - 1.0) for name, value in self.targets.items())

    def is_possible(self, tolerance: float = 0.0) -> bool:
        """Return whether any body can have these factors, each within a relative error.

        A flat body cannot be as spherical as one may wish: see
        :func:`~mbstudio.core.metrics.form_bound.highest_sphericity`.
        """
        ratios = (self.targets.get(name, 0.0) for name in ("csf", "elongation", "sphericity"))
        if max(ratios) * (1.0 - tolerance) > 1.0:
            return False
        fullest = self.targets.get("csf", 1.0) * (1.0 + tolerance)
        if not FLATTEST <= fullest <= 1.0:
            return True
        return self.targets.get("sphericity", 0.0) * (1.0 - tolerance) <= highest_sphericity(fullest)


def add_difference(
    learner: StyleLearner,
    base: Float[np.ndarray, " d"],
    plus: Float[np.ndarray, " d"],
    minus: Float[np.ndarray, " d"],
    strength: float = 1.0,
    *,
    meanings: Meanings | None = None,
) -> Float64[np.ndarray, " d"]:
    """Return what makes one grain differ from another, added to a third: z3 + s (z1 - z2).

    Parameters
    ----------
    base, plus, minus : float array, shape (d,)
        z3, z1 and z2.
    strength : float
    meanings : Meanings, optional
        Then the sum's factors are made to differ from the base's as those of z1 differ from z2, as far as
        the parents go: a plain sum of vectors that have nothing to do with each other is always rougher.

    Raises
    ------
    StyleError
        If the strength is not finite, or a latent vector none of this learner.
    """
    if not np.isfinite(strength):
        raise StyleError(f"The strength of a difference must be a finite number, not {strength}.")
    here = check_latent(learner, base)
    first = align_to(learner, here, plus)
    second = align_to(learner, first, minus)
    way = strength * (first - second)
    if meanings is None:
        there: np.ndarray = here + way
        return there
    ours, theirs = meanings.units(meanings.factors(np.stack([first, second])))
    return meanings.change_factors(here, way, strength * np.asarray(ours - theirs))
