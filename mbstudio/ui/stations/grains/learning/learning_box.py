"""What the panel shows of strokes and classifier: kinds to paint, the brush, how it stands."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QDoubleSpinBox, QGridLayout, QHBoxLayout, QToolButton, QVBoxLayout, QWidget

from mbstudio.core.grains.editing.stroke_voxels import LARGEST_RADIUS
from mbstudio.ui.commands import CommandTable
from mbstudio.ui.language import tr
from mbstudio.ui.stations.grains.learning.commands import STROKES
from mbstudio.ui.stations.grains.learning.slice_preview import KIND_COLOURS
from mbstudio.ui.stations.grains.learning.stroke_painting import StrokePainting
from mbstudio.ui.widgets.forms import label, quiet_button, row


class LearningBox(QWidget):
    """Buttons of the kinds of strokes, and what was learned.

    Parameters
    ----------
    painting : StrokePainting
    """

    def __init__(self, painting: StrokePainting) -> None:
        super().__init__()
        self._painting = painting
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(6)
        self._buttons = QGridLayout()
        self._buttons.setSpacing(4)
        layout.addWidget(label(tr("Paint a few strokes of each kind in the flat slices."), "hint", wrap=True))
        layout.addLayout(self._buttons)
        self.radius = QDoubleSpinBox()
        self.radius.setRange(0.5, min(50.0, LARGEST_RADIUS))
        self.radius.setSingleStep(0.5)
        self.radius.setDecimals(1)
        self.radius.setValue(painting.radius)
        self.radius.valueChanged.connect(painting.set_radius)
        layout.addWidget(row(tr("Radius of the brush"), self.radius, tr("Of the round brush"), tr("voxels")))
        self.told = label("", "hint", wrap=True)
        layout.addWidget(self.told)
        files = QHBoxLayout()
        self.load_button, self.save_button = (
            quiet_button(tr("Load classifier…")),
            quiet_button(tr("Save classifier…")),
        )
        files.addWidget(self.load_button)
        files.addWidget(self.save_button)
        files.addStretch(1)
        layout.addLayout(files)
        painting.changed.connect(self.refresh)
        self.refresh()

    def bind(self, commands: CommandTable) -> None:
        """Make a button for each kind."""
        names = dict(
            zip(
                STROKES, (tr("Grain"), tr("Void"), tr("Second mineral"), tr("Border"), tr("Take away")),
                strict=True,
            )
        )  # fmt: skip
        for place, (command, name) in enumerate(names.items()):
            button = QToolButton()
            button.setText(name)
            colour = KIND_COLOURS.get(command.removeprefix("grains.stroke_"))
            if colour is not None:
                swatch = QPixmap(12, 12)
                swatch.fill(QColor(*colour))
                button.setIcon(QIcon(swatch))
                button.setIconSize(QSize(12, 12))
                button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
            button.setAccessibleName(commands.action(command).text())
            commands.bind(button, command)
            self._buttons.addWidget(button, place // 2, place % 2)
        commands.bind(self.load_button, "grains.load_classifier")
        commands.bind(self.save_button, "grains.save_classifier")

    def refresh(self) -> None:
        """Say how it stands."""
        self.told.setText(self._painting.told)
        self.told.setVisible(bool(self._painting.told))
