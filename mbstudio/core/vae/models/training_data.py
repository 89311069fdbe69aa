"""Parents as a training sees them: checked, and a share of them held out."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.features import Scaler
from mbstudio.core.vae.serialize.serialization import Serialization

FEWEST_PARENTS = 5

_FAR = 10.0
_SIZE_GAP = 10.0


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Parents, split into those that a training sees and those held out.

    Attributes
    ----------
    parents : Serialization
    scaler : Scaler
        Of all parents, or of the learner that goes on learning.
    vectors : float array, shape (parents, 4 n + 1)
    trained, held_out : int array
        Rows.
    notes : tuple of str
        What the user should know about these parents.
    """

    parents: Serialization
    scaler: Scaler
    vectors: Float64[np.ndarray, "parents width"]
    trained: Int[np.ndarray, " trained"]
    held_out: Int[np.ndarray, " held_out"]
    notes: tuple[str, ...] = ()

    @classmethod
    def from_parents(
        cls, parents: Serialization, held_out: float, seed: int, scaler: Scaler | None = None
    ) -> TrainingData:
        """Return the data of parents of which a share is held out.

        Parameters
        ----------
        parents : Serialization
            At least 5.
        held_out : float
            Share, 0 to 0.5; of a positive share at least one parent.
        seed : int
            Of the choice.
        scaler : Scaler, optional
            Of a learner that goes on learning.

        Raises
        ------
        StyleError
            If the parents are too few, all alike, or one does not belong to the others.
        """
        if not 0 <= held_out <= 0.5:
            raise StyleError(
                f"A share of {held_out:g} of the parents cannot be held out: give a share from 0 to 0.5."
            )
        _check_number(parents)
        _check_sizes(parents)
        scaler = Scaler.from_parents(parents) if scaler is None else scaler
        vectors = scaler.vectors(parents)
        _check_shapes(parents, vectors)
        count = len(parents)
        aside = max(1, round(held_out * count)) if held_out else 0
        order = np.random.default_rng([seed, 1]).permutation(count)
        return cls(
            parents, scaler, vectors, np.sort(order[aside:]), np.sort(order[:aside]), _notes(parents, vectors)
        )

    def split(self, trained: Int[np.ndarray, " t"], held_out: Int[np.ndarray, " h"]) -> TrainingData:
        """Return the same parents, split in another way."""
        return TrainingData(self.parents, self.scaler, self.vectors, trained, held_out, self.notes)

    @property
    def digest(self) -> str:
        """SHA-256 of all numbers, to know the same parents again."""
        whole = hashlib.sha256(self.parents.unit.encode())
        template = self.parents.template
        arrays = (template.centers, template.log_weights, self.vectors, self.trained, self.held_out)
        for array in arrays:
            whole.update(np.ascontiguousarray(array).tobytes())
        return whole.hexdigest()


def _check_number(parents: Serialization) -> None:
    if len(parents) < FEWEST_PARENTS:
        raise StyleError(
            f"{len(parents)} parents are too few to learn a style from: give at least {FEWEST_PARENTS}."
        )


def _check_sizes(parents: Serialization) -> None:
    """Refuse a body a whole magnitude apart from all others: a wrong unit or voxel size."""
    order = np.argsort(parents.diameters, kind="stable")
    sizes = parents.diameters[order]
    for row, neighbour in ((order[-1], sizes[-1] / sizes[-2]), (order[0], sizes[1] / sizes[0])):
        if neighbour > _SIZE_GAP:
            raise StyleError(
                f"Parent '{parents.names[row]}' has D_n = {parents.diameters[row]:.4g} {parents.unit}, the "
                f"median is {np.median(sizes):.4g} {parents.unit} and none is near it: check its unit or "
                "voxel size, or leave it out."
            )


def _check_shapes(parents: Serialization, vectors: Float64[np.ndarray, "parents width"]) -> None:
    far = np.abs(parents.centers).max(axis=(1, 2))
    if far.max() > _FAR:
        row = int(far.argmax())
        raise StyleError(
            f"Parent '{parents.names[row]}' has a control point {far[row]:.4g} D_n from its centroid: "
            "serialize it again or leave it out."
        )
    if np.abs(vectors - vectors.mean(0)).max() < 1e-9:
        raise StyleError(
            f"All {len(parents)} parents are the same avatar, so there is no style to learn. "
            "Give different ones."
        )


def _notes(parents: Serialization, vectors: Float64[np.ndarray, "parents width"]) -> tuple[str, ...]:
    notes = []
    copies = len(vectors) - len(np.unique(vectors.round(9), axis=0))
    if copies:
        notes.append(f"{copies} of {len(vectors)} parents are copies of others and count more than once.")
    broken = int((~parents.valid).sum())
    if broken:
        notes.append(
            f"{broken} of {len(vectors)} parents are no valid particles (pieces, voids or stray control "
            "points): their clones may not be either."
        )
    return tuple(notes)
