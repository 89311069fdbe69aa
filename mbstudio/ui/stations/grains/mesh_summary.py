"""Which files of many were left out and why, and what was mended in the others."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QDialog, QDialogButtonBox, QPlainTextEdit, QVBoxLayout, QWidget

from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.grains.mesh_work import OpenedMeshes
from mbstudio.ui.widgets.forms import label

_WINDOW_WORDS = (("pass cavities='keep' (--cavities keep) to keep", mark("choose “Keep as voids” to keep")),)
"""What the command line has an option for, and the window a choice in the dialog."""


class MeshSummary(QDialog):
    """The summary, as text that can be copied.

    Parameters
    ----------
    opened : OpenedMeshes
    """

    def __init__(self, opened: OpenedMeshes, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("Opened meshes"))
        self.resize(680, 420)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(22, 20, 22, 18)
        layout.setSpacing(10)
        layout.addWidget(label(tr("What to know about these files"), "title"))
        self.text = QPlainTextEdit()
        self.text.setReadOnly(True)
        self.text.setAccessibleName(tr("What to know about these files"))
        self.text.setPlainText(summary_of(opened))
        layout.addWidget(self.text, 1)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.button(QDialogButtonBox.StandardButton.Close).setText(tr("Close"))
        buttons.rejected.connect(self.reject)
        layout.addWidget(buttons)


def summary_of(opened: OpenedMeshes) -> str:
    """Return all that is to be told of files, one paragraph each, named without their folders."""
    parts = []
    if opened.left_out:
        told = [_named(path, reason) for path, reason in opened.left_out]
        parts.append("\n\n".join((tr("Left out ({count})", count=len(told)), *told)))
    if opened.notes:
        notes = [short_note(note, opened) for note in opened.notes]
        parts.append("\n\n".join((tr("Taken, with remarks ({count})", count=len(notes)), *notes)))
    return "\n\n\n".join(parts)


def _named(path: Path, reason: str) -> str:
    """Return why a file was left out, beginning with its name."""
    told = reason.replace(str(path), path.name)
    return told if path.name in told else f"{path.name}: {told}"


def short_note(note: str, opened: OpenedMeshes) -> str:
    """Return a note with the names of its files instead of their whole paths, and in the window's words."""
    files = set() if opened.grains is None else {str(name) for name in opened.grains.table["file"]}
    for file in sorted(files, key=len, reverse=True):
        note = note.replace(file, Path(file).name)
    for option, words in _WINDOW_WORDS:
        note = note.replace(option, tr(words))
    return note
