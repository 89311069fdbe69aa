"""Shaping grains by hand in the latent space: where one stands, how one came there, what was kept."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64
from PySide6.QtCore import QObject, Signal

from mbstudio.core.errors import MbstudioError
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.shaping import kept_grain as keeping
from mbstudio.core.vae.shaping.kept_grain import KeptGrain
from mbstudio.core.vae.shaping.latent_recipe import BEYOND, Operation, Recipe, carry_out, style_digest
from mbstudio.core.vae.shaping.live_grain import AT_REST, MOVING, LiveGrain, live_grain
from mbstudio.core.vae.shaping.meaning import Meanings
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from mbstudio.core.vae.shaping.parents_range import ParentsRange
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.latest_request_worker import LatestRequestWorker
from mbstudio.ui.stations.latent.history import ShapingHistory, Stance
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.project import ProjectState
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.shaping.latent_recipe import Recipe


log = logging.getLogger(__name__)

_ANEW = ("begin", "average", "take", "between", "sum")
"""Operations for which it does not matter what was before: a recipe begins with them."""


class LatentWork(Work):
    """The grain under the hand, its history, and the kept grains.

    Attributes
    ----------
    learner : StyleLearner or None
    about : ParentsRange or None
    meanings : Meanings or None
        None until they have been learned in the background.
    grain : LiveGrain or None
        What is shown, while a slider moves, too.
    history : ShapingHistory
    beyond : bool
        Whether operations may lead far outside the parents.
    is_held, is_beyond : bool
        Whether what is shown was held at the edge of the parents' range, or lies beyond it with leave.
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
        self.history = ShapingHistory(workspace)
        self.beyond = False
        self.locked_meanings: set[str] = set()
        self.locked_components: set[int] = set()
        self.is_held = self.is_beyond = False
        self._digest = ""
        self._learning: Task | None = None
        self.live = LatestRequestWorker("live grain", self)
        self.live.done.connect(self._arrived)
        self.live.failed.connect(self._failed)
        workspace.style_changed.connect(self.take_style)
        workspace.kept_changed.connect(self.kept_changed)

    # ---- the style-learner -----------------------------------------------------------------------

    def take_style(self) -> None:
        """Work with the workspace's style-learner from now on; kept grains of another one hide."""
        learner = self.workspace.style
        if learner is self._wanted:
            return
        self._wanted = learner
        self._use_learner(None, None)
        if learner is None:
            return
        task = Task(tr("Measuring the parents"), lambda control: ParentsRange.measure(learner))
        task.succeeded.connect(lambda about: self._use_learner(learner, about))
        self.queue.submit(task, lane="latent", key="about")

    def _use_learner(self, learner: StyleLearner | None, about: ParentsRange | None) -> None:
        if learner is not None and learner is not self._wanted:
            return
        self.learner, self.about, self.meanings, self.grain = learner, about, None, None
        self.locked_meanings.clear()
        self.locked_components.clear()
        self.history.begin(None)
        self.is_held, self.is_beyond, self._digest = False, False, ""
        if self._learning is not None:
            self._learning.cancel()
            self._learning = None
        if learner is not None and about is not None:
            self._digest = style_digest(learner)
            self.history.begin(Stance(about.mean, (Operation("average", {}, tr("average grain")),)))
            self._tell_of_others()
        self.kept_changed.emit()
        self.style_taken.emit()
        self.meanings_changed.emit()
        self.render()

    def _tell_of_others(self) -> None:
        others = len(self.workspace.state.kept) - len(self.kept)
        if others:
            self.said.emit("info", describe_other_kept(others))

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
            return Meanings.measure(
                learner, on_progress=lambda share: control.progress(share, tr("measuring grains"))
            )

        task = Task(tr("Learning what the latents mean"), work)
        task.succeeded.connect(lambda found: self._take_meanings(learner, found))
        task.ended.connect(lambda: self._learning_ended(task))
        self._learning = task
        self.queue.submit(task)
        self.meanings_changed.emit()

    @property
    def is_learning(self) -> bool:
        """Whether the meanings are being learned."""
        return self._learning is not None

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
        return self.history.stance

    @property
    def undo_title(self) -> str | None:
        """The step that undo takes back; None where there is none."""
        return self.history.undo_title

    @property
    def redo_title(self) -> str | None:
        """The step that redo makes again; None where there is none."""
        return self.history.redo_title

    def locks(self) -> dict[str, Any]:
        """Return what is locked, as operations want it."""
        meanings, components = sorted(self.locked_meanings), sorted(self.locked_components)
        return {
            **({"meanings": meanings} if meanings else {}),
            **({"components": components} if components else {}),
        }

    def preview(self, operation: Operation, *, instead: bool = False) -> None:
        """Show what an operation would lead to, coarsely; the newest one asked for wins."""
        learner, meanings = self.learner, self.meanings
        start, operation = self._start(operation, instead), self._with_permission(operation)
        if learner is None or start is None:
            return

        def work() -> tuple[LiveGrain, Stance]:
            moved, held = carry_out(learner, start.latent, operation, meanings)
            return live_grain(learner, moved, MOVING), Stance(moved, (operation,), held)

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
        learner = self.learner
        start, operation = self._start(operation, instead), self._with_permission(operation)
        if learner is None or start is None:
            return False
        try:
            latent, held = carry_out(learner, start.latent, operation, self.meanings)
        except MbstudioError as error:
            self.said.emit("error", str(error))
            self.render()
            return False
        before = () if operation.kind in _ANEW else start.operations
        self._push(Stance(latent, (*before, operation), held))
        return True

    def _start(self, operation: Operation, instead: bool) -> Stance | None:
        """Return where an operation begins: where one stands, or stood before the last one of its kind."""
        return self.history.before_last(operation.kind) if instead else self.history.stance

    def _with_permission(self, operation: Operation) -> Operation:
        """Return the operation with the leave to go far outside the parents, where that was given."""
        return replace(operation, given={**operation.given, BEYOND: True}) if self.beyond else operation

    def undo(self) -> None:
        """Go back one step."""
        if self.history.undo():
            self._show_step()

    def redo(self) -> None:
        """Go forth again."""
        if self.history.redo():
            self._show_step()

    def reset(self) -> None:
        """Go back to what the grain was before it was shaped, as one step of undo."""
        stance = self.stance
        if stance is not None and len(stance.operations) > 1:
            self.commit(stance.operations[0])

    def _push(self, stance: Stance) -> None:
        self.history.push(stance)
        self._show_step()

    def _show_step(self) -> None:
        self.render()
        self.stepped.emit()

    # ---- showing ---------------------------------------------------------------------------------

    def render(self) -> None:
        """Show where one stands, finely."""
        learner, stance = self.learner, self.stance
        if learner is None or stance is None:
            return

        def work() -> tuple[LiveGrain, Stance]:
            return live_grain(learner, stance.latent, AT_REST), stance

        self.live.ask(work, learner)

    def _arrived(self, learner: StyleLearner, found: tuple[LiveGrain, Stance]) -> None:
        if learner is self.learner:
            self.grain, shown = found
            self.is_held, self.is_beyond = shown.held and not shown.is_beyond, shown.is_beyond
            self.grain_changed.emit()

    def _failed(self, learner: StyleLearner, error: Exception) -> None:
        if learner is not self.learner:
            return
        if not isinstance(error, MbstudioError):
            log.error("A grain could not be shown", exc_info=error)
        self.said.emit("error", str(error))

    # ---- kept grains -----------------------------------------------------------------------------

    @property
    def kept(self) -> list[Recipe]:
        """Recipes of the kept grains that the style-learner can make."""
        return [grain.recipe for grain in self.kept_grains]

    @property
    def kept_grains(self) -> tuple[KeptGrain, ...]:
        """The kept grains that the style-learner can make."""
        return tuple(grain for grain in self.workspace.state.kept if grain.recipe.style == self._digest)

    def keep(self) -> Recipe | None:
        """Keep the grain where one stands, with its recipe."""
        learner, stance = self.learner, self.stance
        if learner is None or stance is None:
            return None
        if not keeping.is_sound(learner, stance.latent):
            self.said.emit(
                "warning", tr("The grain was kept, but it is not a valid body: a DEM engine would reject it.")
            )
        return self._keep([(stance.latent, stance.operations)])[0]

    def keep_variations(self, sigma: float, count: int, seed: int = 0) -> Task | None:
        """Keep variations of the grain where one stands."""
        learner, stance, meanings = self.learner, self.stance, self.meanings
        if learner is None or stance is None:
            return None
        given = {"sigma": sigma, **self.locks(), **({BEYOND: True} if self.beyond else {})}

        def work(control: Control) -> list[tuple[np.ndarray, Operation]]:
            at = stance.latent
            return keeping.find_variations(learner, at, given, count, seed, meanings, control.progress)

        def keep_found(made: list[tuple[np.ndarray, Operation]]) -> None:
            if len(made) < count:
                self.said.emit("warning", describe_few_valid(len(made), count))
            if learner is self.learner and made:
                self._keep([(latent, (*stance.operations, operation)) for latent, operation in made])

        task = Task(plural(count, mark("Making {count} variation"), mark("Making {count} variations")), work)
        task.succeeded.connect(keep_found)
        return self.queue.submit(task)

    def forget(self, names: Iterable[str]) -> None:
        """Take kept grains off the shelf, as one step of undo."""
        gone = set(names) & {recipe.name for recipe in self.kept}
        if gone:
            rest = tuple(grain for grain in self.workspace.state.kept if grain.name not in gone)
            self.history.change(tr("Remove {grains}", grains=", ".join(sorted(gone))), kept=rest)
            self.stepped.emit()

    def rename(self, name: str, to: str) -> bool:
        """Call a kept grain otherwise, as one step of undo; return whether it could be."""
        if self.learner is None or name == to.strip():
            return False
        try:
            named = keeping.rename_grain(self.workspace.state.kept, name, to, self.learner.parents.names)
        except MbstudioError as error:
            self.said.emit("error", str(error))
            self.kept_changed.emit()
            return False
        self.history.change(tr("Rename {name} to {new}", name=name, new=to.strip()), kept=named)
        self.stepped.emit()
        return True

    def _keep(self, made: list[tuple[np.ndarray, tuple[Operation, ...]]]) -> list[Recipe]:
        assert self.learner is not None
        before = self.workspace.state.kept
        first = keeping.next_number(before)
        found = [
            Recipe(f"kept {number}", tuple(latent.tolist()), operations, self._digest)
            for number, (latent, operations) in enumerate(made, first)
        ]
        self.history.change(
            keeping_title(found[0].name, len(found), first),
            kept=(*before, *keeping.measure_recipes(self.learner, found)),
        )
        self.stepped.emit()
        return found

    def latent_of(self, name: str) -> Float64[np.ndarray, " d"] | None:
        """Return the latent vector of a kept grain, a parent or a clone by its name."""
        return find_latent(name, self.kept, self.learner, self.clones)

    @property
    def clones(self) -> Generation | None:
        """The clones made last, where they are those of the style-learner at hand."""
        return find_clones(self.workspace.state, self.learner)

    def begin_with(self, name: str) -> None:
        """Take a parent, a kept grain or a clone under the hand."""
        recipe = next((kept for kept in self.kept if kept.name == name), None)
        if recipe is not None:
            stance = Stance(recipe.vector, recipe.operations)
            self._push(stance)
        elif self.learner is not None and name in self.learner.parents.names:
            self.commit(Operation("begin", {"parent": name}, name))
        elif (latent := self.latent_of(name)) is not None:
            self.commit(Operation("take", {"latent": latent.tolist()}, name))

    def close(self) -> None:
        """End the thread that shows grains."""
        if not self.live.close():
            log.warning("The thread that shows grains did not end in time.")

    def deviations_of(self, name: str) -> tuple[float, float]:
        """Return the reach of a meaning in standard deviations about the parents' mean."""
        assert self.meanings is not None
        low, high = self.meanings.units(self.meanings.reach)[:, MEANINGS.index(name)]
        return float(low), float(high)


