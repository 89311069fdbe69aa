"""Preferences: each takes effect at once; the dialog blocks nothing."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QCheckBox, QComboBox, QDialog, QHBoxLayout, QSpinBox, QVBoxLayout, QWidget

from mbstudio.core.batch.processes import limit_processes, process_limit, processors
from mbstudio.ui.language import tr
from mbstudio.ui.shell.autosave_work import LONGEST, SHORTEST, AutosaveWork
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label, primary_button, row
from mbstudio.ui.workspace import Workspace

PROCESSES = "work/processes"


class Preferences(QDialog):
    """Theme, processes, autosave, and what happens at the start.

    Parameters
    ----------
    theme : Theme
    workspace : Workspace
    autosaves : AutosaveWork
    parent : QWidget
    """

    def __init__(self, theme: Theme, workspace: Workspace, autosaves: AutosaveWork, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(tr("Preferences"))
        self.setModal(False)
        self._workspace = workspace
        self.theme = QComboBox()
        for words, choice in ((tr("As the system"), "system"), (tr("Light"), "light"), (tr("Dark"), "dark")):
            self.theme.addItem(words, choice)
        self.theme.setCurrentIndex(self.theme.findData(theme.choice))
        self.theme.currentIndexChanged.connect(lambda _: theme.choose(self.theme.currentData()))
        self.processes = QSpinBox()
        self.processes.setRange(0, max(processors(), process_limit() or 0))
        self.processes.setSpecialValueText(tr("all"))
        self.processes.setValue(process_limit() or 0)
        self.processes.valueChanged.connect(self._limit)
        self.seconds = QSpinBox()
        self.seconds.setRange(SHORTEST, LONGEST)
        self.seconds.setValue(autosaves.seconds)
        self.seconds.valueChanged.connect(autosaves.set_seconds)
        self.layout_kept = QCheckBox(tr("Remember panels and camera"))
        self.layout_kept.setChecked(is_on(workspace, "layout/kept"))
        self.layout_kept.toggled.connect(lambda on: workspace.settings.setValue("layout/kept", int(on)))
        self.layout_kept.setToolTip(
            tr("Sizes of panels, which are hidden at each station, and the camera position")
        )
        forget = QHBoxLayout()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(26, 22, 26, 18)
        layout.setSpacing(10)
        layout.addWidget(label(tr("Preferences"), "title"))
        layout.addWidget(label(tr("Changes take effect immediately."), "subtitle"))
        layout.addSpacing(4)
        layout.addWidget(row(tr("Theme"), self.theme, tr("Light, dark, or the same as the system")))
        layout.addWidget(
            row(
                tr("Processes"),
                self.processes,
                tr("How many processors fits and measurements use, of {count}", count=processors()),
            )
        )
        layout.addWidget(
            row(
                tr("Autosave every"),
                self.seconds,
                tr("How often unsaved changes are written to the recovery file"),
                "s",
            )
        )
        layout.addWidget(self.layout_kept)
        close = primary_button(tr("Close"))
        close.clicked.connect(self.close)
        forget.addStretch(1)
        forget.addWidget(close)
        layout.addSpacing(6)
        layout.addLayout(forget)
        self.setFixedWidth(400)

    def _limit(self, count: int) -> None:
        limit_processes(count or None)
        self._workspace.settings.setValue(PROCESSES, count)


def is_on(workspace: Workspace, name: str) -> bool:
    """Return whether a preference that is on by default is on."""
    return str(workspace.settings.value(name, 1)) in ("1", "true", "True")
