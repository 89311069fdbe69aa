"""Looking for the latent vector nearest to another whose grain has given factors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.serialize.serialization import Serialization
from mbstudio.core.vae.shaping.factor_slopes import factors_and_slopes

_HAIR, _WIDELY = 1e-3, 0.5
"""Standard deviations of a latent over which the decoder is differentiated, at a place and in general."""
_PRICE = 0.05
"""What a change of the latents of one deviation costs, next to a factor that is missed by its slack."""
_PART = 0.75
"""Longest way, in standard deviations of a factor, for which slopes are taken as constant."""
_STALE = 1.0
"""Deviations of the latents after which the decoder is differentiated anew."""
_CLOSELY = 4
"""Rounds from which on the decoder is differentiated where the grain is: of a network, some milliseconds."""
_INSIDE, _WALL = 0.97, 0.02
"""Share of the way to its farthest place that a latent may go, and by how many standard deviations it may
pass that at the price of a missed factor."""
_SHORTEST = 0.1
"""Share of a step below which it is given up."""
_GAIN = 1e-3
"""Share by which a step must lower what is minimised, or the search ends."""


@dataclass(frozen=True, eq=False)
class Place:
    """A latent vector with what its grain is like.

    Attributes
    ----------
    latent : float array, shape (d,)
    units : float array, shape (5,)
        Factors of its grain, in standard deviations about the parents' mean.
    slopes : float array, shape (5, 4 n + 1)
        Their derivatives by control points and ln D_n.
    """

    latent: Float[np.ndarray, " d"]
    units: Float[np.ndarray, "5"]
    slopes: Float[np.ndarray, "5 width"]


@dataclass(frozen=True, eq=False)
class FactorSearch:
    """Gauss-Newton in the latent space, with the exact derivatives of the factors.

    Attributes
    ----------
    learner : StyleLearner
    mean, deviation : float array, shape (5,)
        Of the factors among the parents.
    centre : float array, shape (d,)
        Mean of the parents' latents in all their flips.
    covariance : float array, shape (d, d)
        Theirs about it: directions in which they differ more are the cheaper to go.
    farthest : float array, shape (d,)
        How far each latent may lie from the centre; a start that lies farther out already is drawn in.
    """

    learner: StyleLearner
    mean: Float[np.ndarray, "5"]
    deviation: Float[np.ndarray, "5"]
    centre: Float[np.ndarray, " d"]
    covariance: Float[np.ndarray, "d d"]
    farthest: Float[np.ndarray, " d"]

    def place(self, latent: Float[np.ndarray, " d"]) -> Place:
        """Return a latent vector with the factors of its grain and their derivatives."""
        factors, slopes = factors_and_slopes(self.learner.decode(latent[None]))
        return Place(latent, (factors[0] - self.mean) / self.deviation, slopes[0] / self.deviation[:, None])

    def nearest(
        self,
        start: Place,
        goal: Float[np.ndarray, "5"],
        slack: Float[np.ndarray, "5"],
        rounds: int,
        *,
        price: float = _PRICE,
    ) -> Place:
        """Return the place that makes (factors - goal)**2 / slack**2 + price * distance**2 least.

        Parameters
        ----------
        start : Place
            From here the distance counts, in standard deviations of the parents' latents.
        goal, slack : float array, shape (5,)
            In standard deviations of the factors; a factor of infinite slack may be anything.
        rounds : int
            Most steps; a far goal is come to in parts first.
        price : float
            The dearer the way, the nearer the grain stays.
        """
        asked = np.isfinite(slack)
        goal, slack = goal[asked], slack[asked]
        begun = start.units[asked]
        parts = int(np.clip(np.ceil(np.abs(goal - begun).max(initial=0.0) / _PART), 1, rounds))
        here, away = start, np.zeros(self._root.shape[1])
        quick, differentiated = rounds < _CLOSELY, away
        decoder = self._usual_slopes if quick else self._decoder_slopes(start.latent)
        for turn in range(rounds):
            last = turn >= parts - 1
            aim = goal if last else begun + (goal - begun) * (turn + 1) / parts
            if not quick and np.linalg.norm(away - differentiated) > _STALE:
                differentiated, decoder = away, self._decoder_slopes(here.latent)
            walls, beyond = self._walls(here.latent)
            missed = np.concatenate([(here.units[asked] - aim) / slack, beyond])
            before = missed @ missed + price * away @ away
            slopes = np.concatenate([here.slopes[asked] @ decoder / slack[:, None], walls])
            wanted = slopes.T @ np.linalg.solve(
                slopes @ slopes.T + price * np.eye(len(missed)), slopes @ away - missed
            )
            share, gain = 1.0, 0.0
            while gain <= 0.0 and share > _SHORTEST:
                to = away + share * (wanted - away)
                trial = self.place(start.latent + self._root @ to)
                missed = np.concatenate([(trial.units[asked] - aim) / slack, self._walls(trial.latent)[1]])
                cost = missed @ missed + price * to @ to
                gain, share = before - cost if np.isfinite(cost) else 0.0, 0.5 * share
            if gain > 0.0:
                here, away = trial, to
            if last and gain < _GAIN * before:
                if quick or differentiated is away:
                    break
                differentiated, decoder = away, self._decoder_slopes(here.latent)
        inside = np.clip(here.latent, self.centre - self.farthest, self.centre + self.farthest)
        return here if np.array_equal(inside, here.latent) else self.place(inside)

    def _walls(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much latents lie too far out, in thicknesses of the wall, and the slopes of that."""
        out = latent - self.centre
        over = (np.abs(out) - _INSIDE * self.farthest) / self._thickness
        at = np.flatnonzero(over > 0.0)
        return self._root[at] * (np.sign(out[at]) / self._thickness[at])[:, None], over[at]

    @cached_property
    def _thickness(self) -> Float64[np.ndarray, " d"]:
        spread = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        return np.asarray(_WALL * np.where(spread > 0, spread, 1.0))

    @cached_property
    def _root(self) -> Float64[np.ndarray, "d rank"]:
        """A matrix R with R R' the parents' covariance, of no column in which they do not differ."""
        values, vectors = np.linalg.eigh(self.covariance)
        kept = values > 1e-9 * values.max()
        return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))

    def _decoder_slopes(self, latent: np.ndarray) -> Float64[np.ndarray, "width rank"]:
        """Return the derivatives of control points and ln D_n by latents of unit covariance."""
        core = self._differences(latent, np.arange(self.learner.core))
        return np.asarray(np.concatenate([core, self._detail_slopes], axis=1) @ self._root)

    @cached_property
    def _usual_slopes(self) -> Float64[np.ndarray, "width rank"]:
        """Those at the parents' mean, over a way long enough to be like those elsewhere."""
        every = np.arange(self.learner.dimension)
        return np.asarray(self._differences(self.centre, every, _WIDELY) @ self._root)

    @cached_property
    def _detail_slopes(self) -> Float64[np.ndarray, "width details"]:
        """Details are added to the model's own avatar: their derivatives hardly depend on the place."""
        return self._differences(self.centre, np.arange(self.learner.core, self.learner.dimension))

    def _differences(self, latent: np.ndarray, columns: np.ndarray, width: float = _HAIR) -> np.ndarray:
        spread = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        hair = width * np.where(spread > 0, spread, 1.0)[columns]
        shifts = np.zeros((len(columns), len(latent)))
        shifts[np.arange(len(columns)), columns] = hair
        rows = _control(self.learner.decode(np.concatenate([latent + shifts, latent - shifts])))
        up, down = np.split(rows, 2)
        return np.asarray(((up - down) / (2.0 * hair[:, None])).T)


def _control(avatars: Serialization) -> Float64[np.ndarray, "avatars width"]:
    """Return centers, ln k and ln D_n in a row, in the order of `factors_and_slopes`."""
    return np.concatenate(
        [
            avatars.centers.reshape(len(avatars), 3 * avatars.centers.shape[1]),
            avatars.log_weights,
            np.log(avatars.diameters)[:, None],
        ],
        axis=1,
    )
