"""Measuring the project's grains and avatars as populations, and writing about them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.metrics.measuring import AxisConvention
from mbstudio.core.populations import LaboratoryCurve, Population, border_weights
from mbstudio.core.populations.measuring import (
    FEWEST_FOR_PROCESSES,
    Conventions,
    Known,
    measured_so_far,
    unknown_bodies,
)
from mbstudio.core.populations.sieving import SieveSeries
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.measuring import ProjectPopulations, bodies_of, measure_project
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.offers import Offers
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Report, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

Scope = Literal["fitted", "inside", "chosen"]
AT_ONCE = 1.0
"""Seconds that measuring may take to begin without being asked for."""
EACH, DETAIL = 0.45, 5.0
"""Seconds of one core for a body before one was timed, and how many times as long its details take."""
_STARTING = 1.5  # seconds until processes work
_FRESH = 1.5
"""Seconds between two looks at what was measured by now."""
KEPT = 4  # measured populations: as many as undo and another convention bring back soon


@dataclass(frozen=True)
class MeasureRequest:
    """What is to be measured, and how.

    Attributes
    ----------
    scope : {'fitted', 'inside', 'chosen'}
        Grains that have an avatar (all inside the scan if none has one), all inside the scan, or some.
    axes : {'obb', 'feret', 'inertia'}
    detail : bool
    chosen : tuple of int
        Labels of some grains; those that are not excluded.
    """

    scope: Scope = "fitted"
    axes: AxisConvention = "obb"
    detail: bool = False
    chosen: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Measured:
    """Populations of a state of the project."""

    asked: MeasureRequest
    state: ProjectState
    found: ProjectPopulations

    @property
    def populations(self) -> list[Population]:
        """Those of which something could be measured."""
        given = (self.found.grains, self.found.avatars)
        return [population for population in given if population is not None and population.measured.any()]


@dataclass(frozen=True, eq=False)
class Growing:
    """What of a state of the project was measured by now: for the eye, not for others to build on."""

    asked: MeasureRequest
    state: ProjectState
    populations: list[Population]


class PopulationWork(Work):
    """Measures populations, and keeps what was measured until the project changes.

    Attributes
    ----------
    run : Run
    asked : MeasureRequest
        What :meth:`measure` measures.
    measured : Measured or None
        What was measured last, of the grains that the project still has.
    growing : Growing or None
        What was measured by now of a population that is not whole yet.
    changed : signal
        Something was measured, given up, or is out of date.
    grown : signal
        More bodies of a population that is not whole yet were measured.
    """

    changed = Signal()
    grown = Signal()

    def __init__(
        self, workspace: Workspace, queue: TaskQueue, offers: Offers, parent: QObject | None = None
    ) -> None:
        super().__init__(workspace, queue, parent)
        self._offers = offers
        self.run = Run(queue, self)
        self.run.changed.connect(self.changed)
        self.asked = MeasureRequest()
        self.measured: Measured | None = None
        self.growing: Growing | None = None
        self._kept: list[Measured] = []
        self._each = EACH
        self._left: tuple[tuple[object, ...], tuple[int, int]] | None = None
        workspace.grains_changed.connect(self._grains_changed)
        workspace.fits_changed.connect(self._look_up)
        workspace.selection_changed.connect(self._selection_changed)
        workspace.project_replaced.connect(offers.known.clear)
        offers.compared_changed.connect(self.changed)
        self.changed.connect(lambda: offers.offer_populations(self.populations))

    # ---- what there is -------------------------------------------------------------------------

    @property
    def is_current(self) -> bool:
        """Whether what was measured is of the project as it stands, and as asked."""
        return self.measured is not None and self._fits_now(self.measured)

    @property
    def populations(self) -> list[Population]:
        """All populations that can be shown, the reference first."""
        own = [] if self.measured is None else self.measured.populations
        return [*own, *self._offers.compared]

    @property
    def is_growing(self) -> bool:
        """Whether `shown` holds a part of the bodies, and the rest is still to be measured."""
        return self.growing is not None and not self.is_current and self._fits_now(self.growing)

    @property
    def shown(self) -> list[Population]:
        """What plots and tables show: `populations`, or what was measured by now where they are not whole."""
        if self.growing is not None and self.is_growing:
            return [*self.growing.populations, *self._offers.compared]
        return self.populations

    @property
    def wanted(self) -> MeasureRequest:
        """What measuring now would measure.

        While one looks at some of the grains that were chosen and measured, these stay what is wanted.
        """
        if self.asked.scope != "chosen" or self.workspace.state.grains is None:
            return self.asked
        now, measured = self.workspace.chosen - self.workspace.state.grains.excluded_labels, self.measured
        if measured is not None and measured.asked.scope == "chosen" and now <= set(measured.asked.chosen):
            return replace(self.asked, chosen=measured.asked.chosen)
        return replace(self.asked, chosen=tuple(sorted(now)))

    @property
    def has_bodies(self) -> bool:
        """Whether there is something to measure as asked."""
        if self.workspace.state.grains is None:
            return False
        return self.asked.scope != "chosen" or bool(self.wanted.chosen)

    def ask(self, **changes: Any) -> None:
        """Change what is to be measured."""
        self.asked = MeasureRequest(**{**vars(self.asked), **changes})
        self._look_up()

    @property
    def bodies_left(self) -> tuple[int, int]:
        """How many bodies are still to be measured as asked, and of how many."""
        state, asked = self.workspace.state, self.wanted
        key = (state.grains, state.fits, asked, len(self._offers.known))
        if self._left is None or self._left[0] != key:
            self._left = key, self._count_left(state, asked)
        return self._left[1]

    def _count_left(self, state: ProjectState, asked: MeasureRequest) -> tuple[int, int]:
        if not self.has_bodies:
            return 0, 0
        groups = bodies_of(Project(state), _labels(state, asked))
        unit = None if state.grains is None else state.grains.unit
        conventions = Conventions(unit, asked.axes, None, asked.detail)
        left = unknown_bodies(groups, conventions, self._offers.known)
        return left, sum(len(group.makers) for group in groups)

    def seconds_for(self, bodies: int) -> float:
        """Return about how long measuring so many bodies takes, by what it took before."""
        each = self._each * (DETAIL if self.asked.detail else 1.0)
        cores = usable_cores() if bodies >= FEWEST_FOR_PROCESSES else 1
        return each * bodies / cores + (_STARTING if cores > 1 else 0.0)

    # ---- measuring -----------------------------------------------------------------------------

    def measure_if_quick(self) -> None:
        """Measure what was not measured yet if that takes less than a second; else the person asks for it."""
        if self.measured is None and self.seconds_for(self.bodies_left[0]) <= AT_ONCE:
            self.measure()

    def measure(self) -> Task | None:
        """Measure as asked; None if there are no grains or it runs already."""
        state, asked, known = self.workspace.state, self.wanted, self._offers.known
        if not self.has_bodies or self.run.is_running:
            return None
        bodies = self.bodies_left[0]

        def work(control: Control) -> Measured:
            begun = time.monotonic()
            measured = _measure(state, asked, control, known)
            self._note_time(bodies, time.monotonic() - begun, asked.detail)
            return measured

        task = Task(tr("Measuring populations"), work)
        task.reported.connect(self._grow)
        task.succeeded.connect(self._keep_populations)
        return self.run.start(task)

    def _note_time(self, bodies: int, seconds: float, detail: bool) -> None:
        """Learn from what measuring took."""
        if bodies >= 4:
            cores = usable_cores() if bodies >= FEWEST_FOR_PROCESSES else 1
            worked = max(0.1, seconds - (_STARTING if cores > 1 else 0.0))
            self._each = worked * cores / bodies / (DETAIL if detail else 1.0)

    def write_report(
        self,
        path: Path,
        sieves: SieveSeries = "iso",
        *,
        tables: Sequence[LaboratoryCurve] = (),
        border: bool = False,
    ) -> Task | None:
        """Write the report of ``mbstudio report``, measuring first where that is to be done."""
        state, asked = self.workspace.state, self.wanted
        if not self.has_bodies or self.run.is_running:
            return None
        current = self.measured if self.is_current else None
        known = self._offers.known
        name, given = self.workspace.project.path, list(tables)

        def work(control: Control) -> Measured:
            from mbstudio.core.populations.findings import find_sizes
            from mbstudio.scene.reports.population_report import write_report

            measured = current or _measure(state, asked, control, known, 0.6)
            begun, found = 0.0 if current else 0.6, measured.found.grains
            counts = None
            if border and state.grains is not None:
                counts = border_weights(state.grains, found.labels.tolist())
            findings = find_sizes(found, counts=counts, tables=given) if found.measured.any() else None
            write_report(
                path, Project(state, name), measured.found, sieves=sieves, findings=findings,
                progress=lambda share, told: control.progress(begun + (1 - begun) * share, told),
            )  # fmt: skip
            return measured

        task = Task(tr("Writing {name}", name=path.name), work)
        task.succeeded.connect(self._keep_populations)
        return self.run.start(task)

    def write_certificate(
        self, path: Path, *, tables: Sequence[LaboratoryCurve] = (), border: bool = False
    ) -> Task | None:
        """Write the certificate of the sample on one page; None before anything was measured as asked."""
        measured, state, given = self.measured, self.workspace.state, list(tables)
        if measured is None or not self.is_current or self.run.is_running:
            return None
        name, found = self.workspace.project.path, measured.found

        def work(_control: Control) -> Path:
            from mbstudio.core.populations.findings import find_sizes
            from mbstudio.scene.reports.certificate import write_certificate

            counts = None
            if border and state.grains is not None:
                counts = border_weights(state.grains, found.grains.labels.tolist())
            findings = find_sizes(found.grains, counts=counts, tables=given)
            return write_certificate(path, Project(state, name), found, findings)

        return self.run.start(Task(tr("Writing {name}", name=path.name), work))

    def _grow(self, report: Report) -> None:
        if isinstance(report.view, Growing):
            self.growing = report.view
            self.grown.emit()

    def _keep_populations(self, measured: Measured) -> None:
        self._kept = [measured, *(one for one in self._kept if one is not measured)][:KEPT]
        if measured.state.grains is self.workspace.state.grains:
            self.measured = measured
            failed = sum(len(p.failures) for p in (measured.found.grains, measured.found.avatars) if p)
            if failed:
                told = plural(
                    failed,
                    mark("{count} body could not be measured. The report gives the reason."),
                    mark("{count} bodies could not be measured. The report gives the reasons."),
                )
                self.said.emit("warning", told)

    def _grains_changed(self) -> None:
        self.run.cancel()
        self.measured = self.growing = None
        self._look_up()

    def _selection_changed(self) -> None:
        if self.asked.scope == "chosen":
            self._look_up()

    def _look_up(self) -> None:
        """Take what was measured of just this state before, if it was."""
        self.measured = next((one for one in self._kept if self._fits_now(one)), self.measured)
        self.changed.emit()

    def _fits_now(self, measured: Measured | Growing) -> bool:
        state = self.workspace.state
        same = measured.state.grains is state.grains and measured.state.fits is state.fits
        return same and measured.asked == self.wanted


def _labels(state: ProjectState, asked: MeasureRequest) -> list[int] | None:
    """Return the grains that are asked for; None for those with an avatar."""
    if asked.scope == "chosen":
        return list(asked.chosen)
    if asked.scope != "inside" or state.grains is None:
        return None
    labels: list[int] = (
        np.union1d(state.grains.interior_labels, list(state.included_fits)).astype(int).tolist()
    )
    return labels


def _measure(
    state: ProjectState, asked: MeasureRequest, control: Control, known: Known, share: float = 1.0
) -> Measured:
    # What compares distributions takes a second to load: here it does not halt the window.
    import scipy.stats  # noqa: F401

    labels = _labels(state, asked)
    groups = bodies_of(Project(state), labels)
    unit = None if state.grains is None else state.grains.unit
    looked = time.monotonic()

    def progress(done: float, told: str) -> None:
        nonlocal looked
        control.progress(share * done, told)
        if done < 1 and time.monotonic() - looked >= _FRESH:
            found = measured_so_far(groups, known, unit=unit, axes=asked.axes, detail=asked.detail)
            control.report(share * done, told, view=Growing(asked, state, found))
            looked = time.monotonic()

    found = measure_project(
        Project(state), labels, axes=asked.axes, detail=asked.detail, known=known, progress=progress
    )
    return Measured(asked, state, found)
