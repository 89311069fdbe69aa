"""What a latent vector means: factors as quadratic functions of the latents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

_RIDGE = 1e-3
_CROSSED = 16
"""So many of the first latents, the most varied ones, also enter as products with each other."""


@dataclass(frozen=True, eq=False)
class FactorRegression:
    """Quadratic functions of the latents, one a factor, even under the flips of the axes.

    Attributes
    ----------
    scale : float array, shape (d,)
        By which latents are divided first.
    linear : int array, shape (a,)
        Latents that enter as they are: those that no flip changes.
    pairs : int array, shape (b, 2)
        Pairs of latents that enter as products, squares first.
    constant : float array, shape (factors,)
    slopes : float array, shape (a + b, factors)
    determination : float array, shape (factors,)
        R**2 on drawn grains that the regression has not seen.
    """

    scale: Float[np.ndarray, " d"]
    linear: Int[np.ndarray, " a"]
    pairs: Int[np.ndarray, "b 2"]
    constant: Float[np.ndarray, " factors"]
    slopes: Float[np.ndarray, "terms factors"]
    determination: Float[np.ndarray, " factors"]

    def _terms(self, latents: Float[np.ndarray, "grains d"]) -> Float64[np.ndarray, "grains terms"]:
        scaled = latents / self.scale
        return np.concatenate(
            [scaled[:, self.linear], scaled[:, self.pairs[:, 0]] * scaled[:, self.pairs[:, 1]]], axis=1
        )

    def values(self, latents: Float[np.ndarray, "grains d"]) -> Float64[np.ndarray, "grains factors"]:
        """Return the factors of latent vectors."""
        return self.constant + self._terms(latents) @ self.slopes

    def gradient(self, latent: Float[np.ndarray, " d"]) -> Float64[np.ndarray, "factors d"]:
        """Return the derivatives of the factors by the latents, at one latent vector."""
        scaled, a = latent / self.scale, len(self.linear)
        out = np.zeros((len(latent), self.slopes.shape[1]))
        np.add.at(out, self.linear, self.slopes[:a])
        first, second = self.pairs.T
        np.add.at(out, first, scaled[second][:, None] * self.slopes[a:])
        np.add.at(out, second, scaled[first][:, None] * self.slopes[a:])
        return (out / self.scale[:, None]).T

    @classmethod
    def of(
        cls, latents: Float[np.ndarray, "grains d"], factors: Float[np.ndarray, "grains factors"],
        signs: Float[np.ndarray, "8 d"] | None,
    ) -> FactorRegression:  # fmt: skip
        """Return the regression of factors on latents, by ridge on four fifths, judged by the rest."""
        d = latents.shape[1]
        signs = np.ones((8, d)) if signs is None else signs
        deviation = latents.std(axis=0)
        scale = np.where(deviation > 1e-12, deviation, np.inf)
        # What the latents decode to, not their own spread, says which matter; they come in that order.
        first = [(i, j) for i in range(min(_CROSSED, d)) for j in range(i)]
        same = [pair for pair in first if np.array_equal(signs[:, pair[0]], signs[:, pair[1]])]
        pairs = np.array([(i, i) for i in range(d)] + same, dtype=np.int64)
        linear = np.flatnonzero((signs == 1.0).all(axis=0))
        blank = cls(scale, linear, pairs, np.zeros(0), np.zeros((0, 0)), np.zeros(0))
        terms = blank._terms(latents)
        judged = np.arange(len(latents)) % 5 == 0
        mean, values = terms[~judged].mean(axis=0), factors[~judged].mean(axis=0)
        away, spread = terms[~judged] - mean, factors[~judged] - values
        penalty = _RIDGE * len(away) * np.diag(np.maximum(np.square(away).mean(axis=0), 1e-12))
        slopes = np.linalg.solve(away.T @ away + penalty, away.T @ spread)
        missed = factors[judged] - values - (terms[judged] - mean) @ slopes
        spread = factors[judged] - factors[judged].mean(axis=0)
        left = np.square(missed).sum(axis=0) / np.maximum(np.square(spread).sum(axis=0), 1e-300)
        return cls(scale, linear, pairs, values - mean @ slopes, slopes, 1.0 - left)
