"""The tools by which grains are corrected, and the brush, for the panel of the station."""

from __future__ import annotations

from PySide6.QtCore import QSize
from PySide6.QtWidgets import QCheckBox, QDoubleSpinBox, QHBoxLayout, QToolButton, QVBoxLayout, QWidget

from mbstudio.ui.commands import CommandTable
from mbstudio.ui.language import tr
from mbstudio.ui.stations.grains.editing.slice_editing import LARGEST_RADIUS, SliceEditing
from mbstudio.ui.widgets.forms import label, row

TOOLS = (
    "grains.split",
    "grains.split_line",
    "grains.new_grain",
    "grains.paint",
    "grains.erase",
    "grains.fill",
)
"""Commands that take a tool up, in the order of their buttons."""
_NO_LEVEL = -1e12


class ToolBox(QWidget):
    """Buttons of the tools, and the fields of the one in the hand.

    Parameters
    ----------
    tools : SliceEditing
    """

    def __init__(self, tools: SliceEditing) -> None:
        super().__init__()
        self._tools = tools
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 8, 0, 0)
        layout.setSpacing(6)
        layout.addWidget(label(tr("Correct by hand"), "heading"))
        self._buttons = QHBoxLayout()
        self._buttons.setSpacing(4)
        layout.addLayout(self._buttons)
        self.radius = QDoubleSpinBox()
        self.radius.setRange(0.5, LARGEST_RADIUS)
        self.radius.setSingleStep(0.5)
        self.radius.setDecimals(1)
        self._radius_row = row(
            tr("Radius of the brush"), self.radius, tr("[ and ] change it from the keyboard"), tr("voxels")
        )
        self.in_space = QCheckBox(tr("Paint in space (a ball)"))
        self.in_space.setToolTip(tr("The brush is a ball and not a disk in the slice"))
        self.level = QDoubleSpinBox()
        self.level.setRange(_NO_LEVEL, 1e12)
        self.level.setDecimals(1)
        self.level.setSpecialValueText(tr("automatic"))
        self._level_row = row(
            tr("Grey value"), self.level, tr("Where the new grain ends; [ and ] change it from the keyboard")
        )
        for field in (self._radius_row, self.in_space, self._level_row):
            layout.addWidget(field)
        self.radius.valueChanged.connect(tools.set_radius)
        self.in_space.toggled.connect(tools.set_in_space)
        self.level.valueChanged.connect(lambda level: tools.set_level(None if level == _NO_LEVEL else level))
        tools.changed.connect(self.refresh)
        self.refresh()

    def bind(self, commands: CommandTable) -> None:
        """Make a button for each tool."""
        for name in TOOLS:
            button = QToolButton()
            button.setDefaultAction(commands.action(name))
            button.setIconSize(QSize(20, 20))
            button.setAccessibleName(commands.action(name).text())
            self._buttons.addWidget(button)
        self._buttons.addStretch(1)

    def refresh(self) -> None:
        """Show the fields of the tool in the hand, as they are."""
        tools = self._tools
        brushes = tools.tool in ("paint", "erase")
        self._radius_row.setVisible(brushes)
        self.in_space.setVisible(brushes)
        self._level_row.setVisible(tools.tool == "new")
        for field, value in (
            (self.radius, tools.radius),
            (self.level, _NO_LEVEL if tools.level is None else tools.level),
        ):
            field.blockSignals(True)
            field.setValue(value)
            field.blockSignals(False)
        self.in_space.blockSignals(True)
        self.in_space.setChecked(tools.in_space)
        self.in_space.blockSignals(False)
