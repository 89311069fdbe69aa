"""The commands of the menu Populations."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow


def population_commands(window: MainWindow) -> list[Command]:
    """Return the commands of station Populations."""
    space, work = window.workspace, window.populations
    commands = [
        Command(
            "populations.measure",
            tr("Measure populations"),
            work.measure,
            "Populations",
            "Ctrl+M",
            "ph.ruler",
            tr("Measure grains and avatars for the plots"),
            lambda: space.state.grains is not None and not work.is_measuring and not work.is_current,
        ),
        Command(
            "populations.report",
            tr("Write report…"),
            window.files.ask_report,
            "Populations",
            "Ctrl+Shift+R",
            "ph.file-text",
            tr("Write tables and figures as one HTML file"),
            lambda: space.state.grains is not None and not work.is_measuring,
        ),
        Command(
            "populations.save_figure",
            tr("Save figure…"),
            window.files.ask_figure,
            "Populations",
            "",
            "ph.download-simple",
            tr("Save the plot that is looked at as SVG, PNG or PDF"),
            lambda: bool(work.populations),
        ),
        Command(
            "populations.copy_figure",
            tr("Copy figure"),
            window.brushing.copy_figure,
            "Populations",
            "",
            "ph.copy",
            tr("Put the plot that is looked at into the clipboard"),
            lambda: bool(work.populations),
        ),
    ]
    for place, (name, title) in enumerate(
        (
            ("distribution", tr("Distribution")),
            ("pairs", tr("Pairs")),
            ("zingg", tr("Zingg diagram")),
            ("sneed_folk", tr("Sneed–Folk diagram")),
            ("size", tr("Particle size")),
        )
    ):
        commands.append(
            Command(
                f"populations.{name}",
                title,
                partial(_open_page, window, name),
                "Populations",
                f"Ctrl+Alt+{place + 1}",
                "",
                tr("Go to the plot: {plot}", plot=title),
                lambda: space.state.grains is not None,
                separated=place == 0,
            )
        )
    return commands


def _open_page(window: MainWindow, name: str) -> None:
    window.enter("populations")
    window.show_plots(True)
    window.plots.open_page(name)
