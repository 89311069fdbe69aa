"""Shaping grains by hand from the surfaces of a style: where one stands, and how one came there."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64
from PySide6.QtCore import QObject, QTimer, Signal

from mbstudio.core.cloning.parent_surface import coarser
from mbstudio.core.cloning.surface_design import (
    PLAIN_FACTORS,
    ParentFactors,
    add_difference,
    design,
    plain_factors,
    reach_all,
    surface_of_parent,
)
from mbstudio.core.cloning.surface_studio import (
    BANDED_FACTORS,
    MOVING_FACES,
    SHAPE_FACTORS,
    GrainShape,
    ShapedGrain,
    SurfaceStudio,
)
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import MbstudioError
from mbstudio.ui.language import tr
from mbstudio.ui.latest_request_worker import LatestRequestWorker
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_avatar import SurfaceAvatar
    from mbstudio.core.cloning.surface_generation import SurfaceGeneration

log = logging.getLogger(__name__)

REST = 350
"""Milliseconds without a move after which the metaball is fitted."""
_MEASURED = 24
"""Parents that say how far sliders reach."""
_WIDER = 0.5
"""Of the parents' range, by which sliders go beyond it on either side."""

Change = Callable[[SurfaceStudio, GrainShape], tuple[GrainShape, bool]]
"""What a move does to a shape, and whether it could not go as far as was asked."""


@dataclass(frozen=True, eq=False)
class Step:
    """A shape, and what led to it."""

    shape: GrainShape
    words: str
    held: bool = False


@dataclass(frozen=True, eq=False)
class _Ready:
    """A style made ready for shaping: studios at rest and under the hand, and how far sliders reach."""

    style: SurfaceStyle
    at_rest: SurfaceStudio
    moving: SurfaceStudio
    ranges: Mapping[str, tuple[float, float, float]]
    plain: Float64[np.ndarray, "parents 6"]


