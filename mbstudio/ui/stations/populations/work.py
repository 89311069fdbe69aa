"""Measuring the project's grains and avatars as populations, and writing about them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.metrics.measuring import AxisConvention
from mbstudio.core.populations import Population
from mbstudio.core.populations.sieving import SieveSeries
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.measuring import ProjectPopulations, measure_project
from mbstudio.ui.language import tr
from mbstudio.ui.offers import Offers
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

Scope = Literal["fitted", "inside"]
KEPT = 4  # measured populations: as many as undo and another convention bring back soon


@dataclass(frozen=True)
class MeasureRequest:
    """What is to be measured, and how.

    Attributes
    ----------
    scope : {'fitted', 'inside'}
        Grains that have an avatar (all inside the scan if none has one), or all inside the scan.
    axes : {'obb', 'feret', 'inertia'}
    detail : bool
    """

    scope: Scope = "fitted"
    axes: AxisConvention = "obb"
    detail: bool = False


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


class PopulationWork(Work):
    """Measures populations, and keeps what was measured until the project changes.

    Attributes
    ----------
    run : Run
    asked : MeasureRequest
        What :meth:`measure` measures.
    measured : Measured or None
        What was measured last, of the grains that the project still has.
    changed : signal
        Something was measured, given up, or is out of date.
    """

    changed = Signal()

    def __init__(
        self, workspace: Workspace, queue: TaskQueue, offers: Offers, parent: QObject | None = None
    ) -> None:
        super().__init__(workspace, queue, parent)
        self._offers = offers
        self.run = Run(queue, self)
        self.run.changed.connect(self.changed)
        self.asked = MeasureRequest()
        self.measured: Measured | None = None
        self._kept: list[Measured] = []
        workspace.grains_changed.connect(self._grains_changed)
        workspace.fits_changed.connect(self._look_up)
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

    def ask(self, **changes: Any) -> None:
        """Change what is to be measured."""
        self.asked = MeasureRequest(**{**vars(self.asked), **changes})
        self._look_up()

    # ---- measuring -----------------------------------------------------------------------------

    def measure(self) -> Task | None:
        """Measure as asked; None if there are no grains or it runs already."""
        state, asked = self.workspace.state, self.asked
        if state.grains is None or self.run.is_running:
            return None
        task = Task(tr("Measuring populations"), lambda control: _measure(state, asked, control))
        task.succeeded.connect(self._keep_populations)
        return self.run.start(task)

    def write_report(self, path: Path, sieves: SieveSeries = "iso") -> Task | None:
        """Write the report of ``mbstudio report``, measuring first where that is to be done."""
        state, asked = self.workspace.state, self.asked
        if state.grains is None or self.run.is_running:
            return None
        known = self.measured if self.is_current else None
        name = self.workspace.project.path

        def work(control: Control) -> Measured:
            from mbstudio.scene.reports.population_report import write_report

            measured = known or _measure(state, asked, control, 0.6)
            begun = 0.0 if known else 0.6
            write_report(
                path, Project(state, name), measured.found, sieves=sieves,
                progress=lambda share, told: control.progress(begun + (1 - begun) * share, told),
            )  # fmt: skip
            return measured

        task = Task(tr("Writing {name}", name=path.name), work)
        task.succeeded.connect(self._keep_populations)
        return self.run.start(task)

    def _keep_populations(self, measured: Measured) -> None:
        self._kept = [measured, *(one for one in self._kept if one is not measured)][:KEPT]
        if measured.state.grains is self.workspace.state.grains:
            self.measured = measured
            failed = sum(len(p.failures) for p in (measured.found.grains, measured.found.avatars) if p)
            if failed:
                told = tr(
                    "{failed} bodies could not be measured. The report gives the reasons.", failed=failed
                )
                self.said.emit("warning", told)

    def _grains_changed(self) -> None:
        self.run.cancel()
        self.measured = None
        self._look_up()

    def _look_up(self) -> None:
        """Take what was measured of just this state before, if it was."""
        self.measured = next((one for one in self._kept if self._fits_now(one)), self.measured)
        self.changed.emit()

    def _fits_now(self, measured: Measured) -> bool:
        state = self.workspace.state
        same = measured.state.grains is state.grains and measured.state.fits is state.fits
        return same and measured.asked == self.asked


def _measure(state: ProjectState, asked: MeasureRequest, control: Control, share: float = 1.0) -> Measured:
    # What compares distributions takes a second to load: here it does not halt the window.
    import scipy.stats  # noqa: F401

    labels = None
    if asked.scope == "inside" and state.grains is not None:
        labels = np.union1d(state.grains.interior_labels, sorted(state.fits)).astype(int).tolist()
    found = measure_project(
        Project(state), labels, axes=asked.axes, detail=asked.detail,
        progress=lambda done, told: control.progress(share * done, told),
    )  # fmt: skip
    return Measured(asked, state, found)
