"""Colours, spacing and type of the window, light and dark; follows the system unless told."""

from __future__ import annotations

import re
import sys
from dataclasses import asdict, dataclass
from typing import Literal

from PySide6.QtCore import QObject, QSettings, Qt, Signal
from PySide6.QtGui import QColor, QFont, QGuiApplication, QPalette
from PySide6.QtWidgets import QApplication

from mbstudio.core.assets import asset, assets_folder
from mbstudio.scene import DARK as SCENE_DARK
from mbstudio.scene import LIGHT as SCENE_LIGHT
from mbstudio.scene import SceneTheme

Choice = Literal["system", "light", "dark"]


@dataclass(frozen=True)
class Tokens:
    """The named colours of one theme, as ``#rrggbb``; the style sheet knows no others."""

    name: str
    window: str  # behind everything
    surface: str  # panels, cards
    raised: str  # fields, buttons, table rows that differ
    hover: str
    border: str
    strong_border: str
    text: str
    muted: str
    faint: str
    accent: str
    accent_hover: str
    accent_text: str
    accent_soft: str
    info: str
    info_soft: str
    success: str
    success_soft: str
    warning: str
    warning_soft: str
    danger: str
    danger_soft: str


LIGHT = Tokens(
    name="light",
    window="#eef1f5",
    surface="#ffffff",
    raised="#f6f8fa",
    hover="#e8edf2",
    border="#dde3ea",
    strong_border="#bcc7d2",
    text="#1b2631",
    muted="#556371",
    faint="#8a96a3",
    accent="#1b6ca8",
    accent_hover="#155a8d",
    accent_text="#ffffff",
    accent_soft="#e0eef8",
    info="#1b6ca8",
    info_soft="#e0eef8",
    success="#17724f",
    success_soft="#ddf2e8",
    warning="#7d5200",
    warning_soft="#fdf0d2",
    danger="#a8322a",
    danger_soft="#fbe5e2",
)
DARK = Tokens(
    name="dark",
    window="#12171c",
    surface="#1a2128",
    raised="#222b34",
    hover="#2b3641",
    border="#2d3843",
    strong_border="#465462",
    text="#e3e9ef",
    muted="#a0adb9",
    faint="#71808e",
    accent="#4fa6e2",
    accent_hover="#73baeb",
    accent_text="#07141f",
    accent_soft="#17344a",
    info="#73baeb",
    info_soft="#17344a",
    success="#63c99a",
    success_soft="#163b2c",
    warning="#e6b450",
    warning_soft="#3d3013",
    danger="#ef8b80",
    danger_soft="#472220",
)


def stylesheet(tokens: Tokens) -> str:
    """Return the window's style sheet with every ``@name`` replaced by its colour or folder."""
    names = {key: str(value) for key, value in asdict(tokens).items()}
    names["icons"] = (assets_folder() / "icons").as_posix()
    text = asset("theme.qss").read_text(encoding="utf-8")
    return re.sub(r"@(\w+)", lambda match: names[match[1]], text)


def palette(tokens: Tokens) -> QPalette:
    """Return Qt's palette of a theme, for what the style sheet does not paint."""
    roles = {
        QPalette.ColorRole.Window: tokens.window,
        QPalette.ColorRole.WindowText: tokens.text,
        QPalette.ColorRole.Base: tokens.surface,
        QPalette.ColorRole.AlternateBase: tokens.raised,
        QPalette.ColorRole.Text: tokens.text,
        QPalette.ColorRole.PlaceholderText: tokens.faint,
        QPalette.ColorRole.Button: tokens.raised,
        QPalette.ColorRole.ButtonText: tokens.text,
        QPalette.ColorRole.ToolTipBase: tokens.raised,
        QPalette.ColorRole.ToolTipText: tokens.text,
        QPalette.ColorRole.Highlight: tokens.accent,
        QPalette.ColorRole.HighlightedText: tokens.accent_text,
        QPalette.ColorRole.Link: tokens.accent,
        QPalette.ColorRole.Mid: tokens.border,
    }
    result = QPalette()
    for role, colour in roles.items():
        result.setColor(role, QColor(colour))
    for role in (QPalette.ColorRole.Text, QPalette.ColorRole.ButtonText, QPalette.ColorRole.WindowText):
        result.setColor(QPalette.ColorGroup.Disabled, role, QColor(tokens.faint))
    return result


class Theme(QObject):
    """The theme that holds now; whoever paints with its colours listens to `changed`.

    Parameters
    ----------
    settings : QSettings
        Keeps the person's choice.
    """

    changed = Signal()

    def __init__(self, settings: QSettings, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._settings = settings
        choice = str(settings.value("theme", "system"))
        self.choice: Choice = choice if choice in ("light", "dark") else "system"  # type: ignore[assignment]
        self.tokens = LIGHT
        QGuiApplication.styleHints().colorSchemeChanged.connect(self._follow_system)
        self.apply()

    @property
    def scene(self) -> SceneTheme:
        """The colours of the 3-D view."""
        return SCENE_DARK if self.is_dark else SCENE_LIGHT

    @property
    def is_dark(self) -> bool:
        return self.tokens is DARK

    def choose(self, choice: str) -> None:
        """Take the light or the dark theme, or follow the system."""
        self.choice = choice if choice in ("light", "dark") else "system"  # type: ignore[assignment]
        self._settings.setValue("theme", choice)
        self.apply()

    def apply(self) -> None:
        """Paint the application in the theme that was chosen."""
        dark = self.choice == "dark" or (
            self.choice == "system" and QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
        )
        self.tokens = DARK if dark else LIGHT
        application = QApplication.instance()
        if isinstance(application, QApplication):
            application.setStyle("Fusion")
            application.setPalette(palette(self.tokens))
            application.setFont(interface_font())
            application.setStyleSheet(stylesheet(self.tokens))
        self.changed.emit()

    def _follow_system(self) -> None:
        if self.choice == "system":
            self.apply()


def interface_font() -> QFont:
    """Return the system's interface font, 13 pixels high at scale 1."""
    font = QFont()
    if sys.platform.startswith("linux"):
        font.setFamilies(["Inter", "Noto Sans", "Cantarell", "Ubuntu", "DejaVu Sans"])
    font.setPixelSize(13)
    return font