class SurfaceWork(Work):
    """The shaped grain, its history, and its metaball once the hand rests.

    Attributes
    ----------
    grain : ShapedGrain or None
        What is shown, while a slider moves, too.
    at_rest : ShapedGrain or None
        Where one stands, finely.
    is_held : bool
        Whether what is shown could not go as far as was asked.
    fitted : SurfaceAvatar or None
        The metaball of `at_rest`; None until it has been fitted.
    ranges : mapping of str to (float, float, float)
        By factor: lowest, middle and highest value of the sliders.
    locked : frozenset of str
        Factors that stay while others move.
    parents : float array, shape (parents, 6)
        Their factors, in the order of `PLAIN_FACTORS`.
    style_taken, stepped, grain_changed, fitted_changed, locks_changed : signal
    """

    style_taken = Signal()
    stepped = Signal()
    grain_changed = Signal()
    fitted_changed = Signal()
    locks_changed = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self._wanted: SurfaceStyle | None = None
        self._ready: _Ready | None = None
        self._steps: list[Step] = []
        self._place = 0
        self._scales: tuple[Step, str, float] | None = None
        self.grain: ShapedGrain | None = None
        self.at_rest: ShapedGrain | None = None
        self.fitted: SurfaceAvatar | None = None
        self.is_held = False
        self.locked: frozenset[str] = frozenset()
        self.live = LatestRequestWorker("shaped grain", self)
        self.live.done.connect(self._arrived)
        self.live.failed.connect(self._failed)
        self.balls = LatestRequestWorker("metaball of the shaped grain", self)
        self.balls.done.connect(self._ball_arrived)
        self.balls.failed.connect(self._failed)
        self._rest = QTimer(self)
        self._rest.setSingleShot(True)
        self._rest.setInterval(REST)
        self._rest.timeout.connect(self._fit)
        workspace.style_changed.connect(self.take_style)

    # ---- the style -------------------------------------------------------------------------------

    @property
    def style(self) -> SurfaceStyle | None:
        """The style that is ready for shaping."""
        return None if self._ready is None else self._ready.style

    @property
    def is_opening(self) -> bool:
        """Whether a style has been taken over whose parents are still being measured."""
        return self._wanted is not None and self._ready is None

    @property
    def parents(self) -> Float64[np.ndarray, "parents 6"]:
        return np.empty((0, len(PLAIN_FACTORS))) if self._ready is None else self._ready.plain

    @property
    def ranges(self) -> Mapping[str, tuple[float, float, float]]:
        return {} if self._ready is None else self._ready.ranges

    def take_style(self) -> None:
        """Work with the workspace's style of surfaces from now on."""
        style = self.workspace.surfaces
        if style is self._wanted:
            return
        self._wanted = style
        self._forget()
        if style is not None:
            task = Task(tr("Measuring the parents"), lambda control: _made_ready(style, control))
            task.succeeded.connect(self._use)
            self.queue.submit(task, lane="latent", key="surfaces")
        self.style_taken.emit()

    def _forget(self) -> None:
        self._ready, self._steps, self._place = None, [], 0
        self.grain = self.at_rest = self.fitted = None
        self.is_held, self._scales = False, None
        self._rest.stop()

    def _use(self, ready: _Ready) -> None:
        if ready.style is not self._wanted:
            return
        self._ready = ready
        self._steps = [Step(ready.at_rest.begin(0), ready.style.parents[0].name)]
        self._place = 0
        self.style_taken.emit()
        self._show_step()

    # ---- where one stands ------------------------------------------------------------------------

    @property
    def step(self) -> Step | None:
        """Where one stands; None without a style."""
        return self._steps[self._place] if self._steps else None

    @property
    def words(self) -> list[str]:
        """What led here, in order."""
        return [step.words for step in self._steps[: self._place + 1]]

    @property
    def undo_title(self) -> str | None:
        """The step that undo takes back; None where there is none."""
        return self._steps[self._place].words if self._place > 0 else None

    @property
    def redo_title(self) -> str | None:
        """The step that redo makes again; None where there is none."""
        after = self._place + 1
        return self._steps[after].words if after < len(self._steps) else None

    def undo(self) -> None:
        """Go back one step."""
        if self._place > 0:
            self._place -= 1
            self._show_step()

    def redo(self) -> None:
        """Go forth again."""
        if self._place + 1 < len(self._steps):
            self._place += 1
            self._show_step()

    def begin_with(self, parent: int) -> None:
        """Take a parent under the hand, as one step of undo."""
        if self._ready is not None:
            name = self._ready.style.parents[parent].name
            self.commit(lambda studio, shape: (studio.begin(parent), False), name)

    def reset(self) -> None:
        """Go back to the parent as it is, as one step of undo."""
        if self.step is not None:
            self.begin_with(self.step.shape.parent)

    # ---- moves -----------------------------------------------------------------------------------

    def preview(self, change: Change, factor: str = "") -> None:
        """Show what a change would lead to, on a coarse surface; the newest one asked for wins."""
        ready, step = self._ready, self.step
        if ready is None or step is None:
            return
        self._rest.stop()

        def work() -> tuple[ShapedGrain, bool]:
            shape, held = change(ready.moving, step.shape)
            return ready.moving.make(shape, hull=factor == "convexity"), held

        self.live.ask(work, (ready, None))

    def reach(self, factor: str, wanted: float, *, final: bool) -> None:
        """Give one factor another value."""
        title = tr("{factor} {value:.3g}", factor=factor, value=wanted)
        if self.locked - {factor}:
            self.reach_many({factor: wanted}, title, final=final)
            return
        scale = 1.0 if final or factor not in BANDED_FACTORS else self._scale_of(factor)

        def change(studio: SurfaceStudio, shape: GrainShape) -> tuple[GrainShape, bool]:
            return studio.reach(shape, factor, wanted * scale)

        if final:
            self.commit(change, title)
        else:
            self.preview(change, factor)

    def reach_many(self, targets: Mapping[str, float], words: str, *, final: bool) -> Task | None:
        """Give several factors other values; those that are locked stay.

        While the hand moves a stand-in follows; at the end a task finds the surface itself, where that may
        take longer than the window may pause.
        """
        wanted = {**self.locked_values, **targets}
        banded = [name for name in wanted if name in BANDED_FACTORS]
        scales = {} if final else {name: self._scale_of(name) for name in banded}

        def change(studio: SurfaceStudio, shape: GrainShape) -> tuple[GrainShape, bool]:
            found = reach_all(
                studio, shape, {name: value * scales.get(name, 1.0) for name, value in wanted.items()}
            )
            return found.grain.shape, bool(found.missed)

        if not final:
            self.preview(change, "convexity" if "convexity" in wanted else "")
            return None
        if banded:
            return self.commit_later(change, words)
        self.commit(change, words)
        return None

    def draw(self, seed: int, words: str) -> Task | None:
        """Take a clone drawn at random under the hand, with the factors that are locked."""
        held = self.locked_values

        def change(studio: SurfaceStudio, _shape: GrainShape) -> tuple[GrainShape, bool]:
            drawn = studio.draw(seed)
            if not held:
                return drawn, False
            found = reach_all(studio, drawn, held)
            return found.grain.shape, bool(found.missed)

        if not held.keys() & set(BANDED_FACTORS):
            self.commit(change, words)
            return None
        return self.commit_later(change, words)

    def find(self, targets: Mapping[str, float], words: str) -> Task | None:
        """Find a grain of given factors among what all parents can be made into (inverse design)."""
        known = ParentFactors.plain(self.parents)

        def change(studio: SurfaceStudio, _shape: GrainShape) -> tuple[GrainShape, bool]:
            found = design(studio, known, targets)
            return found.grain.shape, bool(found.missed)

        return self.commit_later(change, words)

    def add(self, plus: int, minus: int, strength: float) -> Task | None:
        """Change the grain's factors as one parent's differ from another's."""
        ready = self._ready
        if ready is None:
            return None
        names = [ready.style.parents[row].name for row in (plus, minus)]

        def change(studio: SurfaceStudio, shape: GrainShape) -> tuple[GrainShape, bool]:
            found = add_difference(studio, shape, studio.begin(plus), studio.begin(minus), strength)
            return found.grain.shape, bool(found.missed)

        words = tr("{strength:+.2f} ({a} − {b})", strength=strength, a=names[0], b=names[1])
        return self.commit_later(change, words)

    def lock(self, factor: str, locked: bool) -> None:
        """Hold a factor while others move, or let it go."""
        self.locked = self.locked | {factor} if locked else self.locked - {factor}
        self.locks_changed.emit()

    @property
    def locked_values(self) -> dict[str, float]:
        """The factors that are held, as they are where one stands."""
        values = {} if self.at_rest is None else self.at_rest.values
        return {name: values[name] for name in SHAPE_FACTORS if name in self.locked and name in values}

    def _scale_of(self, factor: str) -> float:
        """Return a factor of the coarse stand-in, which is smoother, over that of the surface itself."""
        ready, step, fine = self._ready, self.step, self.at_rest
        if ready is None or step is None or fine is None or fine.shape is not step.shape:
            return 1.0
        known = self._scales
        if known is None or known[0] is not step or known[1] != factor:
            coarse = ready.moving.make(step.shape, hull=factor == "convexity").values.get(factor)
            true = fine.values.get(factor)
            known = self._scales = (step, factor, 1.0 if not coarse or not true else coarse / true)
        return known[2]

    def commit(self, change: Change, words: str) -> bool:
        """Carry a change out, as one step of undo; return whether it could be."""
        ready, step = self._ready, self.step
        if ready is None or step is None:
            return False
        try:
            shape, held = change(ready.at_rest, step.shape)
        except MbstudioError as error:
            self.said.emit("error", str(error))
            self._show_step()
            return False
        self._add_step(Step(shape, words, held))
        return True

    def commit_later(self, change: Change, words: str) -> Task | None:
        """Carry a change out in a task, as one step of undo once it is done."""
        ready, step = self._ready, self.step
        if ready is None or step is None:
            return None

        def done(found: tuple[GrainShape, bool]) -> None:
            if ready is self._ready and step is self.step:
                self._add_step(Step(found[0], words, found[1]))

        task = Task(words, lambda control: change(ready.at_rest, step.shape))
        task.succeeded.connect(done)
        task.failed.connect(lambda _: self._show_step())
        return self.queue.submit(task, lane="latent", key="shape")

    def _add_step(self, step: Step) -> None:
        self._steps = [*self._steps[: self._place + 1], step]
        self._place = len(self._steps) - 1
        self._show_step()

    def blend_with(self, other: int | None) -> Task | None:
        """Get ready to blend with another parent: its surface is laid onto the one at hand."""
        ready, step = self._ready, self.step
        if ready is None or step is None:
            return None
        if other is None or other == step.shape.parent:
            self.commit(lambda studio, shape: studio.blended(shape, None, 0.0), tr("not blended"))
            return None
        names = [parent.name for parent in ready.style.parents]

        def work(control: Control) -> None:
            for studio in (ready.moving, ready.at_rest):
                studio.make(studio.blended(step.shape, other, 0.5)[0], hull=False)

        task = Task(tr("Laying {a} onto {b}", a=names[step.shape.parent], b=names[other]), work)
        task.succeeded.connect(
            lambda _: self.commit(
                lambda studio, shape: studio.blended(shape, other, 0.5),
                tr("half {a}, half {b}", a=names[step.shape.parent], b=names[other]),
            )
        )
        return self.queue.submit(task, lane="latent", key="blend")

    # ---- showing ---------------------------------------------------------------------------------

    def _show_step(self) -> None:
        self.fitted = None
        self.render()
        self.stepped.emit()
        self.fitted_changed.emit()

    def render(self) -> None:
        """Show where one stands, finely; its metaball follows when nothing moves."""
        ready, step = self._ready, self.step
        if ready is None or step is None:
            return
        self.live.ask(lambda: (ready.at_rest.make(step.shape), step.held), (ready, step))
        self._rest.start()

    def _arrived(self, token: tuple[_Ready, Step | None], found: tuple[ShapedGrain, bool]) -> None:
        ready, step = token
        if ready is not self._ready:
            return
        self.grain, self.is_held = found
        if step is not None:
            self.at_rest = self.grain
        self.grain_changed.emit()

    def _fit(self) -> None:
        ready, step = self._ready, self.step
        if ready is None or step is None:
            return

        def work() -> SurfaceAvatar:
            return ready.at_rest.fit(ready.at_rest.make(step.shape, hull=False))

        self.balls.ask(work, (ready, step))

    def _ball_arrived(self, token: tuple[_Ready, Step | None], found: SurfaceAvatar) -> None:
        if token[0] is self._ready and token[1] is self.step:
            self.fitted = found
            self.fitted_changed.emit()

    def _failed(self, token: tuple[_Ready, Step | None], error: Exception) -> None:
        if token[0] is not self._ready:
            return
        if not isinstance(error, MbstudioError):
            log.error("A shaped grain could not be shown", exc_info=error)
        self.said.emit("error", str(error))

    # ---- keeping ---------------------------------------------------------------------------------

    def keep(self) -> Task | None:
        """Put the grain where one stands among the clones, measured and with its metaball."""
        ready, step, clones = self._ready, self.step, self.workspace.state.surface_clones
        if ready is None or step is None:
            return None

        def work(control: Control) -> SurfaceGeneration:
            from mbstudio.core.cloning.kept_shapes import keep_shape

            return keep_shape(ready.at_rest, ready.at_rest.make(step.shape, hull=False), clones)

        def done(found: SurfaceGeneration) -> None:
            if ready is self._ready and self.workspace.state.surface_clones is clones:
                self.workspace.use_surface_clones(found, tr("Keep {grain}", grain=found.names[-1]))
                told = tr("Kept {grain} among the clones, with its metaball.", grain=found.names[-1])
                self.said.emit("success", told)

        task = Task(tr("Keeping the grain"), work)
        task.succeeded.connect(done)
        return self.queue.submit(task)

    def close(self) -> None:
        """End the threads."""
        self._rest.stop()
        for worker in (self.live, self.balls):
            if not worker.close():
                log.warning("The thread of the %s did not end in time.", worker)


