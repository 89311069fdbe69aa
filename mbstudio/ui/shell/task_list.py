"""All tasks by name, each with its progress, pause and cancel; folds out above the status bar."""

from __future__ import annotations

from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QProgressBar, QToolButton, QVBoxLayout, QWidget

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import empty, label
from mbstudio.ui.widgets.numbers import readable_time
from mbstudio.ui.workers import Report, Task, TaskQueue

LANES = ("saving", "work", "preview", "looking")
"""Of the tasks that people know of; others build what is seen, and are over soon."""
_STEPS = 1000


def listed_tasks(queue: TaskQueue) -> list[Task]:
    """Return the tasks that run, then those that wait, in the order in which they begin."""
    running = [task for lane in LANES if (task := queue.running(lane)) is not None]
    return running + [task for lane in LANES for task in queue.waiting_tasks(lane)]


def told_progress(report: Report) -> str:
    """Return how far a task is and how long it still takes, in words."""
    parts = [f"{report.fraction:.0%}"] if report.fraction >= 0 else []
    if report.seconds_left is not None:
        parts.append(tr("{time} left", time=readable_time(report.seconds_left)))
    return " · ".join(parts)


class TaskRow(QWidget):
    """One task.

    Parameters
    ----------
    task : Task
    queue : TaskQueue
    icons : Icons
    """

    def __init__(self, task: Task, queue: TaskQueue, icons: Icons) -> None:
        super().__init__()
        self.task, self._queue, self._icons = task, queue, icons
        self.title, self._told = QLabel(task.title), label("", "hint")
        self.bar = QProgressBar()
        self.bar.setTextVisible(False)
        self.bar.setAccessibleName(tr("Progress of “{task}”", task=task.title))
        self.bar.setRange(0, 0 if task.state == "running" else _STEPS)
        self.pause, self.cancel = QToolButton(), QToolButton()
        icons.set(self.cancel, "ph.x")
        self.cancel.setToolTip(tr("Cancel"))
        self.cancel.setAccessibleName(tr("Cancel “{task}”", task=task.title))
        self.cancel.setEnabled(task.can_cancel)
        layout = QGridLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setHorizontalSpacing(8)
        layout.setVerticalSpacing(3)
        layout.addWidget(self.title, 0, 0)
        layout.addWidget(self._told, 0, 1, Qt.AlignmentFlag.AlignRight)
        layout.addWidget(self.bar, 1, 0, 1, 2)
        layout.addWidget(self.pause, 0, 2, 2, 1)
        layout.addWidget(self.cancel, 0, 3, 2, 1)
        layout.setColumnStretch(0, 1)
        self.pause.clicked.connect(self._toggle_pause)
        self.cancel.clicked.connect(self._cancel)
        task.reported.connect(self._report)
        if task.newest is not None:
            self._report(task.newest)
        self.refresh()

    def refresh(self) -> None:
        """Show whether it runs, waits or is paused."""
        task = self.task
        self.pause.setEnabled(task.can_pause and task.state == "running")
        self._icons.set(self.pause, "ph.play" if task.is_paused else "ph.pause")
        self.pause.setToolTip(tr("Resume") if task.is_paused else tr("Pause"))
        self.pause.setAccessibleName(
            tr("Resume “{task}”", task=task.title)
            if task.is_paused
            else tr("Pause “{task}”", task=task.title)
        )
        if task.is_paused:
            self._told.setText(tr("Paused"))
        elif task.state == "waiting":
            self._told.setText(tr("Waiting"))
        elif task.newest is None:
            self._told.setText("")
            self.bar.setRange(0, 0)

    def _report(self, report: Report) -> None:
        if report.fraction >= 0:
            self.bar.setRange(0, _STEPS)
            self.bar.setValue(round(_STEPS * report.fraction))
        self._told.setText(told_progress(report))
        self.title.setToolTip(report.message)

    def _toggle_pause(self) -> None:
        self.task.pause_or_resume()
        self._queue.changed.emit()

    def _cancel(self) -> None:
        self.task.cancel()
        self._queue.changed.emit()


class TaskList(QFrame):
    """What runs and what waits.

    Parameters
    ----------
    queue : TaskQueue
    icons : Icons
    parent : QWidget
        It folds out above this one.
    """

    def __init__(self, queue: TaskQueue, icons: Icons, parent: QWidget) -> None:
        super().__init__(parent, Qt.WindowType.Popup)
        self.setObjectName("taskList")
        self.setAccessibleName(tr("All tasks"))
        self.setFixedWidth(420)
        self._queue, self._icons, self._owner = queue, icons, parent
        self.rows: list[TaskRow] = []
        self._inside = QVBoxLayout(self)
        self._inside.setContentsMargins(16, 14, 14, 14)
        self._inside.setSpacing(12)
        queue.changed.connect(self._refresh)

    def fold_out(self) -> None:
        """Show the list above its owner."""
        self._fill()
        owner = self._owner
        place = owner.mapToGlobal(QPoint(owner.width() - self.width(), -self.height() - 4))
        self.move(place)
        self.show()

    def _refresh(self) -> None:
        if not self.isVisible():
            return
        if [row.task for row in self.rows] != listed_tasks(self._queue):
            bottom = self.geometry().bottom()
            self._fill()
            self.move(self.x(), bottom - self.height() + 1)
        for row in self.rows:
            row.refresh()

    def _fill(self) -> None:
        empty(self._inside)
        self.rows = [TaskRow(task, self._queue, self._icons) for task in listed_tasks(self._queue)]
        for row in self.rows:
            self._inside.addWidget(row)
        if not self.rows:
            self._inside.addWidget(label(tr("Nothing is being done."), "hint"))
        self._inside.activate()
        self.adjustSize()
