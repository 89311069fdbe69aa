"""What all stations' work has in common."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from mbstudio.ui.workers import TaskQueue
from mbstudio.ui.workspace import Workspace


class Work(QObject):
    """Starts tasks on the project and says what came of them.

    Attributes
    ----------
    said : signal (str, str)
        Level and text for the message bar.
    """

    said = Signal(str, str)

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.workspace = workspace
        self.queue = queue
