"""Principal components of serialized avatars: the linear style-learner that the others must beat."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.errors import StyleError
from mbstudio.core.options import OptionRecord, option
from mbstudio.core.threads import one_thread
from mbstudio.core.vae.models.features import Scaler, character, parity_parts
from mbstudio.core.vae.models.joining import hold_together
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.sampling import split_bands
from mbstudio.core.vae.models.shape_model import Tensors
from mbstudio.core.vae.models.style_preset import StylePreset
from mbstudio.core.vae.models.training_data import TrainingData
from mbstudio.core.vae.serialize.serialization import Serialization

LATENTS = 107
"""Principal components kept where there are enough parents."""

_NO_VARIANCE = 1e-10


@dataclass(frozen=True)
class PrincipalOptions(OptionRecord, owner="preset 'pca'", error=StyleError):
    """Options of preset `pca`."""

    latents: int = option(LATENTS, "Principal components at most.", minimum=1)
    held_out: float = option(
        0.1,
        "Share of the parents by which the error is measured; the model is then made of all of them.",
    )


@dataclass(frozen=True, eq=False)
class PrincipalComponents:
    """Orthonormal components of vectors, each of one parity under the flips of the axes.

    Attributes
    ----------
    mean : float array, shape (width,)
        Of the vectors in all their flips.
    components : float array, shape (latents, width)
        Falling variance.
    parities : int array, shape (latents,)
        Bits 0, 1, 2: whether a score changes its sign with x, y, z.
    """

    mean: Float[np.ndarray, " width"]
    components: Float[np.ndarray, "latents width"]
    parities: Int[np.ndarray, " latents"]

    def scores(self, vectors: Float[np.ndarray, "avatars width"]) -> Float64[np.ndarray, "avatars latents"]:
        """Return the scores of vectors."""
        scores: np.ndarray = (vectors - self.mean) @ self.components.T
        return scores

    def vectors(self, scores: Float[np.ndarray, "avatars latents"]) -> Float64[np.ndarray, "avatars width"]:
        """Return the vectors of scores."""
        vectors: np.ndarray = self.mean + scores @ self.components
        return vectors


def principal_components(
    vectors: Float[np.ndarray, "avatars width"],
    table: tuple[Int[np.ndarray, "8 width"], Float64[np.ndarray, "8 width"]],
    latents: int,
) -> PrincipalComponents:
    """Return the principal components of vectors in all their eight flips.

    Parameters
    ----------
    vectors : float array, shape (avatars, width)
    table : tuple of arrays
        What the flips do to a vector, of :meth:`mbstudio.core.vae.models.features.Scaler.flip_table`.
    latents : int
        At most so many; fewer where the vectors do not vary in more directions.

    Notes
    -----
    The covariance of flipped vectors does not mix parities, so each parity has its own components: a
    flip of the avatar changes signs of scores and nothing else, and every parent counts eight times.
    """
    parts = parity_parts(np.asarray(vectors, dtype=np.float64), table)
    mean = parts[0].mean(0)
    parts[0] -= mean
    rows, variances, parities = [], [], []
    for parity, part in enumerate(parts):
        _, singular, right = np.linalg.svd(part, full_matrices=False)
        rows.append(right)
        variances.append(np.square(singular) / len(part))
        parities.append(np.full(len(right), parity))
    variance = np.concatenate(variances)
    order = np.argsort(-variance, kind="stable")[:latents]
    order = order[variance[order] > _NO_VARIANCE * max(variance.sum(), 1e-12)]
    components = np.concatenate(rows)[order]
    # A component and its negative are the same: the largest element decides.
    largest = np.take_along_axis(components, np.abs(components).argmax(1)[:, None], axis=1)
    components = components * np.where(largest < 0, -1.0, 1.0)
    return PrincipalComponents(mean, components, np.concatenate(parities)[order])


@dataclass(frozen=True, eq=False)
class PrincipalModel:
    """Style-learner `pca`: latents are scores of principal components.

    Attributes
    ----------
    scaler : Scaler
    basis : PrincipalComponents
    """

    preset: ClassVar[str] = "pca"
    scaler: Scaler
    basis: PrincipalComponents

    @classmethod
    def fit(
        cls, parents: Serialization, *, latents: int = LATENTS, scaler: Scaler | None = None
    ) -> PrincipalModel:
        """Return the model of these parents."""
        scaler = Scaler.from_parents(parents) if scaler is None else scaler
        with one_thread():
            basis = principal_components(scaler.vectors(parents), scaler.flip_table(), latents)
        return cls(scaler, basis)

    @property
    def core(self) -> int:
        return len(self.basis.parities)

    @property
    def dimension(self) -> int:
        return self.core

    @property
    def signs(self) -> Float64[np.ndarray, "8 d"]:
        return character(self.basis.parities)

    @property
    def bands(self) -> tuple[tuple[int, int], ...]:
        return split_bands((self.core,))

    def encode(self, avatars: Serialization) -> Float64[np.ndarray, "avatars d"]:
        """Return the scores of avatars."""
        with one_thread():
            return self.basis.scores(self.scaler.vectors(avatars))

    def decode(
        self, latents: Float[np.ndarray, "avatars d"], names: tuple[str, ...] | None = None
    ) -> Serialization:
        """Return the avatars of scores."""
        with one_thread():
            return hold_together(self.scaler.avatars(self.basis.vectors(latents), names))

    def with_sizes(self, factor: float) -> PrincipalModel:
        """Return the model of parents that are so many times as large."""
        return replace(self, scaler=self.scaler.with_sizes(factor))

    def tensors(self) -> Tensors:
        """Return mean, components and parities."""
        return {
            "mean": self.basis.mean,
            "components": self.basis.components,
            "parities": self.basis.parities.astype(np.float64),
        }

    def settings(self) -> dict[str, Any]:
        """Return what the shapes of the tensors follow from."""
        return {"latents": self.core}

    @classmethod
    def shapes(cls, settings: dict[str, Any], n: int) -> dict[str, tuple[int, ...]]:
        """Return the shapes that the tensors of a file must have."""
        latents, width = int(settings["latents"]), 4 * n + 1
        return {"mean": (width,), "components": (latents, width), "parities": (latents,)}

    @classmethod
    def from_tensors(cls, scaler: Scaler, tensors: Tensors, settings: dict[str, Any]) -> PrincipalModel:
        """Return the model of a file's numbers."""
        basis = PrincipalComponents(
            tensors["mean"], tensors["components"], tensors["parities"].astype(np.int64)
        )
        return cls(scaler, basis)


