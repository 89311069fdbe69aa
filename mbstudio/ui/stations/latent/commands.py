"""The commands of the menu Latent."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.latent.blend_page import LETTERS

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

PAGES = (mark("Factors"), mark("Blend"), mark("Map"))
"""Of the latent studio."""


def latent_commands(window: MainWindow) -> list[Command]:
    """Return the commands of station Latent."""
    work, link, panel = window.latents, window.shaping, window.panels_latent
    gallery, blend = window.gallery, window.studio.blend

    def there() -> bool:
        return work.stance is not None

    def at_station(act: Callable[[], object]) -> Callable[[], None]:
        def run() -> None:
            window.enter("latent")
            act()

        return run

    def chosen_kept() -> bool:
        return there() and gallery.strip is gallery.kept and gallery.chosen is not None

    return [
        Command(
            "latent.keep", tr("Keep grain"), at_station(work.keep), "Latent", "Ctrl+B", "ph.bookmark-simple",
            tr("Put the grain under the hand into the gallery, with its recipe"), there,
        ),
        Command(
            "latent.alike", tr("Keep grains like this"), at_station(panel.alike.click), "Latent",
            "Ctrl+Shift+B", "ph.dots-nine",
            tr("Keep variations of the grain, with the noise set in the panel"), there,
        ),
        Command(
            "latent.rename", tr("Rename kept grain"), gallery.rename.click, "Latent", "", "ph.pencil-simple",
            tr("Call the chosen kept grain otherwise"), chosen_kept,
        ),
        Command(
            "latent.remove", tr("Remove kept grain"), gallery.remove.click, "Latent", "", "ph.trash",
            tr("Take the chosen kept grain out of the gallery"), chosen_kept,
        ),
        Command(
            "latent.randomise", tr("Randomise"), at_station(panel.randomise.click), "Latent", "Ctrl+R",
            "ph.dice-five", tr("A new grain in the style of the parents; what is locked stays"), there,
            separated=True,
        ),
        Command(
            "latent.another", tr("Another one"), at_station(panel.another.click), "Latent",
            "Ctrl+Shift+A", "", tr("Noise as strong, another way"), there,
        ),
        Command(
            "latent.reset", tr("Reset grain"), at_station(work.reset), "Latent", "",
            "ph.arrow-counter-clockwise", tr("Back to the grain before it was shaped"),
            lambda: work.stance is not None and len(work.stance.operations) > 1,
        ),
        Command(
            "latent.beyond", tr("Allow far outside"), panel.beyond.setChecked, "Latent", "", "",
            tr("Let grains go far outside the parents instead of holding them at the edge"), there,
            lambda: panel.beyond.isChecked(),
        ),
        *(
            Command(
                f"latent.pick_{letter.lower()}", tr("Take chosen grain as {letter}", letter=letter),
                partial(at_station(partial(link.pick, letter))), "Latent", "", "",
                tr("Let {letter} of page Blend stand for the grain chosen in the gallery", letter=letter),
                lambda: there() and gallery.chosen is not None, separated=letter == "A",
            )
            for letter in LETTERS
        ),
        Command(
            "latent.play", tr("Play from A to B"), blend.play.setChecked, "Latent", "", "",
            tr("Play the way from A to B and back"), lambda: blend.play.isEnabled(),
            lambda: blend.play.isChecked(),
        ),
        Command(
            "latent.animation", tr("Save animation…"), link.ask_animation, "Latent", "", "ph.film-strip",
            tr("The way from A to B as a moving picture"), lambda: blend.animation.isEnabled(),
        ),
        *(
            Command(
                f"latent.page_{name.lower()}", tr("Page {page}", page=tr(name)),
                at_station(partial(window.studio.open_page, name)), "Latent", "", "",
                tr("Turn to the page {page} of the latent studio", page=tr(name)), there,
                separated=name == "Factors",
            )
            for name in PAGES
        ),
    ]  # fmt: skip
