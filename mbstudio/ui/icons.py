"""Icons from qtawesome's Phosphor set, repainted when the theme changes."""

from __future__ import annotations

import weakref
from typing import Protocol

import qtawesome
from PySide6.QtCore import QObject, QSize
from PySide6.QtGui import QIcon, QPixmap

from mbstudio.core.assets import asset
from mbstudio.ui.theme import Theme


class HasIcon(Protocol):
    """An action, button or tab that shows an icon."""

    def setIcon(self, icon: QIcon) -> None: ...


class Icons(QObject):
    """Gives icons in the colours of the theme and keeps them so.

    Parameters
    ----------
    theme : Theme
    """

    def __init__(self, theme: Theme, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self._targets: weakref.WeakKeyDictionary[HasIcon, tuple[str, str]] = weakref.WeakKeyDictionary()
        theme.changed.connect(self._repaint)

    def get(self, name: str, colour: str = "muted") -> QIcon:
        """Return an icon (``ph.cube``) in one of the theme's colours."""
        tokens = self._theme.tokens
        return qtawesome.icon(
            name, color=getattr(tokens, colour), color_disabled=tokens.faint, color_on=tokens.accent
        )

    def pixmap(self, name: str, size: int, colour: str = "muted") -> QPixmap:
        """Return an icon as a picture of `size` pixels at scale 1."""
        return self.get(name, colour).pixmap(QSize(size, size))

    def set(self, target: HasIcon, name: str, colour: str = "muted") -> None:
        """Give a target an icon, now and after every change of theme."""
        self._targets[target] = (name, colour)
        target.setIcon(self.get(name, colour))

    def _repaint(self) -> None:
        for target, (name, colour) in list(self._targets.items()):
            target.setIcon(self.get(name, colour))


def application_icon() -> QIcon:
    """Return the program's own icon."""
    return QIcon(str(asset("mbstudio.svg")))
