"""Directions of meaning in the latent space: flatter, rounder, rougher, larger, the rest held still.

What a latent vector means is learned by regression from many drawn grains: a quadratic function of the
latents for every factor. A step along a meaning is then the smallest change of the latents, measured by
the parents' covariance, that gives the factor what is asked for and leaves the others as they are; what
the regression misses is corrected on the decoded grain itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.factor_regression import FactorRegression
from mbstudio.core.vae.latent import checked_latent
from mbstudio.core.vae.meaning_factors import MEANINGS, meaning_factors
from mbstudio.core.vae.sampling import flip_moments
from mbstudio.core.vae.serialization import Serialization
from mbstudio.core.vae.style_learner import StyleLearner

_SAMPLES = 2000
_PART = 50
"""Grains measured between two reports of progress."""
_STEP = 0.5
"""Longest step, in standard deviations of a factor, for which the regression's slope is taken as constant."""
_CORRECTIONS = 4
_SHARES_OF_WAY = (1.0, 0.6, 0.3, 0.0)
_MISSED = 0.05
"""Standard deviations of a factor that a sum of grains may miss."""
_BEYOND = 0.5
"""Standard deviations beyond the parents' own range that a step may strive for."""

HELD: Mapping[str, tuple[str, ...]] = {
    "size": ("elongation", "csf", "sphericity", "roughness"),
    "elongation": ("size", "csf", "sphericity"),
    "csf": ("size", "elongation", "sphericity"),
    "sphericity": ("size", "elongation", "csf"),
    "roughness": ("size", "elongation", "csf"),
}
"""What each meaning holds still. A grain of given form is the less spherical the rougher it is, so that
sphericity and roughness cannot hold each other."""


