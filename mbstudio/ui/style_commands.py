"""The commands of the menu Style."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command

if TYPE_CHECKING:
    from mbstudio.ui.main_window import MainWindow


def style_commands(window: MainWindow) -> list[Command]:
    """Return the commands of station Style."""
    space, styles, clones = window.workspace, window.styles, window.clones
    link, panel = window.style_link, window.panels_style

    def learn() -> None:
        window.enter("style")
        panel.open_page("learn")
        panel.learn.learn()

    def generate() -> None:
        window.enter("style")
        panel.open_page("generate")
        panel.generate.generate()

    return [
        Command(
            "style.learn", "Learn style", learn, "Style", "Ctrl+L", "ph.graduation-cap",
            "Learn the form of the parents chosen at station Style",
            lambda: panel.learn.learn_button.isEnabled() and not styles.is_running,
        ),
        Command(
            "style.pause", "Pause or resume learning", styles.pause, "Style", "", "ph.pause-circle",
            "Halt the training, or let it go on", lambda: styles.is_running,
        ),
        Command(
            "style.stop", "Stop learning and keep the best", styles.stop, "Style", "", "ph.stop-circle",
            "End the training with its best state", lambda: styles.is_training,
        ),
        Command(
            "style.open", "Open style-learner…", link.ask_style, "Style", "", "ph.folder-open",
            "Open a folder that holds a style-learner", lambda: not styles.is_running, separated=True,
        ),
        Command(
            "style.save", "Save style-learner…", link.ask_folder, "Style", "", "ph.floppy-disk",
            "Write the style-learner into a folder", lambda: space.style is not None,
        ),
        Command(
            "style.generate", "Generate clones", generate, "Style", "Ctrl+Shift+G", "ph.sparkle",
            "New grains in the style, as station Style asks for them",
            lambda: space.style is not None and not clones.is_running, separated=True,
        ),
        Command(
            "style.report", "Write report on the clones…", link.ask_report, "Style", "", "ph.file-text",
            "Write clones and parents compared as one HTML file", lambda: space.clones is not None,
        ),
    ]  # fmt: skip
