"""A style-learner on the disk: a JSON file to read, and a safetensors file of numbers."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.errors import MbstudioError, StyleError
from mbstudio.core.vae.features import Scaler
from mbstudio.core.vae.model_card import ModelCard
from mbstudio.core.vae.serialization import Serialization, Template
from mbstudio.core.vae.shape_model import Tensors, model_kind

if TYPE_CHECKING:
    from mbstudio.core.vae.style_learner import StyleLearner

FORMAT = 1
CARD_FILE = "style-learner.json"
_KIND = "mbstudio style-learner"
_LARGEST_CARD = 100 * 2**20


def write_learner(learner: StyleLearner, folder: Path) -> Path:
    """Write a style-learner into a folder; whatever happens, the old or the new one is there.

    The numbers go into a file named after their digest; the JSON file, replaced last, names it.

    Raises
    ------
    StyleError
        If the folder cannot be written.
    """
    from safetensors.numpy import save

    from mbstudio.core.project.replacement import replacing

    content = save({name: np.ascontiguousarray(array) for name, array in learner_tensors(learner).items()})
    digest = hashlib.sha256(content).hexdigest()
    weights = f"style-learner-{digest[:12]}.safetensors"
    entries = {
        "kind": _KIND,
        "format": FORMAT,
        "weights": weights,
        "sha256": digest,
        **learner_entries(learner),
    }
    text = json.dumps(entries, indent=1, allow_nan=False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(folder / weights) as temporary:
            temporary.write_bytes(content)
        with replacing(folder / CARD_FILE) as temporary:
            temporary.write_text(text, encoding="utf-8")
        for older in folder.glob("style-learner-*.safetensors"):
            if older.name != weights:
                older.unlink(missing_ok=True)
    except OSError as error:
        raise StyleError(
            f"The style-learner cannot be written into {folder}: {error.strerror or error}. "
            "Choose a folder that can be written."
        ) from error
    return folder


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


def learner_of(entries: dict[str, Any], tensors: Tensors, source: Path) -> StyleLearner:
    """Return the style-learner of :func:`learner_entries` and :func:`learner_tensors`.

    Raises
    ------
    StyleError
        If shapes do not agree or the card is not complete; `source` is named.
    KeyError, TypeError, ValueError
        If something is missing or of the wrong kind.
    """
    from mbstudio.core.vae.style_learner import StyleLearner

    kind = model_kind(str(entries["preset"]))
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
    entries = read_entries(path)
    try:
        weights = folder / Path(str(entries["weights"])).name
        content = _read(weights)
        if hashlib.sha256(content).hexdigest() != entries["sha256"]:
            raise StyleError(
                f"{weights} is not the file that {path.name} was written with (truncated, changed or from "
                "another style-learner): copy the whole folder again."
            )
        return learner_of(entries, _tensors(content, weights), weights)
    except (KeyError, TypeError, ValueError) as error:
        raise StyleError(f"{path} is no complete style-learner ({error!r}): save it again.") from None
    except MbstudioError as error:
        if str(path) in str(error) or str(folder) in str(error):
            raise
        raise StyleError(f"{path} is no usable style-learner: {error}") from error


def read_entries(path: Path) -> dict[str, Any]:
    """Return the entries of a style-learner's JSON file, known to be of a format that is understood.

    Raises
    ------
    StyleError
        If it is missing, no JSON, foreign or newer.
    """
    content = _read(path)
    if len(content) > _LARGEST_CARD:
        raise StyleError(f"{path} is {len(content) >> 20} MiB long: it is no style-learner of mbstudio.")
    try:
        entries = json.loads(content)
    except (ValueError, RecursionError):
        raise StyleError(f"{path} is damaged or no JSON file: take another copy of the folder.") from None
    if not isinstance(entries, dict) or entries.get("kind") != _KIND:
        raise StyleError(f"{path} is no style-learner of mbstudio: choose a folder that one was saved in.")
    form = entries.get("format")
    if not isinstance(form, int) or isinstance(form, bool) or form < 1:
        raise StyleError(f"{path} does not say its format: take another copy of the folder.")
    if form > FORMAT:
        raise StyleError(
            f"{path} has format {form}, from a newer mbstudio than this, which reads up to {FORMAT}: "
            "update mbstudio."
        )
    return entries


_PARENT_ARRAYS = ("centers", "log_weights", "diameters", "rms", "valid")


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise StyleError(f"{path} cannot be read: {error.strerror or error}.") from error


def _tensors(content: bytes, path: Path) -> Tensors:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        tensors = load(content)
    except (SafetensorError, KeyError, ValueError, TypeError) as error:
        raise StyleError(f"{path} is damaged or no safetensors file ({error}): copy it again.") from None
    for name, array in tensors.items():
        if name != "parents.rms" and not np.isfinite(array).all():
            raise StyleError(f"{path} holds numbers that are not finite in '{name}': train it again.")
    return tensors


def _check_shapes(tensors: Tensors, wanted: dict[str, tuple[int, ...]], path: Path) -> None:
    for name, shape in wanted.items():
        found = tensors.get(f"model.{name}")
        if found is None or found.shape != shape:
            raise StyleError(
                f"{path} has '{name}' of shape {None if found is None else found.shape} where its JSON file "
                f"asks for {shape}: the two do not belong together."
            )
