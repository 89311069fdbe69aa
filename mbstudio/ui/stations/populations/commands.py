"""The commands of the menu Populations."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.populations.link import PopulationLink
from mbstudio.ui.stations.populations.work import PopulationWork
from mbstudio.ui.workspace import Workspace


def population_commands(
    space: Workspace, work: PopulationWork, link: PopulationLink, open_page: Callable[[str], object]
) -> list[Command]:
    """Return the commands of station Populations."""
    commands = [
        Command(
            id="populations.measure",
            title=tr("Measure populations"),
            run=work.measure,
            menu="Populations",
            shortcut="Ctrl+M",
            icon="ph.ruler",
            tip=tr("Measure grains and avatars for the plots"),
            enabled=lambda: work.has_bodies and not work.run.is_running and not work.is_current,
        ),
        Command(
            id="populations.measure_chosen",
            title=tr("Measure chosen grains"),
            run=link.measure_chosen,
            menu="Populations",
            icon="ph.ruler",
            tip=tr("Measure the chosen grains and their avatars alone"),
            enabled=lambda: bool(space.chosen) and not work.run.is_running,
            words=lambda: plural(
                len(space.chosen) or 1,
                mark("Measure chosen grain"),
                mark("Measure {count} chosen grains"),
            ),
            is_about_grains=True,
        ),
        Command(
            id="populations.report",
            title=tr("Write report…"),
            run=link.ask_report,
            menu="Populations",
            shortcut="Ctrl+Shift+R",
            icon="ph.file-text",
            tip=tr("Write tables and figures as one file: HTML, PDF or JSON"),
            enabled=lambda: work.has_bodies and not work.run.is_running,
        ),
        Command(
            id="populations.save_figure",
            title=tr("Save figure…"),
            run=link.ask_figure,
            menu="Populations",
            icon="ph.download-simple",
            tip=tr("Save the current plot as SVG, PNG or PDF"),
            enabled=lambda: bool(work.populations) and not work.is_growing,
        ),
        Command(
            id="populations.copy_figure",
            title=tr("Copy figure"),
            run=link.copy_figure,
            menu="Populations",
            icon="ph.copy",
            tip=tr("Copy the current plot to the clipboard"),
            enabled=lambda: bool(work.populations) and not work.is_growing,
        ),
    ]
    return [*commands, *_laboratory(work, link), *_plots(space, open_page)]


def _laboratory(work: PopulationWork, link: PopulationLink) -> list[Command]:
    """Return what a laboratory asks for."""
    return [
        Command(
            id="populations.certificate",
            title=tr("Write certificate…"),
            run=link.ask_certificate,
            menu="Populations",
            icon="ph.medal",
            tip=tr("Write sizes, form and pores of the sample on one page, as PDF"),
            enabled=lambda: work.is_current and not work.run.is_running,
        ),
        Command(
            id="populations.laboratory",
            title=tr("Laboratory table…"),
            run=link.ask_laboratory,
            menu="Populations",
            icon="ph.table",
            tip=tr("Show the table of a sieve analysis or Camsizer beside the curves (CSV)"),
            enabled=lambda: bool(work.populations) and not work.is_growing,
        ),
        Command(
            id="populations.remove_laboratory",
            title=tr("Remove laboratory tables"),
            run=link.remove_laboratory,
            menu="Populations",
            tip=tr("Show no tables of laboratories any more"),
            enabled=lambda: link.has_laboratory,
        ),
        Command(
            id="populations.porosity",
            title=tr("Porosity of the specimen"),
            run=link.pores.measure,
            menu="Populations",
            icon="ph.drop-half",
            tip=tr("Measure porosity, its profiles and the representative box of the segmented scan"),
            enabled=lambda: link.pores.has_specimen,
        ),
    ]


def _plots(space: Workspace, open_page: Callable[[str], object]) -> list[Command]:
    """Return what goes to each plot."""
    commands = []
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
                id=f"populations.{name}",
                title=title,
                run=partial(open_page, name),
                menu="Populations",
                shortcut=f"Ctrl+Alt+{place + 1}",
                tip=tr("Go to the plot: {plot}", plot=title),
                enabled=lambda: space.state.grains is not None,
                separated=place == 0,
            )
        )
    return commands
