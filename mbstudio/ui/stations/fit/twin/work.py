"""Fitting all avatars together to the grey values, sweep by sweep."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int8
from PySide6.QtCore import QObject, Signal

from mbstudio.core.grains import GrainSet
from mbstudio.core.imaging import FitResult
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.core.twin.sweeps import TwinStep
from mbstudio.core.twin.twinning import TwinRun, start_twin
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Report, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

_STEPS_A_CONTRAST = 100.0  # of the residual map that is kept


@dataclass(frozen=True, eq=False)
class _Finished:
    """What a twin leaves."""

    twin: KeptTwin
    fits: Mapping[int, FitResult]
    residual: Int8[np.ndarray, "Z Y X"]


@dataclass(eq=False)
class _Twinning:
    """A twin that is being fitted."""

    grains: GrainSet
    run: TwinRun | None = None
    stop: bool = False


class TwinWork(Work):
    """Runs the twin.

    Attributes
    ----------
    run : Run
    misfits : list of float
        Misfit at the start and after each sweep (see `KeptTwin`): of the twin that runs, or of the project's.
    changed : signal
        It began, pauses, goes on or has ended.
    moved : signal
        Surfaces have moved: misfits and residuals are others.
    finished : signal
        The project has another twin.
    """

    changed = Signal()
    moved = Signal()
    finished = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self.run = Run(queue, self)
        self.run.changed.connect(self.changed)
        self.misfits: list[float] = []
        self._twinning: _Twinning | None = None
        self._residual: tuple[KeptTwin, Int8[np.ndarray, "Z Y X"]] | None = None
        self._had: KeptTwin | None = None
        workspace.grains_changed.connect(self._grains_changed)
        workspace.project_replaced.connect(self._forget)
        workspace.state_changed.connect(self._state_changed)

    @property
    def can_start(self) -> bool:
        """Whether there are grains of a scan, and nothing runs."""
        state = self.workspace.state
        grains = state.grains
        return (
            grains is not None
            and not grains.is_of_meshes
            and len(grains) > 0
            and state.scan is not None
            and not self.run.is_running
        )

    def start(self) -> Task | None:
        """Fit the twin with the project's settings, from the avatars that there are."""
        state, scan = self.workspace.state, self.workspace.scan
        grains = state.grains
        if grains is None or not self.can_start:
            return None
        settings, changed = state.fit_settings, state.changed_labels
        known = {label: fit for label, fit in state.fits.items() if label not in changed}
        twinning = self._twinning = _Twinning(grains)
        self.misfits, self._residual = [], None

        def steps(control: Control) -> Iterator[TwinStep | _Finished]:
            control.report(0.0, tr("Reading the scan"))
            twinning.run = start_twin(scan, grains, known, n=settings.n, seed=settings.seed)
            return _drive(twinning)

        task = Task(tr("Fitting the twin"), steps, fraction=_fraction)
        task.reported.connect(lambda report: self._report(twinning, report))
        task.succeeded.connect(lambda last: self._keep(twinning, last))
        task.cancelled.connect(lambda: self._give_up(twinning))
        task.failed.connect(lambda _: self._give_up(twinning))

        def end_early() -> None:
            twinning.stop = True

        self.run.start(task, end_early)
        self.moved.emit()
        return task

    def residual_slice(self, axis: int, index: int) -> Float32[np.ndarray, "h w"] | None:
        """Return scan less model in contrasts on a slice across an axis (0 for z, 1 y, 2 x).

        That of the twin that runs; else of the project's, if it was fitted in this session; else None.
        """
        running = self._twinning.run if self._twinning is not None and self.run.is_running else None
        if running is not None and running.sweeping is not None:
            return running.sweeping.residual_slice(axis, index)
        if self._residual is not None and self._residual[0] is self.workspace.state.twin:
            return np.take(self._residual[1], index, axis).astype(np.float32) / np.float32(_STEPS_A_CONTRAST)
        return None

    @property
    def has_residual(self) -> bool:
        """Whether there is a map of residuals."""
        return self.residual_slice(0, 0) is not None

    def _report(self, twinning: _Twinning, _report: Report) -> None:
        if twinning is not self._twinning or twinning.run is None or twinning.run.sweeping is None:
            return
        self.misfits = list(twinning.run.sweeping.misfits)
        self.moved.emit()

    def _keep(self, twinning: _Twinning, last: object) -> None:
        if not isinstance(last, _Finished) or twinning is not self._twinning:
            return
        self._twinning = None
        if twinning.grains is not self.workspace.state.grains:
            return
        self._residual = (last.twin, last.residual)
        self.misfits = list(last.twin.misfits)
        self.workspace.add_fits(last.fits, tr("Fit the twin"), last.twin)
        told = plural(len(last.twin.avatars), mark("Fitted {count} grain to the grey values"),
                      mark("Fitted {count} grains together to the grey values"))  # fmt: skip
        contacts = plural(len(last.twin.touching), mark("{count} contact"), mark("{count} contacts"))
        doubtful = sum(bool(fit.verdict.warnings) for fit in last.fits.values())
        words = f"{told}: {contacts}."
        if doubtful:
            words += " " + plural(
                doubtful,
                mark("{count} grain is doubtful: see its verdict."),
                mark("{count} grains are doubtful: see their verdicts."),
            )
        level = "warning" if doubtful or last.twin.notes else "success"
        self.said.emit(level, " ".join((words, *last.twin.notes)))
        self.finished.emit()
        self.moved.emit()

    def _give_up(self, twinning: _Twinning) -> None:
        """Let go of a twin that was cancelled: scan and model are hundreds of megabytes."""
        if twinning is self._twinning:
            self._twinning = None
            self._show_kept()

    def _show_kept(self) -> None:
        twin = self.workspace.state.twin
        self.misfits = [] if twin is None else list(twin.misfits)
        self.moved.emit()

    def _state_changed(self) -> None:
        twin = self.workspace.state.twin
        if twin is not self._had:
            self._had = twin
            if not self.run.is_running:
                self._show_kept()

    def _grains_changed(self) -> None:
        grains, twinning = self.workspace.state.grains, self._twinning
        if twinning is not None and self.run.is_running and grains is not twinning.grains:
            self.said.emit("warning", tr("The twin was given up: the grains are others now."))
            self.run.cancel()
        if self._had is not None and self.workspace.state.twin is None and grains is not None:
            self.said.emit(
                "info",
                tr("The contacts of the twin went: they were of the grains before. Undo brings them back."),
            )

    def _forget(self) -> None:
        self.run.cancel()
        self._twinning = self._residual = None
        self._show_kept()


def _drive(twinning: _Twinning) -> Iterator[TwinStep | _Finished]:
    assert twinning.run is not None
    run = twinning.run
    for step in run:
        yield step
        if twinning.stop and step.sweep > 0:
            break
    found = run.result()
    residual = np.clip(_STEPS_A_CONTRAST * found.residual_volume(), -127, 127).astype(np.int8)
    yield _Finished(found.kept(), found.fits(twinning.grains), residual)


def _fraction(step: TwinStep | _Finished) -> tuple[float, str]:
    if isinstance(step, _Finished):
        return 1.0, tr("Done")
    if step.sweep == 0:
        return step.done, tr("Fitting grains to their labels")
    told = tr(
        "Sweep {sweep} of {sweeps}, misfit {misfit:.2f} % of the contrast",
        sweep=step.sweep,
        sweeps=step.sweeps,
        misfit=100 * step.misfit,
    )
    return 0.99 * step.done, told
