"""What a training yields while it runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Losses:
    """Items of the loss at one step; their meaning is the preset's."""

    reconstruction: float
    distribution: float
    weight: float
    loss: float


@dataclass(frozen=True)
class TrainingStep:
    """One recorded step of a training.

    Attributes
    ----------
    step, steps : int
        Steps done, and how many there will be.
    reconstruction, distribution : float
        Items of the loss (mean over the steps since the last record).
    weight : float
        Of the distribution item, by the annealer.
    loss : float
        What is minimised.
    held_out : float
        Validation error: root mean square surface distance of the parents that were held out and what
        the model makes of them, in D_n (mean over them); of all parents if none is held out,
        and when a learner learns on.
    best : bool
        Whether this is the best state so far, to be kept.
    note : str
        What happened beyond the ordinary.
    """

    step: int
    steps: int
    reconstruction: float
    distribution: float
    weight: float
    loss: float
    held_out: float
    best: bool
    note: str = ""
