"""The state of a training on the disk, to go on from after a crash."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.training_step import TrainingStep

if TYPE_CHECKING:
    from mbstudio.core.vae.training import StyleTraining

FORMAT = 1
_KIND = "mbstudio style-training"
_NUMBERS = ("step", "steps", "reconstruction", "distribution", "weight", "loss", "held_out", "best")


def write_checkpoint(training: StyleTraining, path: Path) -> None:
    """Write a training as it stands; whatever happens, the old file or the new one is there.

    Raises
    ------
    StyleError
        If the file cannot be written.
    """
    from safetensors.numpy import save

    from mbstudio.core.project.replacement import replacing

    tensors = {f"state.{name}": array for name, array in training.trainer.state().items()}
    tensors |= {f"best.{name}": array for name, array in (training.best_weights or {}).items()}
    tensors["history"] = np.array(
        [[float(getattr(step, name)) for name in _NUMBERS] for step in training.history]
    )
    about = {
        "kind": _KIND, "format": FORMAT, "of": _identity(training), "best_row": training.best_row,
        "stopped": training.stopped, "notes": [step.note for step in training.history],
    }  # fmt: skip
    content = save(
        {name: np.array(array, order="C") for name, array in tensors.items()},  # keeps shape ()
        metadata={"training": json.dumps(about)},
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(content)
    except OSError as error:
        raise StyleError(
            f"The checkpoint {path} cannot be written: {error.strerror or error}. Choose another place."
        ) from error


def resume(training: StyleTraining, path: Path) -> None:
    """Bring a training that has not begun to where its checkpoint stands.

    Raises
    ------
    StyleError
        If the file is damaged, newer, or of another training (other parents, seed or options).
    """
    about, tensors = _read(path)
    if about["of"] != _identity(training):
        differing = [key for key, value in _identity(training).items() if about["of"].get(key) != value]
        raise StyleError(
            f"{path} is the checkpoint of another training (it differs in {', '.join(differing)}): delete it "
            "or name another file."
        )
    try:
        rows, notes = tensors["history"].tolist(), about["notes"]
        history = [
            TrainingStep(
                int(row[0]), int(row[1]), row[2], row[3], row[4], row[5], row[6], bool(row[7]), str(note)
            )
            for row, note in zip(rows, notes, strict=True)
        ]
        best_row = int(about["best_row"])
        if not 0 <= best_row < len(history) or math.isnan(history[best_row].held_out):
            raise ValueError("it names no best state")
        state = _part(tensors, "state.")
        wanted = {name: array.shape for name, array in training.trainer.weights().items()}
        if any(name not in state or state[name].shape != shape for name, shape in wanted.items()):
            raise ValueError("parameters are missing or of another shape")
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise StyleError(f"{path} is no complete checkpoint ({error}): delete it to begin anew.") from None
    training.trainer.restore(state)
    training.history = history
    training.best_row, training.best_weights = best_row, _part(tensors, "best.")
    training.stopped = bool(about["stopped"])


def _part(tensors: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): array for name, array in tensors.items() if name.startswith(prefix)}


def _identity(training: StyleTraining) -> dict[str, Any]:
    """Return what must agree for the steps to be those of one training."""
    return {
        "parents": training.data.digest,
        "preset": training.preset,
        "seed": training.seed,
        "options": json.loads(json.dumps(training.options)),
        "steps": training.trainer.steps,
    }


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="numpy") as file:  # type: ignore[no-untyped-call]
            about = json.loads((file.metadata() or {}).get("training", "null"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise StyleError(f"{path} cannot be read: {error.strerror or error}.") from error
    except (SafetensorError, ValueError, KeyError) as error:
        raise StyleError(f"{path} is damaged or no checkpoint ({error}): delete it to begin anew.") from None
    if not isinstance(about, dict) or about.get("kind") != _KIND or not isinstance(about.get("of"), dict):
        raise StyleError(f"{path} is no checkpoint of a style-training: name another file.")
    if not isinstance(about.get("format"), int) or about["format"] > FORMAT:
        raise StyleError(
            f"{path} has format {about.get('format')}, from a newer mbstudio than this: update mbstudio."
        )
    return about, tensors
