"""A dock of the window: what it holds, where it stands, when it is to be seen."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDockWidget, QFrame, QHBoxLayout, QToolButton, QWidget

from mbstudio.ui.commands import Command
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label

AREAS = {
    "left": Qt.DockWidgetArea.LeftDockWidgetArea,
    "right": Qt.DockWidgetArea.RightDockWidgetArea,
    "bottom": Qt.DockWidgetArea.BottomDockWidgetArea,
}


class DockFrame(QDockWidget):
    """Made by the part of the program that fills it; the shell gives it its place.

    Parameters
    ----------
    name : str
        Stable: saved layouts speak of it.
    title : str
    content : QWidget
    area : {'left', 'right', 'bottom'}
    icons : Icons, optional
        For the button that hides it; without them it has no title bar.
    is_wanted : callable
        Whether it is to be seen where its station is open.
    first_width : callable, optional
        Width at first, in pixels, of the window's width.
    first_height : int, optional
        Height at first, in pixels.
    height : int, optional
        Height in pixels, whenever its station is entered.
    share : int, optional
        Of the width, beside the others of its area that have one.
    """

    def __init__(
        self,
        name: str,
        title: str,
        content: QWidget,
        area: str,
        icons: Icons | None = None,
        *,
        is_wanted: Callable[[], bool] = lambda: True,
        first_width: Callable[[int], int] | None = None,
        first_height: int | None = None,
        height: int | None = None,
        share: int | None = None,
    ) -> None:
        super().__init__(title)
        self.setObjectName(name)
        self.setWidget(content)
        self.area = AREAS[area]
        self.is_wanted, self.share = is_wanted, share
        self.first_width, self.first_height, self.usual_height = first_width, first_height, height
        # Never floating: what is undocked gets lost behind the window.
        self.setFeatures(QDockWidget.DockWidgetFeature.DockWidgetClosable)
        self.close_button: QToolButton | None = None
        self.setTitleBarWidget(QWidget() if icons is None else self._title_bar(icons))

    @property
    def name(self) -> str:
        """By which saved layouts and commands know it."""
        return self.objectName()

    def command(
        self,
        title: str,
        tip: str,
        *,
        shortcut: str = "",
        icon: str = "",
        enabled: Callable[[], bool] = lambda: True,
        show: Callable[[bool], object] | None = None,
        menu: str = "View",
        separated: bool = False,
    ) -> Command:
        """Return the command that shows and hides it."""
        return Command(
            id=f"panel.{self.name}",
            title=title,
            run=show or self.setVisible,
            menu=menu,
            shortcut=shortcut,
            icon=icon,
            tip=tip,
            enabled=enabled,
            checked=lambda: not self.isHidden(),
            separated=separated,
        )

    def _title_bar(self, icons: Icons) -> QWidget:
        bar = QFrame()
        bar.setObjectName("dock")
        layout = QHBoxLayout(bar)
        layout.setContentsMargins(14, 5, 8, 3)
        layout.addWidget(label(self.windowTitle(), "heading"), 1)
        self.close_button = QToolButton()
        icons.set(self.close_button, "ph.x")
        self.close_button.setToolTip(
            tr("Hide (show “{panel}” again from menu View)", panel=self.windowTitle())
        )
        self.close_button.setAccessibleName(tr("Hide {panel}", panel=self.windowTitle()))
        self.close_button.clicked.connect(self.hide)
        layout.addWidget(self.close_button)
        return bar
