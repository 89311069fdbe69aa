"""The vector of one avatar on which every style-learner works, and its scaler."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.errors import StyleError
from mbstudio.core.units import conversion_factor
from mbstudio.core.vae.serialization import FLIPS, Serialization, Template

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
    return 1.0 - 2.0 * ((common ^ common >> 1 ^ common >> 2) & 1)


@dataclass(frozen=True, eq=False)
class Scaler:
    """From serialized avatars to vectors and back.

    A vector holds ``5 dx`` of every control point, ``0.5 dln k`` of every one (both relative to the
    template), and the standardised ln D_n: 4 n + 1 numbers.

    Attributes
    ----------
    template : Template
    unit : str
        Of the nominal diameters.
    log_mean, log_deviation : float
        Of ln D_n over the parents; a deviation of 1 where all have one size.
    """

    template: Template
    unit: str
    log_mean: float
    log_deviation: float

    @classmethod
    def of(cls, parents: Serialization) -> Scaler:
        """Return the scaler of these parents."""
        logs = np.log(parents.diameters)
        deviation = float(logs.std())
        return cls(parents.template, parents.unit, float(logs.mean()), deviation if deviation > 1e-9 else 1.0)

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
        """Return the standardised ln D_n, whatever the unit of the avatars."""
        logs = np.log(avatars.diameters * conversion_factor(avatars.unit, self.unit))
        return (logs - self.log_mean) / self.log_deviation

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
            diameters=np.exp(self.log_mean + self.log_deviation * vectors[:, -1]),
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
    return vectors[:, table[0][flip]] * table[1][flip]


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
