"""The commands of the menu Style."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow


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
            "style.learn", tr("Learn style"), learn, "Style", "Ctrl+L", "ph.graduation-cap",
            tr("Learn the form of the parents chosen at station Style"),
            lambda: panel.learn.learn_button.isEnabled() and not styles.is_running,
        ),
        Command(
            "style.pause", tr("Pause or resume learning"), styles.pause, "Style", "", "ph.pause-circle",
            tr("Halt the training, or let it go on"), lambda: styles.is_running,
        ),
        Command(
            "style.stop", tr("Stop learning and keep the best"), styles.stop, "Style", "", "ph.stop-circle",
            tr("End the training with its best state"), lambda: styles.is_training,
        ),
        Command(
            "style.open", tr("Open style-learner…"), link.ask_style, "Style", "", "ph.folder-open",
            tr("Open a folder that holds a style-learner"), lambda: not styles.is_running, separated=True,
        ),
        Command(
            "style.save", tr("Save style-learner…"), link.ask_folder, "Style", "", "ph.floppy-disk",
            tr("Write the style-learner into a folder"), lambda: space.style is not None,
        ),
        Command(
            "style.generate", tr("Generate clones"), generate, "Style", "Ctrl+Shift+G", "ph.sparkle",
            tr("New grains in the style, as station Style asks for them"),
            lambda: space.style is not None and not clones.is_running, separated=True,
        ),
        Command(
            "style.report", tr("Write report on the clones…"), link.ask_report, "Style", "", "ph.file-text",
            tr("Write clones and parents compared as one HTML file"), lambda: space.clones is not None,
        ),
    ]  # fmt: skip
