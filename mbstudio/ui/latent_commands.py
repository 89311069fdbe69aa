"""The commands of the menu Latent."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.widgets.blend_page import LETTERS

if TYPE_CHECKING:
    from mbstudio.ui.main_window import MainWindow


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
            "latent.keep", "Keep grain", at_station(work.keep), "Latent", "Ctrl+B", "ph.bookmark-simple",
            "Put the grain under the hand into the gallery, with its recipe", there,
        ),
        Command(
            "latent.alike", "Keep grains like this", at_station(panel.alike.click), "Latent", "Ctrl+Shift+B",
            "ph.dots-nine", "Keep variations of the grain, with the noise set in the panel", there,
        ),
        Command(
            "latent.rename", "Rename kept grain", gallery.rename.click, "Latent", "", "ph.pencil-simple",
            "Call the chosen kept grain otherwise", chosen_kept,
        ),
        Command(
            "latent.remove", "Remove kept grain", gallery.remove.click, "Latent", "", "ph.trash",
            "Take the chosen kept grain out of the gallery", chosen_kept,
        ),
        Command(
            "latent.randomise", "Randomise", at_station(panel.randomise.click), "Latent", "Ctrl+R",
            "ph.dice-five", "A new grain in the style of the parents; what is locked stays", there,
            separated=True,
        ),
        Command(
            "latent.another", "Another one", at_station(panel.another.click), "Latent", "Ctrl+Shift+A", "",
            "Noise as strong, another way", there,
        ),
        Command(
            "latent.reset", "Reset grain", at_station(work.reset), "Latent", "", "ph.arrow-counter-clockwise",
            "Back to the grain before it was shaped",
            lambda: work.stance is not None and len(work.stance.operations) > 1,
        ),
        Command(
            "latent.beyond", "Allow far outside", panel.beyond.setChecked, "Latent", "", "",
            "Let grains go far outside the parents instead of holding them at the edge", there,
            lambda: panel.beyond.isChecked(),
        ),
        *(
            Command(
                f"latent.pick_{letter.lower()}", f"Take chosen grain as {letter}",
                partial(at_station(partial(link.pick, letter))), "Latent", "", "",
                f"Let {letter} of page Blend stand for the grain chosen in the gallery",
                lambda: there() and gallery.chosen is not None, separated=letter == "A",
            )
            for letter in LETTERS
        ),
        Command(
            "latent.play", "Play from A to B", blend.play.setChecked, "Latent", "", "",
            "Play the way from A to B and back", lambda: blend.play.isEnabled(),
            lambda: blend.play.isChecked(),
        ),
        Command(
            "latent.animation", "Save animation…", link.ask_animation, "Latent", "", "ph.film-strip",
            "The way from A to B as a moving picture", lambda: blend.animation.isEnabled(),
        ),
        *(
            Command(
                f"latent.page_{title.lower()}", f"Page {title}",
                at_station(partial(window.studio.open_page, title)), "Latent", "", "",
                f"Turn to the page {title} of the latent studio", there, separated=title == "Factors",
            )
            for title in ("Factors", "Blend", "Map")
        ),
    ]  # fmt: skip
