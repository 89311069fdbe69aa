"""Where the parents of a style-learner lie, against which a grain shaped by hand is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.shaping import latent as by_hand
from mbstudio.core.vae.shaping.meaning_factors import meaning_factors

_EQUAL = 1e-9
"""Difference of two factors that rounding may make."""


@dataclass(frozen=True, eq=False)
class ParentsRange:
    """Where the parents of a style-learner lie: their factors, and the range of every latent variable.

    Attributes
    ----------
    factors : float array, shape (parents, 5)
        Of `MEANINGS`.
    effects, mean, reach : float array, shape (d,)
        Of each latent variable: its effect on the surface, its mean and how far it may lie from it.
    map : LatentMap or None
        None where the parents differ in fewer than two directions.
    """

    factors: Float64[np.ndarray, "parents 5"]
    effects: Float64[np.ndarray, " d"]
    mean: Float64[np.ndarray, " d"]
    reach: Float64[np.ndarray, " d"]
    map: by_hand.LatentMap | None

    @classmethod
    def measure(cls, learner: StyleLearner) -> ParentsRange:
        """Measure a style-learner's parents: about half a second for 300."""
        try:
            plane = by_hand.latent_map(learner)
        except StyleError:
            plane = None
        return cls(
            meaning_factors(learner.decode(learner.latents)), by_hand.effects(learner),
            by_hand.mean_latent(learner), by_hand.farthest(learner), plane,
        )  # fmt: skip

    def share_below(self, factors: Float64[np.ndarray, "5"]) -> Float64[np.ndarray, "5"]:
        """Return which share of the parents has less of each factor, halves of equals counted."""
        away = self.factors - factors
        return np.asarray((away < -_EQUAL).mean(axis=0) + 0.5 * (np.abs(away) <= _EQUAL).mean(axis=0))
