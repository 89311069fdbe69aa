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


class ViewBar(QToolBar):
    """The bar itself; where its layers have no room for their words they are icons alone.

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
        # Qt's own, where not even the icons have room; its arrow is lost in style sheets.
        more = self.findChild(QToolButton, "qt_toolbar_ext_button")
        if more is not None:
            icons.set(more, "ph.caret-right")
            more.setToolTip(tr("More"))
            more.setAccessibleName(tr("More"))

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
        self._write_words()

    def _write_words(self) -> None:
        """Name the layers if all that is offered has room then."""
        styles = Qt.ToolButtonStyle
        self._set_style(styles.ToolButtonTextBesideIcon)
        layout = self.layout()
        assert layout is not None
        layout.invalidate()
        if layout.sizeHint().width() > self.width():
            self._set_style(styles.ToolButtonIconOnly)

    def _set_style(self, style: Qt.ToolButtonStyle) -> None:
        for button in self._worded:
            button.setToolButtonStyle(style)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._write_words()
        super().resizeEvent(event)
