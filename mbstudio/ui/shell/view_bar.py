"""The bar above the view: files, undo, layers, camera and tools."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QAction, QResizeEvent
from PySide6.QtWidgets import QMenu, QToolBar, QToolButton

from mbstudio.scene import switched_layers
from mbstudio.ui.commands import CommandTable
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.view.tool_commands import TOOLS

ROOMY = 640  # pixels: wide enough for a bar with the names of its layers


class ViewBar(QToolBar):
    """The bar itself; where there is little room its layers are icons without words.

    Parameters
    ----------
    commands : CommandTable
    icons : Icons
    """

    def __init__(self, commands: CommandTable, icons: Icons) -> None:
        super().__init__(tr("View"))
        self._commands, self._icons = commands, icons
        self._worded: list[QToolButton] = []
        self._groups: list[tuple[tuple[QAction, ...], QAction]] = []
        self.setMovable(False)
        self.setIconSize(QSize(18, 18))
        self._add_group("scan.open", "project.save")
        self._add_group("edit.undo", "edit.redo")
        layers = tuple(f"layer.{layer}" for layer in switched_layers())
        self._add_group(*layers)
        for name in layers:
            button = self.widgetForAction(commands.action(name))
            assert isinstance(button, QToolButton)
            self._worded.append(button)
        self._add_group("view.fit", "view.screenshot")
        views = [command.id for command in commands if command.id.startswith("view.from_")]
        self._add_menu("ph.video-camera", tr("View from …"), tr("Camera presets"), views)
        self._add_menu("ph.ruler", tr("Measure, clip, compare …"), tr("Tools of the view"), list(TOOLS))

    def _add_group(self, *names: str) -> None:
        """Add buttons and a line after them, which is there as long as one of them is."""
        actions = tuple(self._commands.action(name) for name in names)
        self.addActions(actions)
        self._groups.append((actions, self.addSeparator()))
        for action in actions:
            action.changed.connect(self._show_lines)

    def _add_menu(self, icon: str, tip: str, name: str, commands: list[str]) -> None:
        button = QToolButton()
        self._icons.set(button, icon)
        button.setToolTip(tip)
        button.setAccessibleName(name)
        button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(button)
        for command in commands:
            menu.addAction(self._commands.action(command))
        button.setMenu(menu)
        self.addWidget(button)

    def _show_lines(self) -> None:
        for actions, line in self._groups:
            line.setVisible(any(action.isVisible() for action in actions))

    def resizeEvent(self, event: QResizeEvent) -> None:
        styles = Qt.ToolButtonStyle
        style = styles.ToolButtonTextBesideIcon if self.width() >= ROOMY else styles.ToolButtonIconOnly
        for button in self._worded:
            button.setToolButtonStyle(style)
        super().resizeEvent(event)
