"""Fitting one grain, step by step before the eyes, or many in the background."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from PySide6.QtCore import QObject, Signal

from mbstudio.core.batch.many_fits import fit_many
from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain, GrainSet
from mbstudio.core.imaging import FitResult, start_fit
from mbstudio.core.imaging.steps import FitRun, SearchStep
from mbstudio.core.metrics import factor_intervals
from mbstudio.scene.surfaces import avatar_surface, control_points
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.fit.words import (
    describe_fit,
    describe_fits,
    progress_of_goal_step,
    progress_of_step,
)
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.view.live_avatar import LiveAvatar
from mbstudio.ui.workers import Control, Report, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

LIVE_CELLS = 36  # of the avatar's surface while the search runs
KEPT_EVERY = 10.0  # seconds; what a search has found until then outlives a crash
SPHERE, SPHERES = 0.05, 1.0  # seconds that each sphere of the clustering is shown, and all at most


@dataclass(eq=False)
class _Fitting:
    """The fit of one grain, which can go on after it has ended."""

    label: int
    grain: Grain
    grains: GrainSet
    n: int
    target: str = ""
    run: FitRun | None = None
    stop: bool = False
    refusal: str = ""  # why the last change of n was not made; told from the main thread
    made: int = 0  # generations of the search so far
    changes: list[tuple[int, int]] = field(default_factory=list)  # before which generation n became what
    latest: FitResult | None = None  # what a crash would leave of it
    announced: FitResult | None = None

    def note_change(self, n: int) -> None:
        """Take note that the next generation has another number of control points."""
        self.n = n
        self.changes = [change for change in self.changes if change[0] != self.made] + [(self.made, n)]


@dataclass(frozen=True, eq=False)
class _Finished:
    result: FitResult


class FitWork(Work):
    """Runs fits.

    Attributes
    ----------
    run : Run
        The fit of a single grain.
    all_run : Run
        The fits of many.
    began : signal (int)
        The fit of a grain begins anew: its curve is empty.
    losses_arrived : signal (int, list)
        Label, and the losses of the newest generations.
    avatar_moved : signal (int, LiveAvatar)
        The avatar as it stands.
    changed : signal
        Something runs, pauses or has ended.
    arrived : signal
        One of many grains was fitted, or a long search has come further; the project gets them at the end.
    shows_spheres : bool
        Whether the clustering, which is done in a blink, waits for the eye.
    """

    began = Signal(int)
    losses_arrived = Signal(int, object)
    avatar_moved = Signal(int, object)
    changed = Signal()
    arrived = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self._fitting: _Fitting | None = None
        self.run, self.all_run = Run(queue, self), Run(queue, self)
        for run in (self.run, self.all_run):
            run.changed.connect(self.changed)
        self._arrived: tuple[GrainSet | None, list[Any]] = (None, [])
        self.shows_spheres = True
        workspace.grains_changed.connect(self._grains_changed)
        workspace.project_replaced.connect(self._forget)

    # ---- what runs -----------------------------------------------------------------------------

    @property
    def running_label(self) -> int | None:
        """Label of the grain that is being fitted."""
        return self._fitting.label if self._fitting is not None and self.run.is_running else None

    def changes_of(self, label: int | None) -> list[tuple[int, int]]:
        """Return before which generations the number of control points was changed, and to what.

        That of the fit that was begun last; nothing is known of others.
        """
        fitting = self._fitting
        return list(fitting.changes) if fitting is not None and fitting.label == label else []

    def can_go_on(self, label: int | None) -> bool:
        """Return whether the fit of this grain ended and can take more generations."""
        fitting = self._fitting
        return (
            label is not None
            and fitting is not None
            and fitting.label == label
            and fitting.run is not None
            and not self.run.is_running
            and label in self.workspace.state.fits
        )

    # ---- one grain -----------------------------------------------------------------------------

    def fit(self, label: int) -> Task | None:
        """Fit one grain with the project's settings."""
        grains = self.workspace.state.grains
        if grains is None or self.run.is_running:
            return None
        settings = self.workspace.state.fit_settings
        fills = settings.options.get("cavities") != "keep"
        grain = grains.grain(label, fill_cavities=fills)
        fitting = _Fitting(label, grain, grains, settings.n, settings.target)
        self._fitting = fitting
        waits = self.shows_spheres and not settings.target
        project = self.workspace.project

        def steps(control: Control) -> Iterator[SearchStep | _Finished]:
            control.report(-1.0 if settings.target else 0.0, tr("Preparing the grain"))
            self.workspace.begin_journal(project)
            fitting.run = start_fit(
                fitting.grain, settings.n, settings.method, settings.seed, target=settings.target or None,
                **settings.options,
            )  # fmt: skip
            return _drive(fitting, min(SPHERE, SPHERES / settings.n) if waits else 0.0)

        self.began.emit(label)
        task = self._start(tr("Fitting grain {label}", label=label), steps, fitting)
        task.cancelled.connect(lambda: self._give_up(fitting))
        return task

    def go_on(self, generations: int, n: int) -> Task | None:
        """Let the last fit go on for more generations, with n control points."""
        fitting = self._fitting
        if fitting is None or fitting.run is None or self.run.is_running:
            return None
        run, fitting.stop = fitting.run, False

        def steps(control: Control) -> Iterator[SearchStep | _Finished]:
            if n != fitting.n and not fitting.target:
                run.change_control_points(n)
                fitting.note_change(n)
            run.more_generations(generations)
            return _drive(fitting)

        return self._start(tr("Fitting grain {label}", label=fitting.label), steps, fitting)

    def change_n(self, n: int) -> None:
        """Change the number of control points of the fit that runs, from its next step on."""
        fitting = self._fitting
        if fitting is None or n == fitting.n:
            return

        def change() -> None:
            if fitting.run is None:
                return
            try:
                fitting.run.change_control_points(n)
                fitting.target = ""
                fitting.note_change(n)
            except FitError as error:  # the fit that runs is not to be lost by it
                fitting.refusal = tr("{error} The fit goes on with n = {n}.", error=error, n=fitting.n)

        self.run.call_between_steps(change)

    def _start(self, title: str, steps: Any, fitting: _Fitting) -> Task:
        task = Task(
            title, steps, prepare=_prepare, fraction=_target_fraction if fitting.target else _fraction
        )
        task.reported.connect(lambda report: self._report(fitting, report))
        task.succeeded.connect(lambda last: self._keep_fits(fitting, last))
        task.ended.connect(self.arrived)

        def end_early() -> None:
            fitting.stop = True

        return self.run.start(task, end_early)

    def _give_up(self, fitting: _Fitting) -> None:
        """Let go of a cancelled fit: grain and distances are megabytes."""
        fitting.run = None
        self.changed.emit()

    def _report(self, fitting: _Fitting, report: Report) -> None:
        label = fitting.label
        if fitting.latest is not fitting.announced:
            fitting.announced = fitting.latest
            self.arrived.emit()
        if fitting.refusal:
            self.said.emit("warning", fitting.refusal)
            fitting.refusal = ""
        losses: list[float] = []
        for step in report.steps:
            if not isinstance(step, SearchStep):
                continue
            if step.phase != "search":
                continue
            if fitting.target and step.generation == 0:
                losses.clear()
                self.began.emit(label)  # the next number of a target's search has a curve of its own
            losses.append(step.loss)
        if losses:
            self.losses_arrived.emit(label, losses)
        if report.view is not None:
            self.avatar_moved.emit(label, report.view)

    def _keep_fits(self, fitting: _Fitting, last: object) -> None:
        if not isinstance(last, _Finished) or fitting is not self._fitting:
            return
        result = last.result
        self.workspace.add_fits({fitting.label: result}, tr("Fit grain {label}", label=fitting.label))
        verdict = result.verdict
        level = "success" if verdict.valid and not verdict.warnings else "warning"
        self.said.emit(level, " ".join((describe_fit(fitting.label, result), *verdict.warnings)))

    # ---- many grains ---------------------------------------------------------------------------

    @property
    def arrived_fits(self) -> dict[int, FitResult]:
        """Fits that are not yet in the project, by label: done in a run over many, or far in a long search.

        A search that is not over counts only for a grain that has no avatar.
        """
        state, fits, fitting = self.workspace.state, {}, self._fitting
        if self.run.is_running and fitting is not None and fitting.label not in state.fits:
            fits = {fitting.label: fitting.announced}
        grains, items = self._arrived
        fits |= {item.label: item.result for item in _same_grains(grains, state.grains, items)}
        return {label: fit for label, fit in fits.items() if fit is not None}

    def unfitted(self) -> list[int]:
        """Labels of the grains inside the scan that have no avatar yet, or have changed since."""
        state = self.workspace.state
        if state.grains is None:
            return []
        done = state.fits.keys() - state.changed_labels
        return [label for label in state.grains.interior_labels if label not in done]

    def fittable(self) -> list[int]:
        """Labels of the chosen grains that can be fitted: those that are not excluded."""
        grains = self.workspace.state.grains
        excluded = frozenset() if grains is None else grains.excluded_labels
        return sorted(self.workspace.chosen - excluded)

    @property
    def can_fit_chosen(self) -> bool:
        """Whether the chosen grains can be fitted now."""
        if len(self.workspace.chosen) > 1:
            return bool(self.fittable()) and not self.all_run.is_running
        return not self.run.is_running

    def words_of_fit(self) -> str:
        """Return what fitting the chosen grains is called now."""
        chosen, state = self.workspace.chosen, self.workspace.state
        if len(chosen) > 1:
            one, many = mark("Fit {count} chosen grain"), mark("Fit {count} chosen grains")
            return plural(len(self.fittable()), one, many)
        return tr("Fit grain again") if chosen and chosen <= state.fits.keys() else tr("Fit grain")

    def fit_all(self, labels: list[int] | None = None) -> Task | None:
        """Fit every grain inside the scan that has no avatar yet (or these), on all processors."""
        grains = self.workspace.state.grains
        wanted = self.unfitted() if labels is None else labels
        if grains is None or not wanted:
            return None
        settings, project = self.workspace.state.fit_settings, self.workspace.project
        arrived: list[Any] = []
        trouble: list[str] = []

        def keep(item: Any) -> None:
            if item.result is not None and (told := project.keep_finished({item.label: item.result}, grains)):
                trouble.append(told)

        def steps(control: Control) -> Iterator[tuple[int, Any]]:
            control.report(0.0, tr("Starting processes"))
            if told := self.workspace.begin_journal(project):
                trouble.append(told)
            items = fit_many(
                grains, wanted, n=settings.n, method=settings.method, seed=settings.seed,
                options=settings.options, target=settings.target or None,
            )  # fmt: skip
            return _count(items, arrived, keep)

        task = Task(
            plural(len(wanted), mark("Fitting {count} grain"), mark("Fitting {count} grains")),
            steps,
            fraction=lambda step: (
                step[0] / len(wanted),
                tr("{done} of {count} grains", done=step[0], count=len(wanted)),
            ),
        )
        self._arrived = (grains, arrived)
        task.reported.connect(lambda _: self._tell_arrived(trouble))
        # What has arrived is kept also when the rest is cancelled or fails.
        task.ended.connect(lambda: self._take_many(grains, arrived))
        return self.all_run.start(task)

    def _tell_arrived(self, trouble: list[str]) -> None:
        """Announce what has arrived; say once what keeps it from the disk."""
        if trouble and trouble[0]:
            told = tr(
                "{error} Avatars are kept in memory until it can be written: make room.", error=trouble[0]
            )
            self.said.emit("warning", told)
            trouble[0] = ""
        self.arrived.emit()

    def _take_many(self, grains: GrainSet, items: list[Any]) -> None:
        if self._arrived[1] is items:
            self._arrived = (None, [])
        given, items = len(items), _same_grains(grains, self.workspace.state.grains, items)
        if not items:
            return
        fits = {item.label: item.result for item in items if item.result is not None}
        if fits:
            title = plural(len(fits), mark("Fit {count} grain"), mark("Fit {count} grains"))
            self.workspace.add_fits(fits, title)
        failed = [item for item in items if item.result is None]
        level, told = describe_fits(fits, failed)
        if len(items) < given:
            level, lost = "warning", given - len(items)
            told += " " + plural(
                lost,
                mark("{count} avatar was discarded: its grain was corrected meanwhile."),
                mark("{count} avatars were discarded: their grains were corrected meanwhile."),
            )
        self.said.emit(level, told)

    def _grains_changed(self) -> None:
        """Give up the fit of a grain that is no longer what it was."""
        now, fitting = self.workspace.state.grains, self._fitting
        if fitting is not None and now is not None and now.shares_body(fitting.grains, fitting.label):
            return
        if self.run.is_running and fitting is not None and now is not None and now.edits:
            told = tr("The fit of grain {label} was given up: the grain was corrected.", label=fitting.label)
            self.said.emit("warning", told)
        self._forget()

    def _forget(self) -> None:
        self.run.cancel()
        self._fitting = None
        self.changed.emit()


