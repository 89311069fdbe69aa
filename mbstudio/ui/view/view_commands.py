"""The commands of the menu View that concern the 3-D view: camera and layers."""

from __future__ import annotations

from functools import partial

from mbstudio.scene import VIEWS, View, switched_layers
from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.view.grain_focus import GrainFocus
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.workspace import Workspace

_FROM: dict[View, tuple[str, str]] = {
    "isometric": (mark("View: isometric"), mark("Look from an upper corner")),
    "front": (mark("View: front"), mark("Look from the front")),
    "back": (mark("View: back"), mark("Look from the back")),
    "left": (mark("View: left"), mark("Look from the left")),
    "right": (mark("View: right"), mark("Look from the right")),
    "top": (mark("View: top"), mark("Look from the top")),
    "bottom": (mark("View: bottom"), mark("Look from the bottom")),
}


def view_commands(view: SceneView) -> list[Command]:
    """Return the commands of camera and layers."""

    def has_content() -> bool:
        return view.has_content

    fit = Command(
        id="view.fit",
        title=tr("Fit view"),
        run=view.fit_view,
        menu="View",
        shortcut="Home",
        icon="ph.frame-corners",
        tip=tr("Fit everything that is shown into the view"),
        enabled=has_content,
        separated=True,
    )
    cameras = [
        Command(
            id=f"view.from_{place}",
            title=tr(_FROM[place][0]),
            run=partial(view.look_from, place),
            menu="View",
            shortcut=f"Alt+{number}",
            tip=tr(_FROM[place][1]),
            enabled=has_content,
        )
        for number, place in enumerate(VIEWS, 1)
    ]
    layers = [
        Command(
            id=f"layer.{layer}",
            title=tr(kind.title),
            run=partial(view.show_layer, layer),
            menu="View",
            icon=kind.icon,
            tip=tr(kind.tip),
            enabled=has_content,
            checked=partial(view.is_shown, layer),
            visible=partial(view.offers, layer),
            separated=number == 0,
        )
        for number, (layer, kind) in enumerate(switched_layers().items())
    ]
    return [fit, *cameras, *layers]


def focus_commands(space: Workspace, focus: GrainFocus) -> list[Command]:
    """Return the commands that bring the chosen grains before the eyes."""

    def has_choice() -> bool:
        return bool(space.chosen)

    return [
        Command(
            id="view.isolate",
            title=tr("Show the chosen grains alone"),
            run=focus.isolate,
            menu="View",
            shortcut="I",
            icon="ph.circle-dashed",
            tip=tr("Hide all other grains; press again to show them"),
            enabled=lambda: has_choice() or focus.isolated,
            checked=lambda: focus.isolated,
            separated=True,
            is_about_grains=True,
        ),
        Command(
            id="view.zoom_to_grain",
            title=tr("Zoom to the chosen grains"),
            run=focus.zoom,
            menu="View",
            shortcut="Z",
            icon="ph.magnifying-glass-plus",
            tip=tr("Show the chosen grains large, in the view and in the slices"),
            enabled=has_choice,
            is_about_grains=True,
        ),
    ]
