"""The commands on suspicious grains."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.grains.suspicion.tour import SuspicionTour
from mbstudio.ui.stations.grains.suspicion.work import SuspicionWork
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.workspace import Workspace


def suspicion_commands(
    space: Workspace,
    view: SceneView,
    work: SuspicionWork,
    tour: SuspicionTour,
    is_open: Callable[[], bool],
    can_take: Callable[[], bool],
    take: Callable[[], object],
) -> list[Command]:
    """Return the commands of station Grains that go through suspicious grains.

    Parameters
    ----------
    can_take, take : callable
        Whether a tool shows something that is to be taken, and what takes it: the same key does.
    """

    def has_grains() -> bool:
        return is_open() and space.state.grains is not None

    return [
        Command(
            id="grains.look",
            title=tr("Look for suspicious grains"),
            run=work.look,
            menu="Grains",
            icon="ph.eye",
            tip=tr("Score all grains by how likely they are several, or a part of one"),
            enabled=lambda: has_grains() and not work.is_running and bool(work.missing),
            separated=True,
        ),
        Command(
            id="grains.next_suspect",
            title=tr("Next suspicious grain"),
            run=partial(tour.step, 1),
            menu="Grains",
            shortcut="N",
            icon="ph.arrow-right",
            tip=tr("Go to the next grain that is probably several, or a part of one"),
            enabled=has_grains,
        ),
        Command(
            id="grains.previous_suspect",
            title=tr("Previous suspicious grain"),
            run=partial(tour.step, -1),
            menu="Grains",
            shortcut="Shift+N",
            icon="ph.arrow-left",
            tip=tr("Go back to the suspicious grain before"),
            enabled=has_grains,
        ),
        Command(
            id="grains.accept_suspect",
            title=tr("Take what is shown, or accept the grain"),
            run=lambda: take() if can_take() else tour.accept(),
            menu="Grains",
            shortcut="Return; Enter",
            icon="ph.check",
            tip=tr(
                "Take the split or new grain that the slices show; else the suspicious grain is right: go to "
                "the next, it is not shown again until it changes"
            ),
            enabled=lambda: can_take() or (is_open() and tour.can_accept_by_key),
        ),
        *_of_all(space, view, tour, has_grains),
    ]


def _of_all(
    space: Workspace, view: SceneView, tour: SuspicionTour, has_grains: Callable[[], bool]
) -> list[Command]:
    return [
        Command(
            id="grains.accept",
            title=tr("Accept grains"),
            run=tour.accept_chosen,
            menu="Grains",
            icon="ph.checks",
            tip=tr("The chosen grains are right: they are not shown as suspicious until they change"),
            enabled=lambda: has_grains() and bool(space.chosen),
            words=lambda: plural(len(space.chosen) or 1, mark("Accept grain"), mark("Accept {count} grains")),
            is_about_grains=True,
        ),
        Command(
            id="grains.colour_by_suspicion",
            title=tr("Colour grains by suspicion"),
            run=view.colour_by_suspicion,
            menu="Grains",
            icon="ph.palette",
            tip=tr("Show suspicious grains red in the view, grains that were not looked at grey"),
            enabled=lambda: space.state.grains is not None,
            checked=lambda: view.shows_suspicion,
        ),
    ]