class PrincipalTrainer:
    """The closed form behind the interface of a training: no steps, one record.

    Parameters
    ----------
    data : TrainingData
    options : PrincipalOptions
    seed, device, start
        Not used: nothing is drawn, the processor is quick enough, and the components begin anew.
    """

    def __init__(
        self, data: TrainingData, options: PrincipalOptions, seed: int, device: str, start: object = None
    ) -> None:
        self.data, self.options = data, options
        self.steps, self.record_every, self.annealing_ends = 0, 1, 0
        self.notes: tuple[str, ...] = ()

    def fit(self, rows: Int[np.ndarray, " rows"]) -> PrincipalModel:
        """Return the model of these parents."""
        data = self.data
        return PrincipalModel.fit(data.parents.take(rows), latents=self.options.latents, scaler=data.scaler)

    def rms(self, rows: Int[np.ndarray, " rows"]) -> float:
        """Return the mean surface distance of these parents and what those trained on make of them."""
        model, some = self.fit(self.data.trained), self.data.parents.take(rows)
        return float(surface_rms(some, model.decode(model.encode(some))).mean())

    def model(self, weights: Tensors) -> PrincipalModel:
        """Return the model of all parents."""
        return self.fit(np.arange(len(self.data.parents)))

    def advance(self, step: int) -> Any:
        """Refuse: there is no step to make."""
        raise StyleError(f"Principal components are found at once, so there is no step {step}.")

    def replay(self, old: Int[np.ndarray, " old"], new: Int[np.ndarray, " new"]) -> None:
        """Do nothing: the components are those of all parents."""

    def weights(self) -> Tensors:
        """Return nothing: the model follows from the parents."""
        return {}

    def state(self) -> Tensors:
        """Return nothing: there is nothing to go on from."""
        return {}

    def restore(self, state: Tensors) -> None:
        """Do nothing: there is nothing to go back to."""

    def move_to_processor(self) -> bool:
        """Return False: it is there already."""
        return False


PRESET = StylePreset(
    name=PrincipalModel.preset,
    title="Principal components",
    summary="The linear baseline: found at once, the better choice for few parents.",
    model=PrincipalModel,
    options=PrincipalOptions,
    trainer=PrincipalTrainer,
    in_steps=False,
)
