"""Choosing one of several arrays that a file holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QListWidget, QVBoxLayout, QWidget

from mbstudio.core.errors import SeveralArraysError
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label, primary_button


class ArrayDialog(QDialog):
    """Lists the arrays of a file.

    Parameters
    ----------
    error : SeveralArraysError
        What the reader of the file said.

    Attributes
    ----------
    chosen : signal (Path)
        The file, with the array that is meant behind a colon.
    """

    chosen = Signal(object)

    def __init__(self, error: SeveralArraysError, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("Choose an array"))
        self.setMinimumWidth(430)
        self._path = error.path
        self.list = QListWidget()
        self.list.addItems(list(error.names))
        self.list.setCurrentRow(0)
        self.list.setAccessibleName(tr("Arrays of the file"))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(22, 20, 22, 18)
        layout.setSpacing(10)
        layout.addWidget(label(error.path.name, "title"))
        layout.addWidget(label(tr("It holds several arrays. Which one is meant?"), "subtitle", wrap=True))
        layout.addWidget(self.list)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.button(QDialogButtonBox.StandardButton.Cancel).setText(tr("Cancel"))
        self.open_button = primary_button(tr("Open"))
        buttons.addButton(self.open_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        layout.addWidget(buttons)
        self.list.itemDoubleClicked.connect(lambda _: self.accept())
        self.accepted.connect(lambda: self.chosen.emit(self.answer()))
        self.list.setFocus()

    def answer(self) -> Path:
        """Return the path of the array that is chosen."""
        return Path(f"{self._path}:{self.list.currentItem().text()}")


def ask_which_array(
    error: SeveralArraysError, then: Callable[[Path], object], parent: QWidget | None
) -> ArrayDialog:
    """Let the person choose an array, and go on with its path; without waiting."""
    dialog = ArrayDialog(error, parent)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    dialog.chosen.connect(then)
    dialog.open()
    return dialog