def _same_grains(grains: GrainSet | None, now: GrainSet | None, items: list[Any]) -> list[Any]:
    """Return what came of those grains that are still what they were."""
    if grains is None or now is None:
        return []
    return items if grains is now else [item for item in items if now.shares_body(grains, item.label)]


def _drive(fitting: _Fitting, sphere: float = 0.0) -> Iterator[SearchStep | _Finished]:
    """Yield the steps, each sphere of the clustering no sooner than `sphere` seconds after the one before."""
    assert fitting.run is not None
    begun, last = False, time.monotonic()
    kept = last
    for step in fitting.run:
        if step.phase == "clustering":
            time.sleep(max(0.0, last + sphere - time.monotonic()))
            last = time.monotonic()
        elif time.monotonic() - kept > KEPT_EVERY:
            fitting.latest, kept = fitting.run.result(), time.monotonic()
        if step.phase == "search":
            if fitting.target and step.generation == 0:
                fitting.made, fitting.changes = 0, []
            fitting.made += 1
        yield step
        begun = begun or step.phase == "search"
        if fitting.stop and begun:
            break
    yield _Finished(fitting.run.result())


def _count(
    items: Iterator[Any], arrived: list[Any], keep: Callable[[Any], object]
) -> Iterator[tuple[int, Any]]:
    """Number the items, keep each, and close the processes when this is closed."""
    try:
        for item in items:
            keep(item)
            arrived.append(item)
            yield len(arrived), item
    finally:
        close = getattr(items, "close", None)
        if close is not None:
            close()


