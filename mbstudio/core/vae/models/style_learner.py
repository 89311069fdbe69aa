"""MetaballVAE's style-learner: one interface to all presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import MbstudioError, StyleError, StyleWarning
from mbstudio.core.tensor_folder import TensorFolder
from mbstudio.core.vae.models.features import Scaler
from mbstudio.core.vae.models.model_card import ModelCard
from mbstudio.core.vae.models.presets import find_preset
from mbstudio.core.vae.models.sampling import Sample, band_latents, default_noise, normal_latents
from mbstudio.core.vae.models.shape_model import ShapeModel, Tensors
from mbstudio.core.vae.serialize.serialization import Serialization, Template

FORMAT = 1
FOLDER = TensorFolder(
    stem="style-learner", kind="mbstudio style-learner", title="style-learner", newest=FORMAT,
    error=StyleError, warning=StyleWarning, made_again="train it again",
)  # fmt: skip
CARD_FILE = FOLDER.card
_SURFACE_CARD = "surface-style.json"
_PARENT_ARRAYS = ("centers", "log_weights", "diameters", "rms", "valid")


@dataclass(frozen=True, eq=False)
class StyleLearner:
    """A trained style-learner: encodes avatars, decodes latent vectors, draws new grains.

    Attributes
    ----------
    model : ShapeModel
        Of one of the presets.
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

    @property
    def preset(self) -> str:
        """Name of the preset that its model is of."""
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
        """What each flip of the axes does to a latent vector; None if nothing simple (preset `paper`)."""
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
        usual = default_noise(len(self.parents))
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
        return write_learner(self, Path(folder))


def load_style_learner(folder: str | Path) -> StyleLearner:
    """Return the style-learner that was saved in a folder.

    Raises
    ------
    StyleError
        If there is none, or a file is damaged, foreign, or from a newer mbstudio; it names the file.
    """
    return read_learner(Path(folder))


def write_learner(learner: StyleLearner, folder: Path) -> Path:
    """Write a style-learner into a folder; whatever happens, the old or the new one is there.

    Raises
    ------
    StyleError
        If the folder cannot be written.
    """
    return FOLDER.write(folder, learner_entries(learner), learner_tensors(learner))


def learner_tensors(learner: StyleLearner) -> Tensors:
    """Return all numbers of a style-learner by the names that they have in a file."""
    model, parents = learner.model, learner.parents
    tensors: Tensors = {f"model.{name}": array for name, array in model.tensors().items()}
    tensors |= {
        "template.centers": model.scaler.template.centers,
        "template.log_weights": model.scaler.template.log_weights,
        "template.exchange": model.scaler.template.exchange,
        "sizes.logarithms": model.scaler.log_sizes,
        "sizes.scores": model.scaler.scores,
        "latents": learner.latents,
    }
    if model.scaler.template.stiffness is not None:
        tensors["template.stiffness"] = model.scaler.template.stiffness
    return tensors | {f"parents.{name}": getattr(parents, name) for name in _PARENT_ARRAYS}


def learner_entries(learner: StyleLearner) -> dict[str, Any]:
    """Return all else of a style-learner, as what JSON can hold."""
    model = learner.model
    return {
        "preset": model.preset,
        "n": model.scaler.template.n,
        "model": model.settings(),
        "unit": model.scaler.unit,
        "card": learner.card.as_dict(),
    }


def build_learner(entries: dict[str, Any], tensors: Tensors, source: Path) -> StyleLearner:
    """Return the style-learner of :func:`learner_entries` and :func:`learner_tensors`.

    Raises
    ------
    StyleError
        If shapes do not agree or the card is not complete; `source` is named.
    KeyError, TypeError, ValueError
        If something is missing or of the wrong kind.
    """
    kind = find_preset(str(entries["preset"])).model
    _check_shapes(tensors, kind.shapes(entries["model"], int(entries["n"])), source)
    template = Template(
        tensors["template.centers"],
        tensors["template.log_weights"],
        tensors["template.exchange"].astype(np.int64),
        tensors.get("template.stiffness"),
    )
    scaler = Scaler(
        template,
        str(entries["unit"]),
        tensors["sizes.logarithms"],
        tensors["sizes.scores"],
    )
    card = ModelCard.from_dict(entries["card"])
    parents = Serialization(
        template=template, unit=scaler.unit, names=card.names,
        **{name: tensors[f"parents.{name}"] for name in _PARENT_ARRAYS},
    )  # fmt: skip
    numbers = {
        name.removeprefix("model."): array for name, array in tensors.items() if name.startswith("model.")
    }
    model = kind.from_tensors(scaler, numbers, entries["model"])
    return StyleLearner(model, parents, tensors["latents"], card)


def read_learner(folder: Path) -> StyleLearner:
    """Return the style-learner of a folder.

    Raises
    ------
    StyleError
        If there is none, or a file is damaged, foreign, or from a newer mbstudio; it names the file.
    """
    path = folder / CARD_FILE
    if not path.exists() and (folder / _SURFACE_CARD).exists():
        raise StyleError(
            f"{folder} is a style of surfaces, which has no latent space to work in: 'mbstudio generate' "
            "makes clones of it."
        )
    entries = FOLDER.read_card(folder)
    try:
        tensors, weights = FOLDER.read_tensors(folder, entries)
        require_finite(tensors, weights)
        return build_learner(entries, tensors, weights)
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        told = " ".join(str(error).split())[:200]
        raise StyleError(
            f"{path} is incomplete ({type(error).__name__}: {told}): save the style-learner again."
        ) from None
    except MbstudioError as error:
        if str(path) in str(error) or str(folder) in str(error):
            raise
        raise StyleError(f"{path} cannot be used as a style-learner: {error}") from error


def require_finite(tensors: Tensors, path: Path) -> None:
    """Refuse numbers of a style-learner that are not finite; only a parent's unknown accuracy may be none.

    Raises
    ------
    StyleError
        If there are some; it names the file.
    """
    FOLDER.require_finite(tensors, path, but=("parents.rms",))


def _check_shapes(tensors: Tensors, wanted: dict[str, tuple[int, ...]], path: Path) -> None:
    for name, shape in wanted.items():
        found = tensors.get(f"model.{name}")
        if found is None or found.shape != shape:
            raise StyleError(
                f"{path} has '{name}' of shape {None if found is None else found.shape} where its JSON file "
                f"asks for {shape}: they do not belong together."
            )
