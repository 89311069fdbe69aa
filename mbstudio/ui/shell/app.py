"""Starting the window."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Sequence
from logging.handlers import RotatingFileHandler
from pathlib import Path
from types import TracebackType
from typing import Any

from platformdirs import user_log_path
from PySide6.QtCore import QSettings, Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from mbstudio import __version__
from mbstudio.core.errors import MbstudioError
from mbstudio.ui.icons import application_icon
from mbstudio.ui.language import install_translation, tr
from mbstudio.ui.shell.collection import pause_collection, resume_collection
from mbstudio.ui.studio import Level
from mbstudio.ui.theme import Theme

log = logging.getLogger(__name__)

_HANDED_OVER_AFTER = 0.0005
"""Seconds after which a thread lets the window's have its turn."""

Hook = Callable[[type[BaseException], BaseException, TracebackType | None], Any]


def make_application() -> QApplication:
    """Return the application, made on first use."""
    existing = QApplication.instance()
    if isinstance(existing, QApplication):
        return existing
    QGuiApplication.setHighDpiScaleFactorRoundingPolicy(Qt.HighDpiScaleFactorRoundingPolicy.PassThrough)
    application = QApplication(sys.argv[:1])
    application.setApplicationName("mbstudio")
    application.setApplicationDisplayName("MetaBall Studio")
    application.setApplicationVersion(__version__)
    application.setOrganizationName("mbstudio")
    application.setDesktopFileName("mbstudio")
    application.setWindowIcon(application_icon())
    return application


def make_settings() -> QSettings:
    """Return the person's settings: one readable file."""
    return QSettings(QSettings.Format.IniFormat, QSettings.Scope.UserScope, "mbstudio", "mbstudio")


def run(
    project_path: str | Path | None = None, files: Sequence[str | Path] = (), sample: bool = False
) -> int:
    """Open the window and return once it is closed.

    Parameters
    ----------
    project_path : str or Path, optional
        Project to open.
    files : sequence of str or Path
        A scan, a project or meshes to open; the window asks for what the files do not say.
    sample : bool
        Whether to begin with the sample scan.

    Returns
    -------
    int
        Exit code.
    """
    pause_collection()
    # A thread that computes in Python hands over to the window after 5 ms by default, at each of the
    # thousand calls that repainting takes.
    sys.setswitchinterval(_HANDED_OVER_AFTER)
    _log_to_file()
    application = make_application()
    install_translation(application)
    settings = make_settings()
    theme = Theme(settings)

    from mbstudio.ui.shell.main_window import MainWindow

    window = MainWindow(settings, theme)
    before = sys.excepthook
    sys.excepthook = _message_of(window.messages.say, before)
    window.show()

    def begin() -> None:
        if project_path is not None:
            window.project_files.open_path(Path(project_path))
        elif files:
            window.project_files.open_paths([Path(file) for file in files])
        elif sample:
            window.commands.run("scan.sample")
        window.shell.begin()
        # Once the window is painted and answers.
        QTimer.singleShot(0, resume_collection)

    QTimer.singleShot(0, begin)
    try:
        return application.exec()
    finally:
        sys.excepthook = before
        resume_collection()


def _message_of(say: Callable[[Level, str], None], before: Hook) -> Hook:
    """Return an excepthook that shows an error in the message bar and writes it to the log."""

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if issubclass(kind, KeyboardInterrupt):
            before(kind, error, trace)
            return
        if isinstance(error, MbstudioError):
            text = str(error)
        else:
            log.error("Unexpected error", exc_info=(kind, error, trace))
            text = tr(
                "Something went wrong in mbstudio ({kind}: {error}). Details: {file}",
                kind=kind.__name__,
                error=error,
                file=log_file(),
            )
        say("error", text)

    return hook


def log_file() -> Path:
    """Return the file that the window logs to."""
    return user_log_path("mbstudio", appauthor=False) / "mbstudio.log"


def _log_to_file() -> None:
    try:
        log_file().parent.mkdir(parents=True, exist_ok=True)
        handler = RotatingFileHandler(
            log_file(), maxBytes=1_000_000, backupCount=2, encoding="utf-8", delay=True
        )
    except OSError as error:
        log.warning("The log file cannot be written (%s).", error)
        return
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    root = logging.getLogger("mbstudio")
    root.setLevel(logging.INFO)
    root.addHandler(handler)
