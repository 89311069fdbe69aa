"""Style-learner `aligned`: a variational autoencoder of avatars whose control points correspond."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.errors import StyleError
from mbstudio.core.options import OptionRecord, option
from mbstudio.core.threads import one_thread
from mbstudio.core.vae.models.features import Scaler, character
from mbstudio.core.vae.models.joining import hold_together
from mbstudio.core.vae.models.networks import apply_network, network_shapes
from mbstudio.core.vae.models.principal import PrincipalComponents, principal_components
from mbstudio.core.vae.models.radii import direction_exchange, log_radii
from mbstudio.core.vae.models.sampling import split_bands
from mbstudio.core.vae.models.shape_model import Tensors
from mbstudio.core.vae.serialize.serialization import Serialization

RADII = 144
INPUTS = RADII + 1
SIZE_SCALE = 4.0
HIDDEN = (256, 256)


@dataclass(frozen=True)
class AlignedOptions(OptionRecord, owner="preset 'aligned'", error=StyleError):
    """Options of preset `aligned`."""

    latents: int = option(64, "Of the model proper.", minimum=1)
    details: int = option(
        128, "Principal components of what the model leaves of its parents; 0 for none.", minimum=0
    )
    steps: int = option(0, "Of the optimizer; 0 chooses 4000, or 2000 for fewer than 100 parents.", minimum=0)
    batch: int = option(64, "Avatars in a step.", minimum=1)
    rate: float = option(1e-3, "Highest learning rate.", above=0)
    kl_weight: float = option(
        0.1, "Weight beta of the distribution item when the annealer has done its work.", minimum=0
    )
    annealed: float = option(0.4, "Share of the steps over which the annealer rises.", minimum=0, maximum=1)
    held_out: float = option(0.1, "Share of the parents held out for the validation error.")
    record_every: int = option(50, "Steps between two records.", minimum=1)


def input_table() -> tuple[Int[np.ndarray, "8 145"], Float64[np.ndarray, "8 145"]]:
    """Return which input takes each place after each flip, and signs (all 1): radii and the size."""
    sources = np.concatenate([direction_exchange(), np.full((8, 1), RADII)], axis=1)
    return sources, np.ones((8, INPUTS))


@dataclass(frozen=True, eq=False)
class AlignedModel:
    """Trained model of preset `aligned`.

    Encoder and decoder are each a linear map plus a network. Both are used in all eight flips of the
    axes and averaged, so that a flipped avatar has exactly the latents with the signs of that flip.

    Attributes
    ----------
    scaler : Scaler
    numbers : dict of float arrays
        Parameters of the networks and ``input.mean``, ``input.scale``, ``parities``.
    left : PrincipalComponents
        Of what the model proper leaves of its parents; its scores are the details.
    """

    preset: ClassVar[str] = "aligned"
    scaler: Scaler
    numbers: Tensors
    left: PrincipalComponents

    @property
    def core(self) -> int:
        return len(self.numbers["parities"])

    @property
    def dimension(self) -> int:
        return self.core + len(self.left.parities)

    @cached_property
    def signs(self) -> Float64[np.ndarray, "8 d"]:
        parities = np.concatenate([self.numbers["parities"].astype(np.int64), self.left.parities])
        return character(parities)

    @property
    def bands(self) -> tuple[tuple[int, int], ...]:
        return split_bands((self.core, len(self.left.parities)))

    @cached_property
    def _table(self) -> tuple[Int[np.ndarray, "8 width"], Float64[np.ndarray, "8 width"]]:
        return self.scaler.flip_table()

    def encode(self, avatars: Serialization) -> Float64[np.ndarray, "avatars d"]:
        """Return the latents of avatars: those of the model, then the details it leaves."""
        with one_thread():
            core = self.encode_core(avatars)
            if not len(self.left.parities):
                return core
            left = self.scaler.vectors(avatars) - self.decode_core(core)
            return np.concatenate([core, self.left.scores(left)], axis=1)

    def decode(
        self, latents: Float[np.ndarray, "avatars d"], names: tuple[str, ...] | None = None
    ) -> Serialization:
        """Return the avatars of latents."""
        with one_thread():
            vectors = self.decode_core(latents[:, : self.core])
            if len(self.left.parities):
                vectors = vectors + self.left.vectors(latents[:, self.core :])
            return hold_together(self.scaler.avatars(vectors, names))

    def encode_core(self, avatars: Serialization) -> Float64[np.ndarray, "avatars core"]:
        """Return the means of the latents of the model proper."""
        inputs = (raw_inputs(self.scaler, avatars) - self.numbers["input.mean"]) / self.numbers["input.scale"]
        signs = self.signs[:, : self.core]
        total = np.zeros((len(avatars), self.core))
        for exchange, sign in zip(input_table()[0], signs, strict=True):
            flipped = inputs[:, exchange]
            means = flipped @ self.numbers["encoder.skip"].T.astype(np.float64)
            means = means + apply_network(self.numbers, "encoder", flipped, "silu")[:, : self.core]
            total += means * sign
        return total / 8.0

    def decode_core(self, latents: Float[np.ndarray, "avatars core"]) -> Float64[np.ndarray, "avatars width"]:
        """Return the vectors that the model proper makes of latents."""
        sources, turns = self._table
        total = np.zeros((len(latents), self.scaler.width))
        for sign, source, turn in zip(self.signs[:, : self.core], sources, turns, strict=True):
            vectors = self.numbers["decoder.mean"] + (latents * sign) @ self.numbers["decoder.skip"].T.astype(
                np.float64
            )
            vectors = vectors + apply_network(self.numbers, "decoder", latents * sign, "silu")
            total += vectors[:, source] * turn
        return total / 8.0

    def with_details(self, parents: Serialization, details: int) -> AlignedModel:
        """Return the model with the principal components of what it leaves of these parents."""
        none = PrincipalComponents(
            np.zeros(self.scaler.width), np.zeros((0, self.scaler.width)), np.zeros(0, np.int64)
        )
        bare = replace(self, left=none)
        if not details:
            return bare
        left = self.scaler.vectors(parents) - bare.decode_core(bare.encode_core(parents))
        return replace(self, left=principal_components(left, self._table, details))

    def order_latents(self, latents: Float[np.ndarray, "parents core"]) -> AlignedModel:
        """Return the same model with its latents in the order in which they tell on size and shape."""
        centre = latents.mean(0) * (self.signs[:, : self.core].mean(0) == 1.0)
        spread = np.sqrt(np.square(latents - centre).mean(0))
        shift = np.concatenate([centre + np.diag(spread), centre - np.diag(spread), centre[None]])
        avatars = self.scaler.avatars(self.decode_core(shift))
        told = np.concatenate(
            [log_radii(avatars), np.sqrt(RADII) * np.log(avatars.diameters)[:, None]], axis=1
        )
        square = np.square(told[: 2 * self.core] - told[-1]).sum(1)
        order = np.argsort(-(square[: self.core] + square[self.core :]), kind="stable")
        return replace(self, numbers=_reordered(self.numbers, order))

    def with_sizes(self, factor: float) -> AlignedModel:
        """Return the model of parents that are so many times as large."""
        return replace(self, scaler=self.scaler.with_sizes(factor))

    def tensors(self) -> Tensors:
        """Return all numbers."""
        left = self.left
        return self.numbers | {
            "left.mean": left.mean,
            "left.components": left.components,
            "left.parities": left.parities.astype(np.float64),
        }

    def settings(self) -> dict[str, Any]:
        """Return what the shapes of the tensors follow from."""
        return {"latents": self.core, "details": len(self.left.parities)}

    @classmethod
    def shapes(cls, settings: dict[str, Any], n: int) -> dict[str, tuple[int, ...]]:
        """Return the shapes that the tensors of a file must have."""
        latents, details, width = int(settings["latents"]), int(settings["details"]), 4 * n + 1
        return parameter_shapes(latents, width) | {
            "input.mean": (INPUTS,), "input.scale": (INPUTS,), "parities": (latents,),
            "left.mean": (width,), "left.components": (details, width), "left.parities": (details,),
        }  # fmt: skip

    @classmethod
    def from_tensors(cls, scaler: Scaler, tensors: Tensors, settings: dict[str, Any]) -> AlignedModel:
        """Return the model of a file's numbers."""
        left = PrincipalComponents(
            tensors["left.mean"], tensors["left.components"], tensors["left.parities"].astype(np.int64)
        )
        numbers = {name: array for name, array in tensors.items() if not name.startswith("left.")}
        return cls(scaler, numbers, left)


