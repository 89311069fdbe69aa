"""MetaballVAE's style-learner: one interface to all presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.model_card import ModelCard
from mbstudio.core.vae.sampling import Sample, band_latents, normal_latents, usual_noise
from mbstudio.core.vae.serialization import Serialization, Template
from mbstudio.core.vae.shape_model import ShapeModel


@dataclass(frozen=True, eq=False)
class StyleLearner:
    """A trained style-learner: encodes avatars, decodes latent vectors, draws new grains.

    Attributes
    ----------
    model : ShapeModel
        Of preset `aligned`, `paper` or `pca`.
    parents : Serialization
        All avatars that it learned from, those held out in training too.
    latents : float array, shape (parents, d)
        Their latent vectors. Read-only.
    card : ModelCard

    Notes
    -----
    Latent vectors have `dimension` = d numbers: the first `core` are those of the model proper, the
    others its details, what it leaves of an avatar (preset `aligned`). Without them :meth:`decode` gives
    the model's own, smoother avatar.
    """

    model: ShapeModel
    parents: Serialization
    latents: Float[np.ndarray, "parents d"]
    card: ModelCard

    def __post_init__(self) -> None:
        latents = np.array(self.latents, dtype=np.float64)
        if latents.shape != (len(self.parents), self.model.dimension):
            raise StyleError(
                f"{len(self.parents)} parents have latent vectors of shape {latents.shape}, not "
                f"({len(self.parents)}, {self.model.dimension})."
            )
        latents.flags.writeable = False
        object.__setattr__(self, "latents", latents)

    @classmethod
    def of(cls, model: ShapeModel, parents: Serialization, card: ModelCard) -> StyleLearner:
        """Return the learner of a model, its parents encoded."""
        return cls(model, parents, model.encode(parents), card)

    @property
    def preset(self) -> str:
        """Which kind of model it is: 'aligned', 'paper' or 'pca'."""
        return self.model.preset

    @property
    def template(self) -> Template:
        """The template from which avatars must be serialized."""
        return self.model.scaler.template

    @property
    def unit(self) -> str:
        """Length unit of the sizes of decoded avatars."""
        return self.model.scaler.unit

    @property
    def dimension(self) -> int:
        """Length d of a latent vector."""
        return self.model.dimension

    @property
    def core(self) -> int:
        """Number of latents of the model proper."""
        return self.model.core

    @property
    def signs(self) -> Float[np.ndarray, "8 d"] | None:
        """What each flip of the axes does to a latent vector; None for preset `paper`."""
        return self.model.signs

    def encode(self, avatars: Serialization) -> Float64[np.ndarray, "avatars d"]:
        """Return the latent vectors of avatars, in whatever unit.

        Raises
        ------
        StyleError
            If they are not serialized from the learner's template.
        """
        self.model.scaler.check(avatars)
        return self.model.encode(avatars)

    def decode(
        self, latents: Float[np.ndarray, "avatars d"], *, names: tuple[str, ...] | None = None
    ) -> Serialization:
        """Return the avatars of latent vectors.

        Parameters
        ----------
        latents : float array, shape (avatars, d) or (avatars, core)
            With `core` columns: without details.
        names : tuple of str, optional

        Raises
        ------
        StyleError
            If the shape is another, or values are not finite.
        """
        latents = np.asarray(latents, dtype=np.float64)
        if latents.ndim != 2 or latents.shape[1] not in (self.core, self.dimension):
            raise StyleError(
                f"Latent vectors of shape {latents.shape} cannot be decoded: give "
                f"(avatars, {self.dimension}), or (avatars, {self.core}) for avatars without details."
            )
        if not np.isfinite(latents).all():
            raise StyleError("Latent vectors hold values that are not finite numbers: give finite ones.")
        details = np.zeros((len(latents), self.dimension - latents.shape[1]))
        return self.model.decode(np.concatenate([latents, details], axis=1), names)

    def sample(
        self, count: int, seed: int = 0, *, mixing: float | None = None, turning: float | None = None
    ) -> Sample:
        """Return `count` new grains, not yet checked for validity.

        Parameters
        ----------
        count : int
        seed : int
            The same seed and count give the same grains.
        mixing : float, optional
            Share of noise in form and size, 0 to 1: less stays nearer to the parents. By default 0.6, and
            0.8 for fewer than 50 parents, between which there is more room.
        turning : float, optional
            Share of noise in everything finer, 0 to 1; by default 0.7, and 0.9 for fewer than 50.

        Raises
        ------
        StyleError
            If count is negative, or a share of noise is none.
        """
        usual = usual_noise(len(self.parents))
        mixing, turning = usual[0] if mixing is None else mixing, usual[1] if turning is None else turning
        rng = np.random.default_rng(seed)
        if self.signs is None:
            drawn = normal_latents(count, self.dimension, rng)
            rows = np.full(count, -1)
        else:
            drawn, rows = band_latents(
                self.latents, self.signs, self.model.bands, count, rng, mixing=mixing, turning=turning
            )
        return Sample(self.decode(drawn), drawn, rows)

    def with_quality(self, report: dict[str, object]) -> StyleLearner:
        """Return the learner with a quality report on its card."""
        return replace(self, card=self.card.with_quality(report))

    def save(self, folder: str | Path) -> Path:
        """Write the learner into a folder and return it; an older one there is replaced.

        Raises
        ------
        StyleError
            If the folder cannot be written.
        """
        from mbstudio.core.vae.model_files import write_learner

        return write_learner(self, Path(folder))


def load_style_learner(folder: str | Path) -> StyleLearner:
    """Return the style-learner that was saved in a folder.

    Raises
    ------
    StyleError
        If there is none, or a file is damaged, foreign, or from a newer mbstudio; it names the file.
    """
    from mbstudio.core.vae.model_files import read_learner

    return read_learner(Path(folder))
