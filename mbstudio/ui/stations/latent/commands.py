"""The commands of the menu Latent."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr
from mbstudio.ui.stations.latent.blend_page import LETTERS
from mbstudio.ui.stations.latent.dock import PAGES, LatentDock
from mbstudio.ui.stations.latent.link import LatentLink
from mbstudio.ui.stations.latent.panel import LatentPanel
from mbstudio.ui.stations.latent.shelf import Shelf
from mbstudio.ui.stations.latent.work import LatentWork
from mbstudio.ui.studio import Studio

AtStation = Callable[[Callable[[], object]], Callable[[], None]]
"""Makes of an act one that goes to the station first."""


def latent_commands(
    studio: Studio, work: LatentWork, link: LatentLink, panel: LatentPanel, dock: LatentDock, shelf: Shelf
) -> list[Command]:
    """Return the commands of station Latent."""

    def at_station(act: Callable[[], object]) -> Callable[[], None]:
        def run() -> None:
            studio.enter("latent")
            act()

        return run

    def has_grain() -> bool:
        return work.stance is not None

    return [
        *_keep(work, panel, shelf, at_station),
        *_shape(work, panel, at_station),
        *_blend(work, link, dock, shelf, at_station),
        *(
            Command(
                id=f"latent.page_{name.lower()}",
                title=tr("Page {page}", page=tr(name)),
                run=at_station(partial(dock.open_page, name)),
                menu="Latent",
                tip=tr("Turn to the page {page} of the latent studio", page=tr(name)),
                enabled=has_grain,
                separated=name == "Factors",
            )
            for name in PAGES
        ),
    ]


def _keep(work: LatentWork, panel: LatentPanel, shelf: Shelf, at_station: AtStation) -> list[Command]:
    def has_grain() -> bool:
        return work.stance is not None

    def chosen_kept() -> bool:
        return has_grain() and shelf.strip is shelf.kept and shelf.chosen is not None

    return [
        Command(
            id="latent.keep",
            title=tr("Keep grain"),
            run=at_station(work.keep),
            menu="Latent",
            shortcut="Ctrl+B",
            icon="ph.bookmark-simple",
            tip=tr("Keep the current grain on the shelf, with its recipe"),
            enabled=has_grain,
        ),
        Command(
            id="latent.alike",
            title=tr("Keep grains like this"),
            run=at_station(panel.keep_alike),
            menu="Latent",
            shortcut="Ctrl+Shift+B",
            icon="ph.dots-nine",
            tip=tr("Keep variations of the grain, with the noise set in the panel"),
            enabled=has_grain,
        ),
        Command(
            id="latent.rename",
            title=tr("Rename kept grain"),
            run=shelf.rename_chosen,
            menu="Latent",
            icon="ph.pencil-simple",
            tip=tr("Rename the selected kept grain"),
            enabled=chosen_kept,
        ),
        Command(
            id="latent.remove",
            title=tr("Remove kept grain"),
            run=shelf.remove_chosen,
            menu="Latent",
            icon="ph.trash",
            tip=tr("Remove the selected kept grain from the shelf"),
            enabled=chosen_kept,
        ),
    ]


def _shape(work: LatentWork, panel: LatentPanel, at_station: AtStation) -> list[Command]:
    def has_grain() -> bool:
        return work.stance is not None

    return [
        Command(
            id="latent.randomise",
            title=tr("Randomise"),
            run=at_station(panel.draw_at_random),
            menu="Latent",
            shortcut="Ctrl+R",
            icon="ph.dice-five",
            tip=tr("Draw a new grain in the style of the parents; locked values stay"),
            enabled=has_grain,
            separated=True,
        ),
        Command(
            id="latent.another",
            title=tr("Draw new noise"),
            run=at_station(panel.draw_another),
            menu="Latent",
            shortcut="Ctrl+Shift+A",
            tip=tr("Draw new noise of the same strength"),
            enabled=has_grain,
        ),
        Command(
            id="latent.reset",
            title=tr("Reset grain"),
            run=at_station(work.reset),
            menu="Latent",
            icon="ph.arrow-counter-clockwise",
            tip=tr("Return to the grain before it was shaped"),
            enabled=lambda: work.stance is not None and len(work.stance.operations) > 1,
        ),
        Command(
            id="latent.beyond",
            title=tr("Allow grains far outside"),
            run=panel.beyond.setChecked,
            menu="Latent",
            tip=tr("Allow grains far outside the parents' range instead of holding them at its edge"),
            enabled=has_grain,
            checked=lambda: panel.beyond.isChecked(),
        ),
    ]


def _blend(
    work: LatentWork, link: LatentLink, dock: LatentDock, shelf: Shelf, at_station: AtStation
) -> list[Command]:
    blend = dock.blend
    return [
        *(
            Command(
                id=f"latent.pick_{letter.lower()}",
                title=tr("Use the selected grain as {letter}", letter=letter),
                run=partial(at_station(partial(link.pick, letter))),
                menu="Latent",
                tip=tr("Use the grain selected on the shelf as {letter} of page Blend", letter=letter),
                enabled=lambda: work.stance is not None and shelf.chosen is not None,
                separated=letter == "A",
            )
            for letter in LETTERS
        ),
        Command(
            id="latent.play",
            title=tr("Play from A to B"),
            run=blend.play_way,
            menu="Latent",
            tip=tr("Play the interpolation from A to B and back"),
            enabled=lambda: blend.can_interpolate,
            checked=lambda: blend.is_playing,
        ),
        Command(
            id="latent.animation",
            title=tr("Save animation…"),
            run=link.ask_animation,
            menu="Latent",
            icon="ph.film-strip",
            tip=tr("Save the interpolation from A to B as an animation"),
            enabled=lambda: blend.can_interpolate,
        ),
        Command(
            id="latent.add",
            title=tr("Show the sum"),
            run=at_station(blend.add),
            menu="Latent",
            tip=tr("Show C + s (A − B), the grain that page Blend adds up"),
            enabled=lambda: blend.can_add,
        ),
    ]
