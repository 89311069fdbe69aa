"""About: versions and graphics, to be copied into a report."""

from __future__ import annotations

import platform
from importlib.metadata import version

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QDialog, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

import mbstudio
from mbstudio.core.batch.processes import processors
from mbstudio.ui.icons import application_icon
from mbstudio.ui.language import tr
from mbstudio.ui.shell.memory import memory_used
from mbstudio.ui.viewport import Viewport
from mbstudio.ui.widgets.forms import label, primary_button

_LIBRARIES = ("PySide6-Essentials", "pyvista", "pyvistaqt", "vtk", "numpy", "numba", "torch")


def system_information(viewport: Viewport) -> str:
    """Return versions and graphics as lines of text."""
    lines = [
        f"MetaBall Studio {mbstudio.__version__}",
        f"Python {platform.python_version()}",
        platform.platform(),
    ]
    lines += [f"{name} {version(name)}" for name in _LIBRARIES]
    lines.append(
        tr("{count} processors, {memory:.0f} MB in use", count=processors(), memory=memory_used() / 2**20)
    )
    window = getattr(viewport.plotter, "render_window", None)
    shown = window.GetClassName() if window else tr("closed")
    lines.append(tr("3-D view: {kind}, {window}", kind=viewport.kind, window=shown))
    return "\n".join(lines)


class AboutBox(QDialog):
    """Name, versions and licence."""

    def __init__(self, viewport: Viewport, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(tr("About MetaBall Studio"))
        text = system_information(viewport)
        picture = QLabel()
        picture.setPixmap(application_icon().pixmap(72, 72))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(26, 24, 26, 20)
        layout.setSpacing(10)
        layout.addWidget(picture)
        layout.addWidget(label("MetaBall Studio", "title"))
        layout.addWidget(
            label(tr("CT scans of grains to metaball avatars for DEM. MIT licence."), "subtitle", wrap=True)
        )
        versions = label(text, "hint")
        versions.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        layout.addWidget(versions)
        copy = QPushButton(tr("Copy system information"))
        copy.setToolTip(tr("Versions, graphics, processors and memory, for a bug report"))
        copy.clicked.connect(lambda: QGuiApplication.clipboard().setText(text))
        close = primary_button(tr("Close"))
        close.clicked.connect(self.accept)
        line = QHBoxLayout()
        line.addStretch(1)
        line.addWidget(copy)
        line.addWidget(close)
        layout.addLayout(line)
