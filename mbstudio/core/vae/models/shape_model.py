"""What all kinds of style-learner have in common behind the one interface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from mbstudio.core.vae.models.features import Scaler
    from mbstudio.core.vae.serialize.serialization import Serialization

Tensors = dict[str, Float[np.ndarray, "..."]]
"""Numbers of a model by name, as they stand in its file."""


class ShapeModel(Protocol):
    """A trained model: from serialized avatars to latent vectors and back.

    Attributes
    ----------
    preset : str
        Name of its preset.
    scaler : Scaler
    core : int
        Latents of the model proper; those after it are the details that it leaves.
    dimension : int
        All latents.
    signs : float array, shape (8, dimension), or None
        What each flip of the axes does to the latents; None if nothing simple.
    bands : tuple of (int, int)
        Of the sampler; empty if latents are drawn from N(0, 1).
    """

    preset: ClassVar[str]

    @property
    def scaler(self) -> Scaler: ...

    @property
    def core(self) -> int: ...
    @property
    def dimension(self) -> int: ...
    @property
    def signs(self) -> Float[np.ndarray, "8 d"] | None: ...
    @property
    def bands(self) -> tuple[tuple[int, int], ...]: ...
    def encode(self, avatars: Serialization) -> Float[np.ndarray, "avatars d"]: ...
    def decode(
        self, latents: Float[np.ndarray, "avatars d"], names: tuple[str, ...] | None = None
    ) -> Serialization: ...
    def with_sizes(self, factor: float) -> ShapeModel: ...
    def tensors(self) -> Tensors: ...
    def settings(self) -> dict[str, Any]: ...
    @classmethod
    def shapes(cls, settings: dict[str, Any], n: int) -> dict[str, tuple[int, ...]]: ...
    @classmethod
    def from_tensors(cls, scaler: Scaler, tensors: Tensors, settings: dict[str, Any]) -> ShapeModel: ...