def _prepare(step: SearchStep | _Finished) -> LiveAvatar | None:
    if isinstance(step, _Finished):
        return LiveAvatar(avatar_surface(step.result.avatar, 64), control_points(step.result.avatar))
    return LiveAvatar(avatar_surface(step.avatar, LIVE_CELLS), control_points(step.avatar))


def _fraction(step: SearchStep | _Finished) -> tuple[float, str]:
    return (1.0, tr("Done")) if isinstance(step, _Finished) else progress_of_step(step)


def _target_fraction(step: SearchStep | _Finished) -> tuple[float, str]:
    return (1.0, tr("Done")) if isinstance(step, _Finished) else progress_of_goal_step(step)


class IntervalWork(Work):
    """Measures a grain again at other places on the voxels, thresholds and blurs.

    Attributes
    ----------
    found : signal (int, FactorIntervals)
        Label of the grain, and its intervals.
    """

    found = Signal(int, object)

    def find(self, label: int) -> Task | None:
        """Find the intervals of this grain; None if there are no grains."""
        grains = self.workspace.state.grains
        if grains is None:
            return None
        task = Task(
            tr("Finding the intervals of grain {label}", label=label),
            lambda control: factor_intervals(grains.grain(label)),
        )
        task.succeeded.connect(lambda intervals: self.found.emit(label, intervals))
        return self.queue.submit(task)
