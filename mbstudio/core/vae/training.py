"""Training a style-learner, a step object: the loop stands with whoever drives it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import StyleError
from mbstudio.core.threads import one_thread
from mbstudio.core.vae.model_card import ModelCard, library_versions
from mbstudio.core.vae.radii import surface_rms
from mbstudio.core.vae.serialization import Serialization
from mbstudio.core.vae.shape_model import Preset, ShapeModel, Tensors, model_kind
from mbstudio.core.vae.style_learner import StyleLearner
from mbstudio.core.vae.training_data import TrainingData
from mbstudio.core.vae.training_step import Losses, TrainingStep


class Trainer(Protocol):
    """What a preset brings along: its parameters and one step of their improvement."""

    steps: int
    record_every: int
    free_from: int
    notes: tuple[str, ...]

    def advance(self, step: int) -> Losses:
        """Make step `step`, counted from 0; all chance in it follows from seed and step."""

    def weights(self) -> Tensors:
        """Return a copy of the parameters."""

    def state(self) -> Tensors:
        """Return parameters and all else that the next step depends on."""

    def restore(self, state: Tensors) -> None:
        """Go back to a state."""

    def rms(self, rows: np.ndarray) -> float:
        """Return the mean surface distance of these parents and what the model makes of them."""

    def model(self, weights: Tensors) -> ShapeModel:
        """Return the finished model with these parameters."""

    def move_to_processor(self) -> bool:
        """Leave the GPU; False if it was not there."""


class StyleTraining:
    """The training of one style-learner: an iterator of `TrainingStep`.

    The first record is the state before any step. Pausing is not calling ``next``; :meth:`stop` ends it
    early; :meth:`result` is at any time the learner of the best state so far.

    Parameters
    ----------
    parents : Serialization
        At least 5 avatars.
    preset : {'aligned', 'paper', 'pca'}
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

    def __init__(
        self,
        parents: Serialization,
        preset: Preset = "aligned",
        *,
        seed: int = 0,
        device: str = "cpu",
        checkpoint: str | Path | None = None,
        checkpoint_every: int = 4,
        **options: Any,
    ) -> None:
        kind = model_kind(preset)
        record = make_options(kind.options, options)
        data = TrainingData.of(parents, record.held_out, seed)
        self._begin(preset, seed, data, kind.trainer(data, record, seed, chosen_device(device)), options)
        self._checkpoint = None if checkpoint is None else Path(checkpoint)
        self._checkpoint_every = max(1, int(checkpoint_every))
        if self._checkpoint is not None and self._checkpoint.exists():
            from mbstudio.core.vae.checkpoints import resume

            resume(self, self._checkpoint)

    def _begin(
        self, preset: Preset, seed: int, data: TrainingData, trainer: Trainer, options: dict[str, Any]
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
        if self._checkpoint is not None and self._due(record):
            from mbstudio.core.vae.checkpoints import write_checkpoint

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
                return self._broken(step + 1, found)
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
        held_out = self.trainer.rms(self._judged_by())
        last = losses[-1]
        if not math.isfinite(held_out):
            return self._broken(step, last)
        # Before the distribution item has its full weight an error says little about the end.
        before = self.history[self.best_row] if self.best_row >= 0 else None
        counts = step >= self.trainer.free_from
        best = before is None or (counts and before.step < self.trainer.free_from)
        if before is not None and not best:
            best = held_out < before.held_out and (counts or before.step < self.trainer.free_from)
        note, self._note = self._note, ""
        return TrainingStep(
            step, self.trainer.steps, _mean([entry.reconstruction for entry in losses]),
            _mean([entry.distribution for entry in losses]), last.weight,
            _mean([entry.loss for entry in losses]), held_out, best, note,
        )  # fmt: skip

    def _broken(self, step: int, last: Losses) -> TrainingStep:
        if self.best_row < 0:
            raise StyleError(
                "The training gives numbers that are not finite from the start: check the parents for "
                "avatars with stray control points."
            )
        self.stopped = True
        kept = self.history[self.best_row].step
        return TrainingStep(
            step, self.trainer.steps, last.reconstruction, last.distribution, last.weight, last.loss,
            math.nan, False,
            f"the loss is no finite number any more at step {step}: the training stops, and the best state, "
            f"of step {kept}, is kept",
        )  # fmt: skip

    def _judged_by(self) -> Int[np.ndarray, " rows"]:
        """Return the parents by whose error the best state is chosen."""
        return self.data.held_out if len(self.data.held_out) else self.data.trained

    def _due(self, record: TrainingStep) -> bool:
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
            preset=self.preset, names=parents.names, unit=parents.unit, n=parents.template.n,
            smallest=float(parents.diameters.min()), largest=float(parents.diameters.max()),
            latents=model.core, seed=self.seed, steps=best.step,
            held_out=tuple(parents.names[row] for row in data.held_out),
            settings=self.options, versions=library_versions("torch", "safetensors"),
            parents_rms=float(known.mean()) if len(known) else math.nan,
            trained_rms=float(errors[data.trained].mean()),
            held_out_rms=best.held_out if len(data.held_out) else math.nan, notes=tuple(notes),
        )  # fmt: skip


def learn(
    parents: Serialization, preset: Preset = "aligned", *, seed: int = 0, **options: Any
) -> StyleLearner:
    """Return a style-learner trained on parents; arguments and errors of :class:`StyleTraining`."""
    return StyleTraining(parents, preset, seed=seed, **options).run()


def make_options(kind: type[Any], given: dict[str, Any]) -> Any:
    """Return the options record of a preset with these given.

    Raises
    ------
    StyleError
        If the preset has no such option or a value does not suit it.
    """
    known = [entry.name for entry in fields(kind)]
    for name in given:
        if name not in known:
            raise StyleError(f"This preset has no option '{name}': it has {', '.join(known)}.")
    return kind(**given)


def chosen_device(device: str) -> str:
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
