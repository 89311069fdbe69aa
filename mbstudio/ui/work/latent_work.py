"""Shaping grains by hand in the latent space: where one stands, how one came there, what was kept."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64
from PySide6.QtCore import QObject, Signal

from mbstudio.core.errors import MbstudioError
from mbstudio.core.metaball.topology import topology
from mbstudio.core.vae.latent_recipe import Operation, Recipe, carried_out, style_digest
from mbstudio.core.vae.live_grain import AT_REST, MOVING, LiveGrain, live_grain
from mbstudio.core.vae.meaning import Meanings
from mbstudio.core.vae.meaning_factors import MEANINGS
from mbstudio.core.vae.parents_range import ParentsRange
from mbstudio.core.vae.style_learner import StyleLearner
from mbstudio.ui.latest import LatestOnly
from mbstudio.ui.work.work import Work
from mbstudio.ui.workers import Control, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

log = logging.getLogger(__name__)

_ANEW = ("begin", "average", "take", "between", "sum")
"""Operations for which it does not matter what was before: a recipe begins with them."""

_TRIALS = 4
"""Times as many variations are tried as are asked for, where some are no valid bodies."""


@dataclass(frozen=True, eq=False)
class Stance:
    """A point of the latent space and the way to it.

    Attributes
    ----------
    latent : float array, shape (d,)
    operations : tuple of Operation
    held : bool
        Whether the last operation had to be held within the parents' range.
    """

    latent: Float64[np.ndarray, " d"]
    operations: tuple[Operation, ...]
    held: bool = False

    @property
    def title(self) -> str:
        """What led here, in words."""
        return self.operations[-1].words if self.operations else ""


class LatentWork(Work):
    """The grain under the hand, its history, and the gallery of kept grains.

    Attributes
    ----------
    learner : StyleLearner or None
    about : ParentsRange or None
    meanings : Meanings or None
        None until they have been learned in the background.
    grain : LiveGrain or None
        What is shown, while a slider moves, too.
    kept : list of Recipe
    style_taken : signal
        Another style-learner, or none.
    meanings_changed : signal
    stepped : signal
        The point where one stands changed: an operation, undo or redo.
    grain_changed : signal
    kept_changed : signal
    """

    style_taken = Signal()
    meanings_changed = Signal()
    stepped = Signal()
    grain_changed = Signal()
    kept_changed = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self.learner: StyleLearner | None = None
        self._wanted: StyleLearner | None = None
        self.about: ParentsRange | None = None
        self.meanings: Meanings | None = None
        self.grain: LiveGrain | None = None
        self.kept: list[Recipe] = []
        self.locked_meanings: set[str] = set()
        self.locked_components: set[int] = set()
        self.is_held = False
        self.progress = 0.0
        self._history: list[Stance] = []
        self._place = 0
        self._learning: Task | None = None
        self._counter = 0
        self.live = LatestOnly("live grain", self)
        self.live.done.connect(self._arrived)
        self.live.failed.connect(self._failed)
        workspace.style_changed.connect(self.take_style)

    # ---- the style-learner -----------------------------------------------------------------------

    def take_style(self) -> None:
        """Work with the workspace's style-learner from now on; kept grains of another one go."""
        learner = self.workspace.style
        if learner is self._wanted:
            return
        self._wanted = learner
        self._take(None, None)
        if learner is None:
            return
        task = Task("Measuring the parents", lambda control: ParentsRange.of(learner))
        task.succeeded.connect(lambda about: self._take(learner, about))
        self.queue.submit(task, lane="latent", key="about")

    def _take(self, learner: StyleLearner | None, about: ParentsRange | None) -> None:
        if learner is not None and learner is not self._wanted:
            return
        self.learner, self.about, self.meanings, self.grain = learner, about, None, None
        self.locked_meanings.clear()
        self.locked_components.clear()
        self._history, self._place, self.is_held, self.progress = [], 0, False, 0.0
        if self._learning is not None:
            self._learning.cancel()
            self._learning = None
        if learner is not None and about is not None:
            digest = style_digest(learner)
            self.kept = [recipe for recipe in self.kept if recipe.style == digest]
            self._history = [Stance(about.mean, (Operation("average", {}, "average grain"),))]
        self.kept_changed.emit()
        self.style_taken.emit()
        self.meanings_changed.emit()
        self.render()

    @property
    def is_opening(self) -> bool:
        """Whether a style-learner has been taken over whose parents are still being measured."""
        return self._wanted is not None and self.learner is None

    def learn_meanings(self) -> None:
        """Learn the meanings in the background unless they are there, or on the way."""
        learner = self.learner
        if learner is None or self.meanings is not None or self._learning is not None:
            return

        def work(control: Control) -> Meanings:
            return Meanings.of(learner, on_progress=lambda share: control.progress(share, "measuring grains"))

        task = Task("Learning what the latents mean", work)
        task.succeeded.connect(lambda found: self._take_meanings(learner, found))
        task.reported.connect(self._progressed)
        task.ended.connect(lambda: self._learning_ended(task))
        self._learning = task
        self.queue.submit(task)
        self.meanings_changed.emit()

    @property
    def is_learning(self) -> bool:
        """Whether the meanings are being learned."""
        return self._learning is not None

    def _progressed(self, report: Any) -> None:
        self.progress = max(0.0, report.fraction)
        self.meanings_changed.emit()

    def _take_meanings(self, learner: StyleLearner, found: Meanings) -> None:
        if learner is self.learner:
            self.meanings = found

    def _learning_ended(self, task: Task) -> None:
        if self._learning is task:
            self._learning = None
            self.meanings_changed.emit()

    # ---- where one stands ------------------------------------------------------------------------

    @property
    def stance(self) -> Stance | None:
        """The point where one stands; None without a style-learner."""
        return self._history[self._place] if self._history else None

    @property
    def can_undo(self) -> bool:
        return self._place > 0

    @property
    def can_redo(self) -> bool:
        return self._place < len(self._history) - 1

    def locks(self) -> dict[str, Any]:
        """Return what is locked, as operations want it."""
        meanings, components = sorted(self.locked_meanings), sorted(self.locked_components)
        return {
            **({"meanings": meanings} if meanings else {}),
            **({"components": components} if components else {}),
        }

    def preview(self, operation: Operation, *, instead: bool = False) -> None:
        """Show what an operation would lead to, coarsely; the newest one asked for wins."""
        learner, meanings, start = self.learner, self.meanings, self._start(operation, instead)
        if learner is None or start is None:
            return

        def work() -> tuple[LiveGrain, bool]:
            moved, held = carried_out(learner, start.latent, operation, meanings)
            return live_grain(learner, moved, MOVING), held

        self.live.ask(work, learner)

    def commit(self, operation: Operation, *, instead: bool = False) -> bool:
        """Carry an operation out, as one step of undo; return whether it could be.

        Parameters
        ----------
        operation : Operation
        instead : bool
            Whether it takes the place of the last operation if that was of its kind: the same noise with
            another seed or strength.
        """
        learner, start = self.learner, self._start(operation, instead)
        if learner is None or start is None:
            return False
        try:
            latent, held = carried_out(learner, start.latent, operation, self.meanings)
        except MbstudioError as error:
            self.said.emit("error", str(error))
            self.render()
            return False
        before = () if operation.kind in _ANEW else start.operations
        self._push(Stance(latent, (*before, operation), held))
        return True

    def _start(self, operation: Operation, instead: bool) -> Stance | None:
        """Return where an operation begins: where one stands, or stood before the last one of its kind."""
        stance = self.stance
        if stance is None or not instead or not stance.operations[1:]:
            return stance
        if stance.operations[-1].kind != operation.kind:
            return stance
        before = (past for past in reversed(self._history[: self._place]))
        return next((past for past in before if past.operations == stance.operations[:-1]), stance)

    def undo(self) -> None:
        """Go back one step."""
        self._go_to(self._place - 1)

    def redo(self) -> None:
        """Go forth again."""
        self._go_to(self._place + 1)

    def reset(self) -> None:
        """Go back to what the grain was before it was shaped, as one step of undo."""
        stance = self.stance
        if stance is not None and len(stance.operations) > 1:
            self.commit(stance.operations[0])

    def _push(self, stance: Stance) -> None:
        self._history = [*self._history[: self._place + 1], stance]
        self._go_to(len(self._history) - 1)

    def _go_to(self, place: int) -> None:
        if 0 <= place < len(self._history):
            self._place = place
            self.render()
            self.stepped.emit()

    # ---- showing ---------------------------------------------------------------------------------

    def render(self) -> None:
        """Show where one stands, finely."""
        learner, stance = self.learner, self.stance
        if learner is None or stance is None:
            return

        def work() -> tuple[LiveGrain, bool]:
            return live_grain(learner, stance.latent, AT_REST), stance.held

        self.live.ask(work, learner)

    def _arrived(self, learner: StyleLearner, found: tuple[LiveGrain, bool]) -> None:
        if learner is self.learner:
            self.grain, self.is_held = found
            self.grain_changed.emit()

    def _failed(self, learner: StyleLearner, error: Exception) -> None:
        if learner is not self.learner:
            return
        if not isinstance(error, MbstudioError):
            log.error("A grain could not be shown", exc_info=error)
        self.said.emit("error", str(error))

    # ---- kept grains -----------------------------------------------------------------------------

    def keep(self) -> Recipe | None:
        """Put the grain where one stands into the gallery, with its recipe."""
        stance = self.stance
        if stance is None:
            return None
        if self.learner is not None and not _is_sound(self.learner, stance.latent):
            self.said.emit("warning", "Kept, but it is no valid body: a DEM engine would not take it.")
        return self._keep([(stance.latent, stance.operations)])[0]

    def keep_variations(self, sigma: float, count: int, seed: int = 0) -> list[Recipe]:
        """Put variations of the grain where one stands into the gallery: 'more like this'."""
        learner, stance = self.learner, self.stance
        if learner is None or stance is None:
            return []
        made: list[tuple[np.ndarray, tuple[Operation, ...]]] = []
        for number in range(seed, seed + _TRIALS * count):
            given = {"sigma": sigma, "seed": number, **self.locks()}
            operation = Operation("noise", given, f"noise σ {sigma:g} (seed {number})")
            latent = carried_out(learner, stance.latent, operation, self.meanings)[0]
            if _is_sound(learner, latent):
                made.append((latent, (*stance.operations, operation)))
            if len(made) == count:
                break
        if len(made) < count:
            self.said.emit(
                "warning",
                f"Only {len(made)} of {count} variations are valid bodies: take less noise, or begin with a "
                "valid grain.",
            )
        return self._keep(made)

    def forget(self, names: Iterable[str]) -> None:
        """Take kept grains out of the gallery."""
        gone = set(names)
        self.kept = [recipe for recipe in self.kept if recipe.name not in gone]
        self.kept_changed.emit()

    def _keep(self, made: list[tuple[np.ndarray, tuple[Operation, ...]]]) -> list[Recipe]:
        assert self.learner is not None
        digest, found = style_digest(self.learner), []
        for latent, operations in made:
            self._counter += 1
            found.append(Recipe(f"kept {self._counter}", tuple(latent.tolist()), operations, digest))
        self.kept = [*self.kept, *found]
        self.kept_changed.emit()
        return found

    def latent_of(self, name: str) -> Float64[np.ndarray, " d"] | None:
        """Return the latent vector of a kept grain or a parent by its name."""
        for recipe in self.kept:
            if recipe.name == name:
                return recipe.vector
        if self.learner is not None and name in self.learner.parents.names:
            return np.array(self.learner.latents[self.learner.parents.names.index(name)])
        return None

    def begin_with(self, name: str) -> None:
        """Take a parent or a kept grain under the hand."""
        recipe = next((kept for kept in self.kept if kept.name == name), None)
        if recipe is not None:
            stance = Stance(recipe.vector, recipe.operations)
            self._push(replace(stance))
        elif self.latent_of(name) is not None:
            self.commit(Operation("begin", {"parent": name}, f"{name}"))

    def close(self) -> None:
        """End the thread that shows grains."""
        if not self.live.close():
            log.warning("The thread that shows grains did not end in time.")

    def deviations_of(self, name: str) -> tuple[float, float]:
        """Return the reach of a meaning in standard deviations about the parents' mean."""
        assert self.meanings is not None
        low, high = self.meanings.units(self.meanings.reach)[:, MEANINGS.index(name)]
        return float(low), float(high)


def _is_sound(learner: StyleLearner, latent: np.ndarray) -> bool:
    return topology(learner.decode(latent[None]).avatar(0).control).is_sound
