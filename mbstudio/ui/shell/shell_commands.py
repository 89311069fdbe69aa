"""The commands of the shell: history, log, preferences, recovery, and what helps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow


def recovery_commands(window: MainWindow) -> list[Command]:
    """Return what the menu File offers after a crash."""
    return [
        Command(
            "project.restore",
            tr("Restore unsaved work"),
            lambda: window.shell.restore(),
            "File",
            "",
            "ph.clock-counter-clockwise",
            tr("Bring back what was worked on when the program ended early"),
            lambda: bool(window.shell.autosaves.leftovers),
        ),
    ]


def edit_commands(window: MainWindow) -> list[Command]:
    """Return history and preferences, for the menu Edit."""
    return [
        Command(
            "panel.history",
            tr("History"),
            window.shell.show_history,
            "Edit",
            "Ctrl+H",
            "ph.clock-counter-clockwise",
            tr("Show all changes; a click goes back or forth to one"),
            checked=lambda: not window.shell.history_dock.isHidden(),
        ),
        Command(
            "window.preferences",
            tr("Preferences…"),
            window.shell.open_preferences,
            "Edit",
            "Ctrl+,",
            "ph.gear",
            tr("Theme, processes, autosave"),
            separated=True,
        ),
    ]


def dock_commands(window: MainWindow) -> list[Command]:
    """Return gallery and log, for the menu View."""
    return [
        Command(
            "panel.bodies",
            tr("Gallery"),
            window.shell.show_gallery,
            "View",
            "Ctrl+I",
            "ph.squares-four",
            tr("Show or hide the pictures of all grains, avatars and clones"),
            checked=lambda: not window.shell.gallery.dock.isHidden(),
        ),
        Command(
            "panel.log",
            tr("Messages and log"),
            window.shell.show_log,
            "View",
            "Ctrl+Shift+M",
            "ph.list-bullets",
            tr("Show or hide what was said so far"),
            checked=lambda: not window.shell.log_dock.isHidden(),
        ),
    ]


def help_commands(window: MainWindow) -> list[Command]:
    """Return what the menu Help begins with."""
    return [
        Command(
            "help.guide",
            tr("Guide to this station"),
            lambda: window.shell.open_guide(),
            "Help",
            "F1",
            "ph.question",
            tr("Open the user guide where it speaks of the station that is open"),
        ),
        Command(
            "help.shortcuts",
            tr("Keyboard shortcuts"),
            window.shell.open_shortcuts,
            "Help",
            "?",
            "ph.keyboard",
            tr("Show all shortcuts on one sheet"),
        ),
        Command(
            "help.tour",
            tr("Tour in five steps"),
            window.shell.start_tour,
            "Help",
            "",
            "ph.map-trifold",
            tr("Show what stands where"),
        ),
    ]
