"""Training a style-learner, a step object: the loop stands with whoever drives it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import StyleError
from mbstudio.core.replacement import replacing
from mbstudio.core.threads import one_thread
from mbstudio.core.vae.models.model_card import ModelCard, library_versions
from mbstudio.core.vae.models.presets import find_preset
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.shape_model import ShapeModel, Tensors
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.style_preset import StylePreset, Trainer
from mbstudio.core.vae.models.training_data import TrainingData
from mbstudio.core.vae.models.training_step import Losses, TrainingStep
from mbstudio.core.vae.serialize.serialization import Serialization

FORMAT = 2
_WITHOUT_DIGEST = 1
_KIND = "mbstudio style-training"
_NUMBERS = ("step", "steps", "reconstruction", "distribution", "weight", "loss", "held_out", "best")


class StyleTraining:
    """The training of one style-learner: an iterator of `TrainingStep`.

    The first record is the state before any step. Pausing is not calling ``next``; :meth:`stop` ends it
    early; :meth:`result` is at any time the learner of the best state so far.

    Parameters
    ----------
    parents : Serialization
        At least 5 avatars.
    preset : str
        One of :data:`~mbstudio.core.vae.models.presets.PRESETS`.
    seed : int
    device : {'cpu', 'cuda', 'auto'}
        Where the steps are computed; 'auto' takes a GPU where there is one. Results are the same from run
        to run on one kind of device, not between kinds.
    checkpoint : path, optional
        A file that is written every `checkpoint_every` records. If it is there already, the training goes
        on from it, as if it had never been interrupted.
    **options
        Of the preset: see its options record.

    Raises
    ------
    StyleError
        If parents, options or the checkpoint do not suit.
    """

    _checkpoint: Path | None
    begun_from: str
    """Digest of the learner that it goes on from; empty where it begins with none."""

    def __init__(
        self,
        parents: Serialization,
        preset: str = "aligned",
        *,
        seed: int = 0,
        device: str = "cpu",
        checkpoint: str | Path | None = None,
        checkpoint_every: int = 4,
        **options: Any,
    ) -> None:
        chosen = find_preset(preset)
        record = chosen.options.make(options)
        data = TrainingData.from_parents(parents, record.held_out, seed)
        self._begin(chosen, seed, data, chosen.trainer(data, record, seed, choose_device(device)), options)
        self._checkpoint_every = max(1, int(checkpoint_every))
        if checkpoint is not None:
            self.keep_at(Path(checkpoint))

    def keep_at(self, checkpoint: Path) -> None:
        """Write a checkpoint there from now on; if one is there, go on from it.

        Raises
        ------
        StyleError
            If it is damaged, newer, or of another training; then nothing has changed.
        """
        if checkpoint.exists():
            resume(self, checkpoint)
        self._checkpoint = checkpoint

    def _begin(
        self, preset: StylePreset, seed: int, data: TrainingData, trainer: Trainer, options: dict[str, Any]
    ) -> None:
        self.preset, self.seed, self.data, self.options = preset, int(seed), data, dict(options)
        self.trainer = trainer
        self.history: list[TrainingStep] = []
        self.best_weights: Tensors | None = None
        self.best_row = -1
        self.stopped = False
        self._checkpoint = None
        self._checkpoint_every = 1
        self._note = ""
        self.begun_from = ""

    def __iter__(self) -> Iterator[TrainingStep]:
        return self

    def __next__(self) -> TrainingStep:
        if self.stopped or (self.history and self.history[-1].step >= self.trainer.steps):
            raise StopIteration
        with one_thread():
            record = self._next_record()
        self.history.append(record)
        if record.best:
            self.best_weights, self.best_row = self.trainer.weights(), len(self.history) - 1
        if self._checkpoint is not None and self._is_due(record):
            write_checkpoint(self, self._checkpoint)
        return record

    def stop(self) -> None:
        """End the training here: no further steps come."""
        self.stopped = True

    def result(self) -> StyleLearner:
        """Return the style-learner of the best state so far.

        Raises
        ------
        StyleError
            If no step has been recorded yet.
        """
        if self.best_weights is None:
            raise StyleError("The training has not begun: take a step first.")
        with one_thread():
            model = self.trainer.model(self.best_weights)
            latents = model.encode(self.data.parents)
            return StyleLearner(model, self.data.parents, latents, self._card(model, latents))

    def run(self) -> StyleLearner:
        """Take all steps that are left and return the result."""
        for _ in self:
            pass
        return self.result()

    def _next_record(self) -> TrainingStep:
        start = self.history[-1].step if self.history else 0
        if not self.history:
            return self._record(0, [Losses(math.nan, math.nan, 0.0, math.nan)])
        end = min(start + self.trainer.record_every, self.trainer.steps)
        losses = []
        for step in range(start, end):
            found = self._advance(step)
            losses.append(found)
            if not math.isfinite(found.loss):
                return self._stop_broken(step + 1, found)
        return self._record(end, losses)

    def _advance(self, step: int) -> Losses:
        import torch

        try:
            return self.trainer.advance(step)
        except torch.OutOfMemoryError:
            if not self.trainer.move_to_processor():
                raise
            self._note = "the memory of the GPU is full: the training goes on, more slowly, on the processor"
            return self.trainer.advance(step)

    def _record(self, step: int, losses: list[Losses]) -> TrainingStep:
        held_out = self.trainer.rms(self._validation_rows())
        last = losses[-1]
        if not math.isfinite(held_out):
            return self._stop_broken(step, last)
        # Before the distribution item has its full weight an error says little about the end.
        before = self.history[self.best_row] if self.best_row >= 0 else None
        counts = step >= self.trainer.annealing_ends
        best = before is None or (counts and before.step < self.trainer.annealing_ends)
        if before is not None and not best:
            best = held_out < before.held_out and (counts or before.step < self.trainer.annealing_ends)
        note, self._note = self._note, ""
        return TrainingStep(
            step, self.trainer.steps, _mean([entry.reconstruction for entry in losses]),
            _mean([entry.distribution for entry in losses]), last.weight,
            _mean([entry.loss for entry in losses]), held_out, best, note,
        )  # fmt: skip

    def _stop_broken(self, step: int, last: Losses) -> TrainingStep:
        if self.best_row < 0:
            raise StyleError(
                "The training yields numbers that are not finite from the start: check the parents for "
                "avatars with stray control points."
            )
        self.stopped = True
        kept = self.history[self.best_row].step
        return TrainingStep(
            step, self.trainer.steps, last.reconstruction, last.distribution, last.weight, last.loss,
            math.nan, False,
            f"The training stopped at step {step}, where the loss was no longer finite. The best state, of "
            f"step {kept}, is kept.",
        )  # fmt: skip

    def _validation_rows(self) -> Int[np.ndarray, " rows"]:
        """Return the parents by whose error the best state is chosen."""
        return self.data.held_out if len(self.data.held_out) else self.data.trained

    def _is_due(self, record: TrainingStep) -> bool:
        return (
            self.stopped
            or record.step >= self.trainer.steps
            or (len(self.history) - 1) % self._checkpoint_every == 0
        )

    def _card(self, model: ShapeModel, latents: np.ndarray) -> ModelCard:
        parents, data = self.data.parents, self.data
        best = self.history[self.best_row]
        known = parents.rms[np.isfinite(parents.rms)]
        notes = [*data.notes, *self.trainer.notes, *[step.note for step in self.history if step.note]]
        if self.history[-1].step < self.trainer.steps and not math.isnan(self.history[-1].held_out):
            notes.append(f"Stopped after {self.history[-1].step} of {self.trainer.steps} steps.")
        plain = latents.copy()
        plain[:, model.core :] = 0.0
        errors = surface_rms(parents, model.decode(plain))
        return ModelCard(
            preset=self.preset.name, names=parents.names, unit=parents.unit, n=parents.template.n,
            smallest=float(parents.diameters.min()), largest=float(parents.diameters.max()),
            latents=model.core, seed=self.seed, steps=best.step,
            held_out=tuple(parents.names[row] for row in data.held_out),
            settings=self.options, versions=library_versions("torch", "safetensors"),
            parents_rms=float(known.mean()) if len(known) else math.nan,
            trained_rms=float(errors[data.trained].mean()),
            held_out_rms=best.held_out if len(data.held_out) else math.nan, notes=tuple(notes),
        )  # fmt: skip


def learn(parents: Serialization, preset: str = "aligned", *, seed: int = 0, **options: Any) -> StyleLearner:
    """Return a style-learner trained on parents; arguments and errors of :class:`StyleTraining`."""
    return StyleTraining(parents, preset, seed=seed, **options).run()


def choose_device(device: str) -> str:
    """Return 'cpu' or 'cuda' for a device that was asked for.

    Raises
    ------
    StyleError
        If it is unknown, or a GPU was asked for and there is none.
    """
    if device not in ("cpu", "cuda", "auto"):
        raise StyleError(f"There is no device '{device}': use 'cpu', 'cuda' or 'auto'.")
    if device == "cpu":
        return "cpu"
    import torch

    if torch.cuda.is_available():
        return "cuda"
    if device == "cuda":
        raise StyleError("There is no GPU that torch can use: train on the processor (device 'cpu').")
    return "cpu"


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else math.nan


def write_checkpoint(training: StyleTraining, path: Path) -> None:
    """Write a training as it stands; whatever happens, the old file or the new one is there.

    Raises
    ------
    StyleError
        If the file cannot be written.
    """
    from safetensors.numpy import save

    tensors = {f"state.{name}": array for name, array in training.trainer.state().items()}
    tensors |= {f"best.{name}": array for name, array in (training.best_weights or {}).items()}
    tensors["history"] = np.array(
        [[float(getattr(step, name)) for name in _NUMBERS] for step in training.history]
    )
    about = {
        "kind": _KIND, "format": FORMAT, "of": _identity(training), "best_row": training.best_row,
        "stopped": training.stopped, "notes": [step.note for step in training.history],
    }  # fmt: skip
    solid = {name: np.array(array, order="C") for name, array in tensors.items()}  # keeps shape ()
    about["digest"] = _digest(about, solid)
    content = save(solid, metadata={"training": json.dumps(about)})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(content)
    except OSError as error:
        raise StyleError(
            f"The checkpoint {path} cannot be written: {error.strerror or error}. Choose another place."
        ) from error


def _digest(about: dict[str, Any], tensors: dict[str, np.ndarray]) -> str:
    """Return the SHA-256 of all that a checkpoint holds, but for the digest itself."""
    told = {key: value for key, value in about.items() if key != "digest"}
    digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode("ascii"))
    for name in sorted(tensors):
        array = np.ascontiguousarray(tensors[name])
        digest.update(json.dumps([name, array.dtype.str, list(tensors[name].shape)]).encode("ascii"))
        digest.update(array.tobytes())
    return digest.hexdigest()


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
            raise ValueError("its best state is missing")
        state = _part(tensors, "state.")
        wanted = {name: array.shape for name, array in training.trainer.weights().items()}
        if any(name not in state or state[name].shape != shape for name, shape in wanted.items()):
            raise ValueError("parameters are missing or of another shape")
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise StyleError(
            f"{path} is not a complete checkpoint ({error}): delete it to start again."
        ) from None
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
        "preset": training.preset.name,
        "seed": training.seed,
        "options": json.loads(json.dumps(training.options)),
        "steps": training.trainer.steps,
        **({"begun_from": training.begun_from} if training.begun_from else {}),
    }


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="numpy") as file:
            about = json.loads((file.metadata() or {}).get("training", "null"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise StyleError(f"{path} cannot be read: {error.strerror or error}.") from error
    except (SafetensorError, ValueError, KeyError) as error:
        raise StyleError(f"{path} is damaged or no checkpoint ({error}): delete it to begin anew.") from None
    if not isinstance(about, dict) or about.get("kind") != _KIND or not isinstance(about.get("of"), dict):
        raise StyleError(f"{path} is not a checkpoint of a training: choose another file.")
    if not isinstance(about.get("format"), int) or about["format"] > FORMAT:
        raise StyleError(
            f"{path} has format {about.get('format')}, from a newer mbstudio than this: update mbstudio."
        )
    told = about.get("digest")
    if told != _digest(about, tensors) and (told is not None or about["format"] > _WITHOUT_DIGEST):
        raise StyleError(f"{path} is not what was written: it was damaged since. Delete it to begin anew.")
    return about, tensors
