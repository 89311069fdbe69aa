"""The commands of the flat slices: their layout, how grains are drawn over them, the grey window."""

from __future__ import annotations

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr
from mbstudio.ui.view.slice_views import SliceViews

BUTTONS = ("slices.square", "slices.linked", "slices.outlines", "slices.chosen_only", "slices.avatar")
"""Those with a button in the bar above the slices, in their order."""
AUTO = "slices.auto_window"


def slice_commands(slices: SliceViews) -> list[Command]:
    """Return the commands of the flat slices."""
    return [
        *_layout(slices),
        *_look(slices),
        Command(
            id=AUTO,
            title=tr("Grey window: automatic"),
            run=slices.use_auto_window,
            menu="View",
            icon="ph.magic-wand",
            tip=tr("Show the grey values black and white between which nearly all of them lie"),
            enabled=lambda: slices.is_offered and slices.shows_greys,
        ),
    ]


def _layout(slices: SliceViews) -> list[Command]:
    def offered() -> bool:
        return slices.is_offered

    return [
        Command(
            id="slices.square",
            title=tr("Slices and view in a square"),
            run=slices.set_square,
            menu="View",
            shortcut="F10",
            icon="ph.grid-four",
            tip=tr("Show the three slices and the 3-D view two by two"),
            enabled=offered,
            checked=lambda: slices.is_square,
            separated=True,
        ),
        Command(
            id="slices.enlarge",
            title=tr("Enlarge a slice"),
            run=lambda _on: slices.enlarge_next(),
            menu="View",
            shortcut="F11",
            icon="ph.arrows-out-simple",
            tip=tr("Make the slice that has the focus as large as the view, then the next ones, then none"),
            enabled=offered,
            checked=lambda: bool(slices.enlarged),
        ),
        Command(
            id="slices.linked",
            title=tr("Magnify slices together"),
            run=slices.set_linked,
            menu="View",
            icon="ph.link",
            tip=tr("Show all slices equally magnified, and the same place in their middle"),
            enabled=offered,
            checked=lambda: slices.is_linked,
        ),
    ]


def _look(slices: SliceViews) -> list[Command]:
    look = slices.look

    def has_grains() -> bool:
        return slices.is_offered and slices.shows_grains

    return [
        Command(
            id="slices.outlines",
            title=tr("Outlines of the grains in the slices"),
            run=look.set_outlines,
            menu="View",
            icon="ph.polygon",
            tip=tr("Outline the grains in the slices"),
            enabled=has_grains,
            checked=lambda: look.outlines,
        ),
        Command(
            id="slices.chosen_only",
            title=tr("Chosen grains only in the slices"),
            run=look.set_chosen_only,
            menu="View",
            icon="ph.selection",
            tip=tr("Leave all grains but the chosen ones out of the slices"),
            enabled=has_grains,
            checked=lambda: look.chosen_only,
        ),
        Command(
            id="slices.avatar",
            title=tr("Outline of the avatar in the slices"),
            run=look.set_avatar,
            menu="View",
            icon="ph.circle-dashed",
            tip=tr("Draw where the slices cut the avatar of the selected grain"),
            enabled=has_grains,
            checked=lambda: look.avatar,
        ),
    ]