def describe_other_kept(count: int) -> str:
    """Return what is told of kept grains of another style-learner."""
    if count == 1:
        return tr(
            "One kept grain belongs to another style-learner. It stays in the project and appears "
            "again with that style-learner."
        )
    return tr(
        "{count} kept grains belong to another style-learner. They stay in the project and "
        "appear again with that style-learner.",
        count=count,
    )


def describe_few_valid(made: int, wanted: int) -> str:
    """Return what is told where not all variations are valid."""
    return tr(
        "Only {made} of {wanted} variations are valid bodies. Use less noise, or start from a valid grain.",
        made=made,
        wanted=wanted,
    )


def keeping_title(name: str, count: int, first: int) -> str:
    """Return the history's title for grains that were kept, numbered from `first` on."""
    if count == 1:
        return tr("Keep {name}", name=name)
    return plural(
        count,
        mark("Keep {count} variation from {first}"),
        mark("Keep {count} variations from {first}"),
        first=first,
    )


def find_clones(state: ProjectState, learner: StyleLearner | None) -> Generation | None:
    """Return the clones of a project where they are those of a style-learner."""
    made = state.clones
    if made is None or learner is None or state.style is not learner:
        return None
    return made if made.latents.shape[1] == learner.dimension else None


def find_latent(
    name: str, kept: Sequence[Recipe], learner: StyleLearner | None, clones: Generation | None
) -> Float64[np.ndarray, " d"] | None:
    """Return the latent vector of a grain by its name: a kept one's before a parent's before a clone's."""
    for recipe in kept:
        if recipe.name == name:
            return recipe.vector
    if learner is not None and name in learner.parents.names:
        return np.array(learner.latents[learner.parents.names.index(name)], dtype=np.float64)
    if clones is not None and name in clones.clones.names:
        return np.array(clones.latents[clones.clones.names.index(name)], dtype=np.float64)
    return None