@dataclass(frozen=True, eq=False)
class Meanings:
    """The meaning directions of a style-learner.

    Attributes
    ----------
    learner : StyleLearner
    regression : FactorRegression
    mean, deviation : float array, shape (5,)
        Of the factors of `MEANINGS` among the parents: one unit along a meaning is one deviation.
    reach : float array, shape (2, 5)
        Lowest and highest factor that a step strives for: those of the parents, and a little beyond.
    covariance : float array, shape (d, d)
        Of the parents' latents in all their flips.
    """

    learner: StyleLearner
    regression: FactorRegression
    mean: Float[np.ndarray, "5"]
    deviation: Float[np.ndarray, "5"]
    reach: Float[np.ndarray, "2 5"]
    covariance: Float[np.ndarray, "d d"]

    @classmethod
    def of(
        cls, learner: StyleLearner, seed: int = 0, samples: int | None = None, *,
        on_progress: Callable[[float], object] | None = None,
    ) -> Meanings:  # fmt: skip
        """Return the meaning directions of a style-learner, learned from grains that it draws.

        Parameters
        ----------
        learner : StyleLearner
        seed : int
        samples : int, optional
            Grains drawn, 2,000 by default: some seconds.
        on_progress : callable, optional
            Told how far it is, 0 to 1; what it raises ends the work.

        Raises
        ------
        StyleError
            If the parents are all alike in a factor.
        """
        known = meaning_factors(learner.decode(learner.latents))
        deviation = known.std(axis=0, ddof=1) if len(known) > 1 else np.zeros(len(MEANINGS))
        flat = [name for name, value in zip(MEANINGS, deviation, strict=True) if not value > 1e-9]
        if flat:
            raise StyleError(
                f"The parents do not differ in {', '.join(flat)}: such a direction has no meaning for them. "
                "Learn from grains that differ."
            )
        drawn = learner.sample(samples or _SAMPLES, seed)
        found = _measured_in_parts(drawn.serialization, on_progress)
        regression = FactorRegression.of(drawn.latents, found, learner.signs)
        signs = np.ones((8, learner.dimension)) if learner.signs is None else learner.signs
        covariance = flip_moments(learner.latents, signs)[1]
        beyond = _BEYOND * deviation
        reach = np.stack([known.min(axis=0) - beyond, known.max(axis=0) + beyond])
        reach[1, 1:4] = np.minimum(reach[1, 1:4], 0.5 + 0.5 * known.max(axis=0)[1:4])
        return cls(learner, regression, known.mean(axis=0), deviation, reach, covariance)

    def factors(self, latents: Float[np.ndarray, "grains d"]) -> Float64[np.ndarray, "grains 5"]:
        """Return the factors of `MEANINGS` of decoded latent vectors."""
        return meaning_factors(self.learner.decode(latents))

    def units(self, factors: Float[np.ndarray, "... 5"]) -> Float64[np.ndarray, "... 5"]:
        """Return factors in standard deviations about the parents' mean."""
        return (factors - self.mean) / self.deviation

    def moved(
        self, latent: Float[np.ndarray, " d"], steps: Mapping[str, float], *, corrections: int = 1
    ) -> Float64[np.ndarray, " d"]:
        """Return a latent vector moved along meanings.

        Parameters
        ----------
        latent : float array, shape (d,)
        steps : mapping of str to float
            Meaning -> by how many of the parents' standard deviations its factor is to change.
        corrections : int
            How often the decoded grain is measured and the rest made up; 0 follows the regression alone,
            in microseconds.

        Raises
        ------
        StyleError
            If a meaning is not known, or a step is not finite.
        """
        here = checked_latent(self.learner, latent)
        asked = {name: float(step) for name, step in steps.items() if step}
        self._require_known(steps)
        if not asked:
            return here
        wanted = [*asked, *(name for name in self._held_by(tuple(asked)))]
        rows = np.array([MEANINGS.index(name) for name in wanted])
        change = np.array([asked.get(name, 0.0) for name in wanted])
        # Held factors may give a little, where all at once cannot be had.
        slack = np.array([0.02 if name in asked else 0.15 for name in wanted])
        low, high = self.units(self.reach)[:, rows]
        if corrections:
            true = self.units(self.factors(here[None]))[0, rows]
            change = np.clip(true + change, np.minimum(low, true), np.maximum(high, true)) - true
        start = self._estimate(here, rows)
        moved, parts = here, max(1, int(np.ceil(np.abs(change).max() / _STEP)))
        for part in range(parts):
            goal = start + change * (part + 1) / parts
            moved = moved + self._step(moved, rows, goal - self._estimate(moved, rows), slack)
        if corrections:
            moved = self._corrected(moved, rows, true + change, slack, corrections)
        return moved

    def designed(
        self, targets: Mapping[str, float], start: Float[np.ndarray, " d"] | None = None, *,
        tolerance: float = 0.01,
    ) -> Design:  # fmt: skip
        """Return the latent vector nearest to a start that has given factors: inverse design.

        Parameters
        ----------
        targets : mapping of str to float
            Meaning -> factor; `size` is the nominal diameter in the unit of the learner.
        start : float array, shape (d,), optional
            By default that of the parent whose factors are nearest.
        tolerance : float
            Relative error with which the search is content.

        Raises
        ------
        StyleError
            If a meaning is not known, or a target is not finite.
        """
        self._require_known(targets)
        goal = np.array([np.log(v) if name == "size" and v > 0 else v for name, v in targets.items()])
        if not len(goal) or not np.isfinite(goal).all():
            raise StyleError("Give at least one target, each a finite number: for example csf=0.6.")
        rows = np.array([MEANINGS.index(name) for name in targets])
        goal = (goal - self.mean[rows]) / self.deviation[rows]
        moved = self._nearest_parent(rows, goal) if start is None else checked_latent(self.learner, start)
        slack = np.full(len(rows), 0.02)
        first = self._estimate(moved, rows)
        parts = max(1, int(np.ceil(np.abs(goal - first).max() / _STEP)))
        for part in range(parts):
            along = first + (goal - first) * (part + 1) / parts
            moved = moved + self._step(moved, rows, along - self._estimate(moved, rows), slack)
        limit = tolerance * np.abs(goal * self.deviation[rows] + self.mean[rows]) / self.deviation[rows]
        moved = self._corrected(moved, rows, goal, slack, 3 * _CORRECTIONS, limit)
        reached = self.factors(moved[None])[0]
        values = {name: float(reached[row]) for name, row in zip(targets, rows, strict=True)}
        if "size" in values:
            values["size"] = float(np.exp(values["size"]))
        return Design(moved, {name: float(value) for name, value in targets.items()}, values)

    def as_told(
        self, latent: Float[np.ndarray, " d"], way: Float[np.ndarray, " d"], change: Float[np.ndarray, "5"]
    ) -> Float64[np.ndarray, " d"]:
        """Return a latent vector moved as far along a way as its factors can still change as told.

        Parameters
        ----------
        latent, way : float array, shape (d,)
        change : float array, shape (5,)
            Of the factors of `MEANINGS`, in standard deviations; roughness follows from the others.
        """
        rows = np.array([MEANINGS.index(name) for name in MEANINGS if name != "roughness"])
        start = self.units(self.factors(latent[None]))[0, rows]
        low, high = self.units(self.reach)[:, rows]
        goal = np.clip(start + change[rows], np.minimum(low, start), np.maximum(high, start))
        best, least = latent, np.inf
        for share in _SHARES_OF_WAY:
            moved = self._corrected(
                latent + share * way, rows, goal, np.full(len(rows), 0.02), 2 * _CORRECTIONS, _MISSED
            )
            missed = float(np.abs(goal - self.units(self.factors(moved[None]))[0, rows]).max())
            if missed < least:
                best, least = moved, missed
            if missed <= _MISSED:
                break
        return best

    def _corrected(
        self,
        moved: np.ndarray,
        rows: np.ndarray,
        goal: np.ndarray,
        slack: np.ndarray,
        most: int,
        limit: np.ndarray | float = 0.01,
    ) -> np.ndarray:
        """Return a latent vector whose decoded grain comes nearest to the goal; never farther than it was.

        The regression's slopes are mended after every trial by what it really changed (Broyden's rank-one
        update, in latents of unit covariance).
        """
        missing = goal - self.units(self.factors(moved[None]))[0, rows]
        weight = slack.min() / slack
        slopes = self._slopes(moved, rows)
        for _ in range(most):
            if not np.isfinite(missing).all() or (np.abs(missing) <= limit).all():
                break
            step = slopes.T @ np.linalg.solve(slopes @ slopes.T + np.diag(slack**2), missing)
            trial = moved + self._root @ step
            left = goal - self.units(self.factors(trial[None]))[0, rows]
            if not np.isfinite(left).all():
                break
            slopes = slopes + np.outer(missing - left - slopes @ step, step) / max(float(step @ step), 1e-300)
            if np.square(left * weight).sum() < np.square(missing * weight).sum():
                moved, missing = trial, left
        return moved

    @cached_property
    def _root(self) -> Float64[np.ndarray, "d d"]:
        """A matrix R with R R' the parents' covariance."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def _slopes(self, latent: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return the regression's slopes, in deviations of the factors by latents of unit covariance."""
        return self.regression.gradient(latent)[rows] @ self._root / self.deviation[rows][:, None]

    def _nearest_parent(self, rows: np.ndarray, goal: np.ndarray) -> np.ndarray:
        away = self.units(self.factors(self.learner.latents))[:, rows] - goal
        return np.array(self.learner.latents[np.square(away).sum(axis=1).argmin()])

    def _estimate(self, latent: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.asarray(self.units(self.regression.values(latent[None]))[0, rows])

    def _step(
        self, latent: np.ndarray, rows: np.ndarray, wanted: np.ndarray, slack: np.ndarray
    ) -> np.ndarray:
        """Return the most probable change of the latents with which the factors change as wanted."""
        slopes = self._slopes(latent, rows)
        return np.asarray(
            self._root @ (slopes.T @ np.linalg.solve(slopes @ slopes.T + np.diag(slack**2), wanted))
        )

    def _held_by(self, asked: tuple[str, ...]) -> tuple[str, ...]:
        held = [set(HELD[name]) for name in asked]
        return tuple(name for name in MEANINGS if name not in asked and all(name in part for part in held))

    def _require_known(self, names: Mapping[str, float]) -> None:
        for name, value in names.items():
            if name not in MEANINGS:
                raise StyleError(f"'{name}' is no meaning of the latent space: use {', '.join(MEANINGS)}.")
            if not np.isfinite(value):
                raise StyleError(f"'{name}' cannot be {value}: give a finite number.")


def _measured_in_parts(
    drawn: Serialization, on_progress: Callable[[float], object] | None
) -> Float64[np.ndarray, "avatars 5"]:
    parts = []
    for start in range(0, len(drawn), _PART):
        parts.append(meaning_factors(drawn.take(range(start, min(start + _PART, len(drawn))))))
        if on_progress is not None:
            on_progress(0.9 * (start + len(parts[-1])) / len(drawn))
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
