"""What a fit yields while it runs, and what it leaves behind.

A fit is a *step object*: an iterator of :class:`SearchStep`. The loop stands with whoever
drives it (command line, window, batch, test); pausing is not calling ``next``, cancelling is
dropping the object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from jaxtyping import Float

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.validity import Verdict

Phase = Literal["clustering", "search"]
Method = Literal["fast", "paper"]
FittedTo = Literal["labels", "grey values"]


@dataclass(frozen=True, eq=False)
class SearchStep:
    """One step of Metaball-Imaging.

    Attributes
    ----------
    phase : {'clustering', 'search'}
        Sphere clustering (Algorithm 1: one step a sphere) or gradient search (Algorithm 2:
        one step a generation; generation 0 is its start).
    generation : int
        Spheres found so far, or generations of the search.
    generations : int
        How many this phase will take at most: for progress bars.
    loss : float
        Mean over the hull points of the paper's piecewise loss (Eq. GSloss); NaN while clustering.
    rms : float
        Root mean square distance of surface points to the avatar, in the grain's unit; NaN while clustering.
    make_avatar : callable
        Builds the avatar as it stands at this step; use :attr:`avatar`.
    note : str
        What happened at this step beyond the ordinary ("3 control points of an island dropped").
    """

    phase: Phase
    generation: int
    generations: int
    loss: float
    rms: float
    make_avatar: Callable[[], Avatar] = field(repr=False)
    note: str = ""

    @cached_property
    def avatar(self) -> Avatar:
        return self.make_avatar()


@dataclass(frozen=True, eq=False)
class FitResult:
    """A finished (or stopped) fit.

    Attributes
    ----------
    avatar : Avatar
    history : float array, shape (generations + 1,)
        Paper's mean loss per generation of the search, the start included.
    rms_history : float array, shape (generations + 1,)
        Root mean square surface distance per generation, in the avatar's unit.
    verdict : Verdict
    method : {'fast', 'paper'}
    n : int
        Control points asked for (the avatar can hold fewer).
    seed : int
    options : mapping
        Those of the method's options that were not at their defaults, by name.
    target : str
        What the avatar was to reach, where that was asked for instead of a number of control points; `n`
        is then the number that was found.
    reached : mapping
        What it has reached of the target, by measure: errors as shares, the overlap as it is.
    fitted_to : {'labels', 'grey values'}
        What the avatar was fitted to: the grain's voxels, or the scan's grey values with all other grains'.
    """

    avatar: Avatar
    history: Float[np.ndarray, "g"]
    rms_history: Float[np.ndarray, "g"]
    verdict: Verdict
    method: Method
    n: int
    seed: int
    options: Mapping[str, Any] = field(default_factory=dict)
    target: str = ""
    reached: Mapping[str, float] = field(default_factory=dict)
    fitted_to: FittedTo = "labels"


class FitRun(Protocol):
    """The step object that :func:`mbstudio.core.imaging.start_fit` returns for either method."""

    def __iter__(self) -> Iterator[SearchStep]: ...
    def __next__(self) -> SearchStep: ...

    def change_control_points(self, n: int) -> None:
        """Go on from here with another number of control points, at a loss no larger than a fresh start's.

        Those there are are kept, split or merged, where that is the better of the two.

        Raises
        ------
        FitError
            If the grain cannot hold n control points; the run then stays as it was.
        """

    def more_generations(self, count: int) -> None:
        """Let a finished search go on for `count` more generations."""

    def result(self) -> FitResult:
        """Return avatar, history and verdict as they stand now; valid once the search has begun."""
