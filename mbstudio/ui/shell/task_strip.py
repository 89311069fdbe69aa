"""The running task in the status bar: what, how far, how long still, pause and cancel."""

from __future__ import annotations

from PySide6.QtWidgets import QHBoxLayout, QLabel, QMenu, QProgressBar, QToolButton, QWidget

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.numbers import readable_time
from mbstudio.ui.workers import Report, Task, TaskQueue


class TaskStrip(QWidget):
    """Shows the task of the lane ``work``; hidden while there is none."""

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
        self._queued.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self._queued.setToolTip(tr("Waiting tasks; click one to remove it"))
        self._queued.setAccessibleName(tr("Waiting tasks"))
        self.waiting_menu = QMenu(self._queued)
        self.waiting_menu.aboutToShow.connect(self._list_waiting)
        self._queued.setMenu(self.waiting_menu)
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
        if task is self._queue.running():
            self._bar.setRange(0, 0)
            self._left.setText("")
            task.reported.connect(self._report)
            self._refresh()

    def _report(self, report: Report) -> None:
        if report.fraction >= 0:
            self._bar.setRange(0, 1000)
            self._bar.setValue(round(1000 * report.fraction))
        left = (
            tr("{time} left", time=readable_time(report.seconds_left))
            if report.seconds_left is not None
            else ""
        )
        percent = f"{report.fraction:.0%}" if report.fraction >= 0 else ""
        self._left.setText(" · ".join(part for part in (percent, left) if part))
        if report.message:
            self._bar.setToolTip(report.message)

    def _refresh(self) -> None:
        task = self._queue.running()
        self.setVisible(task is not None)
        if task is None:
            return
        waiting = self._queue.waiting()
        self._title.setText(tr("{title} (paused)", title=task.title) if task.is_paused else task.title)
        self._queued.setText(tr("+ {count} waiting", count=waiting))
        self._queued.setVisible(waiting > 0)
        self._pause.setVisible(task.can_pause)
        self._icons.set(self._pause, "ph.play" if task.is_paused else "ph.pause")
        self._pause.setToolTip(tr("Resume") if task.is_paused else tr("Pause"))
        self._pause.setAccessibleName(tr("Resume the task") if task.is_paused else tr("Pause the task"))

    def _list_waiting(self) -> None:
        self.waiting_menu.clear()
        for task in self._queue.waiting_tasks():
            action = self.waiting_menu.addAction(self._icons.get("ph.x"), task.title)
            action.triggered.connect(lambda _checked=False, chosen=task: self._take_out(chosen))

    def _take_out(self, task: Task) -> None:
        task.cancel()
        self._queue.changed.emit()

    def _toggle_pause(self) -> None:
        task = self._queue.running()
        if task is not None:
            task.pause_or_resume()
            self._queue.changed.emit()

    def _cancel_task(self) -> None:
        task = self._queue.running()
        if task is not None:
            task.cancel()
