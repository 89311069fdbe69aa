"""The commands of the menu Latent that are about grains shaped from surfaces."""

from __future__ import annotations

from collections.abc import Callable

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr
from mbstudio.ui.stations.latent.surface_sliders import SurfaceSliders
from mbstudio.ui.stations.latent.surface_work import SurfaceWork
from mbstudio.ui.studio import Studio


def surface_commands(studio: Studio, work: SurfaceWork, sliders: SurfaceSliders) -> list[Command]:
    """Return the commands for grains shaped from surfaces."""

    def at_station(act: Callable[[], object]) -> Callable[[], None]:
        def run() -> None:
            studio.enter("latent")
            act()

        return run

    def has_grain() -> bool:
        return work.step is not None

    return [
        Command(
            id="latent.keep_surface",
            title=tr("Keep shaped grain among the clones"),
            run=at_station(work.keep),
            menu="Latent",
            icon="ph.bookmark-simple",
            tip=tr("Add the grain that is shaped from surfaces to the clones, with its metaball"),
            enabled=has_grain,
            separated=True,
        ),
        Command(
            id="latent.draw_surface",
            title=tr("Randomise shaped grain"),
            run=at_station(sliders.draw_at_random),
            menu="Latent",
            icon="ph.dice-five",
            tip=tr("Draw a clone of the surfaces at random"),
            enabled=has_grain,
        ),
        Command(
            id="latent.another_warp",
            title=tr("Draw new warp"),
            run=at_station(sliders.draw_another),
            menu="Latent",
            tip=tr("Draw another warp of the same strength"),
            enabled=has_grain,
        ),
        Command(
            id="latent.reset_surface",
            title=tr("Reset shaped grain"),
            run=at_station(work.reset),
            menu="Latent",
            icon="ph.arrow-counter-clockwise",
            tip=tr("Return to the parent as it is"),
            enabled=lambda: len(work.words) > 1,
        ),
    ]
