"""The running task in the status bar: what, how far, how long still, pause and cancel."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QToolButton, QWidget

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.shell.task_list import TaskList, told_progress
from mbstudio.ui.workers import Report, Task, TaskQueue


class TaskStrip(QWidget):
    """Shows the task of the lane ``work``, else the save that runs; hidden while there is neither.

    Attributes
    ----------
    tasks : TaskList
        Folds out by its button.
    """

    def __init__(self, queue: TaskQueue, icons: Icons) -> None:
        super().__init__()
        self._queue = queue
        self._icons = icons
        self._title = QLabel()
        self._bar = QProgressBar()
        self._bar.setTextVisible(False)
        self._bar.setFixedWidth(170)
        self._left = QLabel()
        self._queued = QToolButton()
        self._queued.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self._queued.setToolTip(tr("All tasks, each with pause and cancel"))
        self._queued.setAccessibleName(tr("All tasks"))
        icons.set(self._queued, "ph.caret-up")
        self.tasks = TaskList(queue, icons, self)
        self._queued.clicked.connect(self.tasks.fold_out)
        self._pause = QToolButton()
        self._cancel = QToolButton()
        icons.set(self._cancel, "ph.x")
        self._cancel.setToolTip(tr("Cancel"))
        self._cancel.setAccessibleName(tr("Cancel the running task"))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(6, 0, 6, 0)
        layout.setSpacing(6)
        for widget in (self._title, self._queued, self._bar, self._left, self._pause, self._cancel):
            layout.addWidget(widget)
        self._pause.clicked.connect(self._toggle_pause)
        self._cancel.clicked.connect(self._cancel_task)
        queue.started.connect(self._begin)
        queue.changed.connect(self._refresh)
        self.hide()

    def _begin(self, task: Task) -> None:
        if task is self._shown():
            self._bar.setRange(0, 0)
            self._left.setText("")
            task.reported.connect(lambda report: self._report(report) if task is self._shown() else None)
            self._refresh()

    def _shown(self) -> Task | None:
        return next(filter(None, map(self._queue.running, ("work", "saving", "looking"))), None)

    def _report(self, report: Report) -> None:
        if report.fraction >= 0:
            self._bar.setRange(0, 1000)
            self._bar.setValue(round(1000 * report.fraction))
        self._left.setText(told_progress(report))
        if report.message:
            self._bar.setToolTip(report.message)

    def _refresh(self) -> None:
        task = self._shown()
        self.setVisible(task is not None)
        if task is None:
            return
        waiting = self._queue.waiting()
        self._title.setText(tr("{title} (paused)", title=task.title) if task.is_paused else task.title)
        self._queued.setText(tr("+ {count} waiting", count=waiting) if waiting else "")
        self._cancel.setEnabled(task.can_cancel)
        self._pause.setVisible(task.can_pause)
        self._icons.set(self._pause, "ph.play" if task.is_paused else "ph.pause")
        self._pause.setToolTip(tr("Resume") if task.is_paused else tr("Pause"))
        self._pause.setAccessibleName(tr("Resume the task") if task.is_paused else tr("Pause the task"))

    def _toggle_pause(self) -> None:
        task = self._shown()
        if task is not None:
            task.pause_or_resume()
            self._queue.changed.emit()

    def _cancel_task(self) -> None:
        task = self._shown()
        if task is not None:
            task.cancel()
