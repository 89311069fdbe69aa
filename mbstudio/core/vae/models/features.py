"""The vector of one avatar on which every style-learner works, and its scaler."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.special import ndtri

from mbstudio.core.errors import StyleError
from mbstudio.core.units import conversion_factor
from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization, Template

CENTER_SCALE = 5.0
"""By which a shift of a control point in D_n is multiplied: about its standard deviation becomes 0.2."""

WEIGHT_SCALE = 0.5
"""By which a change of ln k is multiplied: a weight moves the surface less than its point does."""


def character(parity: Int[np.ndarray, "..."] | int) -> Float64[np.ndarray, "8 ..."]:
    """Return the signs that flips 0 to 7 give to quantities of a parity.

    Parameters
    ----------
    parity : int array
        Bits 0, 1, 2: whether the quantity changes its sign with x, y, z.

    Returns
    -------
    float array, shape (8, ...)
        1 or -1.
    """
    parity = np.asarray(parity, dtype=np.int64)
    common = np.arange(8).reshape(8, *[1] * parity.ndim) & parity[None]
    signs: np.ndarray = 1.0 - 2.0 * ((common ^ common >> 1 ^ common >> 2) & 1)
    return signs


@dataclass(frozen=True, eq=False)
class Scaler:
    """From serialized avatars to vectors and back.

    A vector holds ``5 dx`` of every control point, ``0.5 dln k`` of every one (both relative to the
    template), and the normal score of D_n: 4 n + 1 numbers. The normal score of a size is the standard
    normal quantile of its rank among the parents, so that drawing it from a normal distribution gives
    sizes distributed like the parents', however skew or many-peaked these are.

    Attributes
    ----------
    template : Template
    unit : str
        Of the nominal diameters.
    log_sizes : float array, shape (knots,)
        ln D_n of the parents, rising, each once. Read-only.
    scores : float array, shape (knots,)
        Their normal scores; straight lines between and beyond. Read-only.
    """

    template: Template
    unit: str
    log_sizes: Float64[np.ndarray, " knots"]
    scores: Float64[np.ndarray, " knots"]

    def __post_init__(self) -> None:
        log_sizes, scores = np.array(self.log_sizes, float), np.array(self.scores, float)
        rising = log_sizes.shape == scores.shape and log_sizes.ndim == 1 and len(scores) > 0
        if not (rising and (np.diff(log_sizes) > 0).all() and (np.diff(scores) > 0).all()):
            raise StyleError("The normal scores of the parents' sizes do not rise with the sizes.")
        for name, array in (("log_sizes", log_sizes), ("scores", scores)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def from_parents(cls, parents: Serialization) -> Scaler:
        """Return the scaler of these parents."""
        # Sizes that differ by rounding only are one.
        log_sizes, counts = np.unique(np.log(parents.diameters).round(9), return_counts=True)
        ranks = (np.cumsum(counts) - 0.5 * counts) / counts.sum()
        return cls(parents.template, parents.unit, log_sizes, ndtri(ranks))

    def with_sizes(self, factor: float) -> Scaler:
        """Return the scaler of parents that are so many times as large."""
        return replace(self, log_sizes=self.log_sizes + np.log(factor))

    def _slopes(self) -> tuple[float, float]:
        """Return d score / d ln D_n below the smallest and above the largest parent.

        Of the straight line through all parents, or the last two if that lets sizes run away less.
        """
        if len(self.scores) < 2:
            return 1.0, 1.0
        whole = (self.scores[-1] - self.scores[0]) / (self.log_sizes[-1] - self.log_sizes[0])
        steps = np.diff(self.scores) / np.diff(self.log_sizes)
        return float(max(whole, steps[0])), float(max(whole, steps[-1]))

    def size_scores(self, log_sizes: Float[np.ndarray, " sizes"]) -> Float64[np.ndarray, " sizes"]:
        """Return the normal scores of ln D_n, D_n in the scaler's unit."""
        low, high = self._slopes()
        inside = np.interp(log_sizes, self.log_sizes, self.scores)
        below = np.minimum(log_sizes - self.log_sizes[0], 0.0)
        above = np.maximum(log_sizes - self.log_sizes[-1], 0.0)
        scores: np.ndarray = inside + low * below + high * above
        return scores

    def sizes_of_scores(self, scores: Float[np.ndarray, " sizes"]) -> Float64[np.ndarray, " sizes"]:
        """Return ln D_n of normal scores."""
        low, high = self._slopes()
        inside = np.interp(scores, self.scores, self.log_sizes)
        below = np.minimum(scores - self.scores[0], 0.0)
        above = np.maximum(scores - self.scores[-1], 0.0)
        log_sizes: np.ndarray = inside + below / low + above / high
        return log_sizes

    @property
    def width(self) -> int:
        """Length of a vector, 4 n + 1."""
        return 4 * self.template.n + 1

    def check(self, avatars: Serialization) -> None:
        """Refuse avatars that are not serialized from this template.

        Raises
        ------
        StyleError
            If they have another number of control points, or another template.
        """
        theirs, ours = avatars.template, self.template
        if theirs.n != ours.n:
            raise StyleError(
                f"The avatars have n = {theirs.n} control points and the style-learner n = {ours.n}: "
                f"serialize them with the learner's template (n = {ours.n})."
            )
        alike = np.allclose(theirs.centers, ours.centers, atol=1e-5) and np.allclose(
            theirs.log_weights, ours.log_weights, atol=1e-5
        )
        if not (alike and np.array_equal(theirs.exchange, ours.exchange)):
            raise StyleError(
                "The avatars were serialized from another template than the style-learner's: their control "
                "points do not mean the same. Serialize them with the learner's template."
            )

    def sizes(self, avatars: Serialization) -> Float64[np.ndarray, " avatars"]:
        """Return the normal scores of D_n, whatever the unit of the avatars."""
        return self.size_scores(np.log(avatars.diameters * conversion_factor(avatars.unit, self.unit)))

    def vectors(self, avatars: Serialization) -> Float64[np.ndarray, "avatars width"]:
        """Return the vectors of avatars serialized from this template."""
        self.check(avatars)
        return np.concatenate(
            [
                CENTER_SCALE * (avatars.centers - self.template.centers).reshape(len(avatars), -1),
                WEIGHT_SCALE * (avatars.log_weights - self.template.log_weights),
                self.sizes(avatars)[:, None],
            ],
            axis=1,
        )

    def avatars(
        self, vectors: Float[np.ndarray, "avatars width"], names: tuple[str, ...] | None = None
    ) -> Serialization:
        """Return the avatars of vectors, with no grain to compare with and not checked for validity."""
        vectors = np.asarray(vectors, dtype=np.float64)
        count, n = len(vectors), self.template.n
        return Serialization(
            template=self.template,
            centers=self.template.centers + vectors[:, : 3 * n].reshape(count, n, 3) / CENTER_SCALE,
            log_weights=self.template.log_weights + vectors[:, 3 * n : 4 * n] / WEIGHT_SCALE,
            diameters=np.exp(self.sizes_of_scores(vectors[:, -1])),
            unit=self.unit,
            names=names or clone_names(count),
            rms=np.full(count, np.nan),
            valid=np.ones(count, dtype=bool),
        )

    def flip_table(self) -> tuple[Int[np.ndarray, "8 width"], Float64[np.ndarray, "8 width"]]:
        """Return which element takes each place of a vector after each flip, and with which sign."""
        n = self.template.n
        exchange = self.template.exchange
        points = (3 * exchange[:, :, None] + np.arange(3)).reshape(8, 3 * n)
        sources = np.concatenate([points, 3 * n + exchange, np.full((8, 1), 4 * n)], axis=1)
        signs = np.ones((8, 4 * n + 1))
        signs[:, : 3 * n] = np.tile(FLIPS, (1, n))
        return sources, signs


def clone_names(count: int) -> tuple[str, ...]:
    """Return names of so many clones."""
    digits = len(str(max(count, 1)))
    return tuple(f"clone {i + 1:0{digits}d}" for i in range(count))


def flipped_vectors(
    vectors: Float[np.ndarray, "avatars width"],
    table: tuple[Int[np.ndarray, "8 width"], Float64[np.ndarray, "8 width"]],
    flip: int,
) -> Float64[np.ndarray, "avatars width"]:
    """Return vectors of the avatars flipped by one flip; `table` of :meth:`Scaler.flip_table`."""
    flipped: np.ndarray = vectors[:, table[0][flip]] * table[1][flip]
    return flipped


def parity_parts(
    vectors: Float[np.ndarray, "avatars width"],
    table: tuple[Int[np.ndarray, "8 width"], Float64[np.ndarray, "8 width"]],
) -> Float64[np.ndarray, "8 avatars width"]:
    """Return the parts of vectors by parity; they add up to the vectors and are orthogonal."""
    signs = character(np.arange(8))
    parts = np.zeros((8, *np.shape(vectors)))
    for flip in range(8):
        parts += signs[flip][:, None, None] * flipped_vectors(vectors, table, flip) / 8.0
    return parts
