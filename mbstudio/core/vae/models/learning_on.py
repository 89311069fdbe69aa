"""Learning on: new parents for a style-learner that is trained already."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Int

from mbstudio.core.errors import StyleError
from mbstudio.core.units import conversion_factor
from mbstudio.core.vae.models.presets import find_preset
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import StyleTraining, choose_device
from mbstudio.core.vae.models.training_data import TrainingData
from mbstudio.core.vae.serialize.serialization import Serialization


class LearningOn(StyleTraining):
    """A short training of a trained learner: a step object like :class:`StyleTraining`.

    New parents are learned and the old ones replayed, so that they are not forgotten; those held out
    before stay so. A preset that is found at once (`pca`) begins anew with all of them.

    Parameters
    ----------
    learner : StyleLearner
    new : Serialization
        One avatar or more, serialized from the learner's template, in whatever unit.
    seed : int
    device : {'cpu', 'cuda', 'auto'}
    **options
        Of the preset; those of the first training are kept but for steps, rate and annealer.

    Raises
    ------
    StyleError
        If there are no new parents, they are of another template, or one does not belong to the others.
    """

    def __init__(
        self, learner: StyleLearner, new: Serialization, *, seed: int = 0, device: str = "cpu", **options: Any
    ) -> None:
        if not len(new):
            raise StyleError("There are no new parents: give at least one avatar.")
        model = learner.model
        model.scaler.check(new)
        preset = find_preset(learner.preset)
        given = learner.card.settings | dict(preset.learning_on) | options
        record = preset.options.make(given)
        parents = join_parents(learner.parents, new)
        # What is found at once begins anew; the others keep the scale in which they have learned.
        scaler = model.scaler if preset.in_steps else None
        whole = TrainingData.from_parents(parents, record.held_out, seed, scaler)
        known = set(learner.card.held_out)
        old = np.arange(len(learner.parents))
        aside = [row for row in old if learner.parents.names[row] in known]
        order = len(old) + np.random.default_rng([abs(int(seed)), 4]).permutation(len(new))
        aside += order[: round(record.held_out * len(new))].tolist()
        rest = np.setdiff1d(np.arange(len(parents)), aside)
        data = whole.split(rest, np.array(sorted(aside), dtype=np.int64))
        trainer = preset.trainer(data, record, seed, choose_device(device), model)
        trainer.replay(rest[rest < len(old)], rest[rest >= len(old)])
        trainer.notes = (
            *trainer.notes,
            f"Training continued from {len(old)} to {len(parents)} parents, {len(new)} of them new.",
        )
        self._old_steps = learner.card.steps
        self._begin(preset, seed, data, trainer, given)
        self.begun_from = _digest(learner)

    def _validation_rows(self) -> Int[np.ndarray, " rows"]:
        """Return all parents: the new are to be learned and the old not to be forgotten."""
        return np.arange(len(self.data.parents)) if self.preset.in_steps else super()._validation_rows()

    def result(self) -> StyleLearner:
        """Return the learner of the best state so far, of old and new parents."""
        learner = super().result()
        card = replace(learner.card, steps=learner.card.steps + self._old_steps)
        aside = self.data.held_out
        if self.preset.in_steps and len(aside):  # what is found at once is of all parents by now
            some = self.data.parents.take(aside)
            made = learner.decode(learner.latents[aside, : learner.core])
            card = replace(card, held_out_rms=float(surface_rms(some, made).mean()))
        return replace(learner, card=card)


def _digest(learner: StyleLearner) -> str:
    """Return the SHA-256 of the numbers of a model."""
    found = hashlib.sha256()
    for name, array in sorted(learner.model.tensors().items()):
        found.update(f"{name} {array.dtype.str} {array.shape}".encode("ascii"))
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()


def learn_on(learner: StyleLearner, new: Serialization, *, seed: int = 0, **options: Any) -> LearningOn:
    """Return the step object that teaches new parents to a trained learner; see :class:`LearningOn`."""
    return LearningOn(learner, new, seed=seed, **options)


def join_parents(first: Serialization, second: Serialization) -> Serialization:
    """Return the avatars of both, in the unit and with the template of the first."""
    factor = conversion_factor(second.unit, first.unit)
    return replace(
        first,
        centers=np.concatenate([first.centers, second.centers]),
        log_weights=np.concatenate([first.log_weights, second.log_weights]),
        diameters=np.concatenate([first.diameters, second.diameters * factor]),
        names=(*first.names, *second.names),
        rms=np.concatenate([first.rms, second.rms]),
        valid=np.concatenate([first.valid, second.valid]),
    )