def parameter_shapes(latents: int, width: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the parameters that are trained, but for the three sigmas of the loss."""
    return (
        network_shapes("encoder", (INPUTS, *HIDDEN, 2 * latents))
        | network_shapes("decoder", (latents, *HIDDEN, width))
        | {"encoder.skip": (latents, INPUTS), "decoder.skip": (width, latents), "decoder.mean": (width,)}
    )


def raw_inputs(scaler: Scaler, avatars: Serialization) -> Float64[np.ndarray, "avatars 145"]:
    """Return what the encoder sees, not yet scaled: ln r in 144 directions, and 4 times the size's score.

    Radii do not depend on the order of the control points, nor on how several of them share a lobe.
    """
    return np.concatenate([log_radii(avatars), SIZE_SCALE * scaler.sizes(avatars)[:, None]], axis=1)


def _reordered(numbers: Tensors, order: Int[np.ndarray, " core"]) -> Tensors:
    core, last = len(order), len(HIDDEN)
    both = np.concatenate([order, core + order])
    changed = dict(numbers)
    changed["parities"] = numbers["parities"][order]
    changed["encoder.skip"] = numbers["encoder.skip"][order]
    for part in ("weight", "bias"):
        changed[f"encoder.{last}.{part}"] = numbers[f"encoder.{last}.{part}"][both]
    for name in ("decoder.skip", "decoder.0.weight"):
        changed[name] = numbers[name][:, order]
    return changed
