"""What a preset of the style-learner consists of: a model, its options, and how it is trained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from jaxtyping import Int

from mbstudio.core.vae.models.shape_model import ShapeModel, Tensors
from mbstudio.core.vae.models.training_data import TrainingData
from mbstudio.core.vae.models.training_step import Losses


class Trainer(Protocol):
    """Parameters of a model, and one step of their improvement.

    Attributes
    ----------
    steps : int
        0 where the model is found at once.
    record_every : int
        Steps between two records.
    annealing_ends : int
        First step at which the distribution item has its full weight: before it an error says little about
        the end.
    notes : tuple of str
        For the model card, in sentences.
    """

    steps: int
    record_every: int
    annealing_ends: int
    notes: tuple[str, ...]

    def advance(self, step: int) -> Losses:
        """Make step `step`, counted from 0; all chance in it follows from seed and step."""

    def replay(self, old: Int[np.ndarray, " old"], new: Int[np.ndarray, " new"]) -> None:
        """Tell parents that were learned before from new ones, before the first step: rows of each."""

    def weights(self) -> Tensors:
        """Return a copy of the parameters."""

    def state(self) -> Tensors:
        """Return parameters and all else that the next step depends on."""

    def restore(self, state: Tensors) -> None:
        """Go back to a state."""

    def rms(self, rows: Int[np.ndarray, " rows"]) -> float:
        """Return the mean surface distance of these parents and what the model makes of them."""

    def model(self, weights: Tensors) -> ShapeModel:
        """Return the finished model with these parameters."""

    def move_to_processor(self) -> bool:
        """Leave the GPU; False if it was not there."""


class MakeTrainer(Protocol):
    """Makes the trainer of parents: from the beginning, or going on from a trained model."""

    def __call__(
        self, data: TrainingData, options: Any, seed: int, device: str, start: Any = None
    ) -> Trainer: ...


@dataclass(frozen=True)
class StylePreset:
    """A kind of style-learner: the entry with which its module ends.

    Attributes
    ----------
    name : str
        As in files and on the command line.
    title, summary : str
        For people: its name, and what it is for in a sentence.
    model : type
        A class of :class:`~mbstudio.core.vae.models.shape_model.ShapeModel`.
    options : type
        An :class:`~mbstudio.core.options.OptionRecord`; `held_out`, the share of the parents held out, is one
        of its fields.
    trainer : callable
    in_steps : bool
        Whether it is trained in steps and goes on from a trained model. Else it is found at once from all
        parents, also when it learns on.
    learning_on : mapping of str to value
        Options that differ when it learns on.
    enough_parents : int
        With fewer another preset does better.
    """

    name: str
    title: str
    summary: str
    model: type[ShapeModel]
    options: type[Any]
    trainer: MakeTrainer
    in_steps: bool = True
    learning_on: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    enough_parents: int = 0