def _made_ready(style: SurfaceStyle, control: Control) -> _Ready:
    at_rest, moving = SurfaceStudio(style), SurfaceStudio(style, MOVING_FACES)
    count = len(style.parents)
    rows = set(np.linspace(0, count - 1, _MEASURED).round().astype(int).tolist())
    plain, rough = [], []
    for row, parent in enumerate(style.parents):
        control.progress(row / count, parent.name)
        # Of the stand-ins, but for the first, which is under the hand at once.
        plain.append(plain_factors(surface_of_parent(coarser(parent, MOVING_FACES))))
        if row in rows:
            rough.append(moving.make(moving.begin(row), hull=False).values["roughness"])
    at_rest.make(at_rest.begin(0))
    known = np.stack(plain)
    columns = [*known.T, np.array(rough)]
    ranges = {name: _range_of(name, column) for name, column in zip(SHAPE_FACTORS, columns, strict=True)}
    return _Ready(style, at_rest, moving, ranges, known)


def _range_of(name: str, values: Float64[np.ndarray, " parents"]) -> tuple[float, float, float]:
    low, high = float(values.min()), float(values.max())
    more = _WIDER * max(high - low, 0.1 * abs(high))
    least = 0.15 if name in ("elongation", "flatness", "csf") else 0.02 * low
    most = np.inf if name in ("size", "roughness") else 1.0
    return max(low - more, least), float(np.median(values)), min(high + more, most)
