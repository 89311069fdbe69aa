"""Sweeping the number of control points over some grains, a row at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from PySide6.QtCore import QObject, Signal

from mbstudio.core.imaging.steps import SearchStep
from mbstudio.core.imaging.sweep import Sweep, SweepRow, checked_numbers
from mbstudio.ui.language import tr
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Report, Task, TaskQueue
from mbstudio.ui.workspace import Workspace


class SweepWork(Work):
    """Runs sweeps with the project's method, seed and options.

    Attributes
    ----------
    run : Run
    rows : list of SweepRow
        Of the last sweep, as far as it has come; fits that stand here are not done again.
    rows_changed : signal
        More rows, or none any more.
    changed : signal
        A sweep began or ended.
    """

    rows_changed = Signal()
    changed = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self.rows: list[SweepRow] = []
        self._known: list[SweepRow] = []
        self.run = Run(queue, self)
        self.run.changed.connect(self.changed)
        workspace.grains_changed.connect(self._forget)

    def start(self, labels: Sequence[int], numbers: Sequence[int]) -> Task | None:
        """Fit these grains with each of these numbers.

        Raises
        ------
        FitError
            If a number is no number of control points, or there are none.
        """
        grains, settings = self.workspace.state.grains, self.workspace.state.fit_settings
        wanted = checked_numbers(numbers)
        if grains is None or self.run.is_running or not labels:
            return None
        chosen = [int(label) for label in labels]
        fills = settings.options.get("cavities") != "keep"
        found: list[SweepRow] = []
        known = list(self._known)

        def steps(control: Control) -> Iterator[SweepRow]:
            def step(_: SearchStep) -> None:
                control.checkpoint()  # pause and cancel also within a fit

            sweep = Sweep(
                (grains.grain(label, fill_cavities=fills) for label in chosen), wanted, settings.method,
                settings.seed, done=known, on_step=step, **settings.options,
            )  # fmt: skip
            for row in sweep:
                found[:] = sweep.rows
                yield row
            found[:] = sweep.rows

        def fraction(row: SweepRow) -> tuple[float, str]:
            done, fits = len(found), len(chosen) * len(wanted)
            told = tr(
                "Grain {label}, n = {n}: {done} of {fits} fits",
                label=row.label,
                n=row.n,
                done=done,
                fits=fits,
            )
            return done / fits, told

        title = (
            tr("Sweeping n of grain {label}", label=chosen[0])
            if len(chosen) == 1
            else tr("Sweeping n of {count} grains", count=len(chosen))
        )
        task = Task(title, steps, prepare=lambda _: tuple(found), fraction=fraction)
        task.reported.connect(self._report)
        task.ended.connect(lambda: self._keep_rows(grains, found))
        self.rows = []
        self.run.start(task)
        self.rows_changed.emit()
        return task

    def _report(self, report: Report) -> None:
        if report.view:
            self.rows = list(report.view)
            self.rows_changed.emit()

    def _keep_rows(self, grains: object, found: list[SweepRow]) -> None:
        if grains is not self.workspace.state.grains:
            return
        self.rows = list(found)
        fresh = {(row.label, row.n) for row in found}
        self._known = [row for row in self._known if (row.label, row.n) not in fresh] + self.rows
        self.rows_changed.emit()

    def _forget(self) -> None:
        self.run.cancel()
        self.rows, self._known = [], []
        self.rows_changed.emit()
        self.changed.emit()
