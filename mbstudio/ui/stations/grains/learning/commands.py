"""The commands that paint strokes, learn from them, and preview the splitting."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr
from mbstudio.ui.stations.grains.learning.stroke_painting import StrokePainting
from mbstudio.ui.workspace import Workspace

STROKES = (
    "grains.stroke_grain",
    "grains.stroke_void",
    "grains.stroke_mineral",
    "grains.stroke_border",
    "grains.stroke_erase",
)
"""Commands that take a kind up, in the order of their buttons."""


def learning_commands(
    space: Workspace,
    painting: StrokePainting,
    preview_splitting: Callable[[], None],
    is_open: Callable[[], bool],
) -> list[Command]:
    """Return the commands; their keys count only at station Grains."""

    def can_paint() -> bool:
        return is_open() and space.scan is not None and painting.is_active

    kinds = (
        ("grain", "grain", tr("Stroke: grain"), "1", tr("Paint what is grain")),
        ("void", "void", tr("Stroke: void"), "2", tr("Paint what lies between the grains")),
        ("mineral", "mineral", tr("Stroke: second mineral"), "3", tr("Paint grains of another tone")),
        ("border", "border", tr("Stroke: border"), "4", tr("Paint where two grains touch")),
        ("erase", "", tr("Take strokes away"), "0", tr("Take away what was painted under the brush")),
    )
    return [
        *(
            Command(
                id=f"grains.stroke_{name}",
                title=title,
                run=partial(_take_up, painting, kind),
                menu="Grains",
                shortcut=key,
                tip=tip,
                enabled=can_paint,
                checked=partial(_is_in_hand, painting, kind),
                separated=name == "grain",
            )
            for name, kind, title, key, tip in kinds
        ),
        Command(
            id="grains.put_stroke_down",
            title=tr("End painting strokes"),
            run=painting.put_down,
            menu="Grains",
            shortcut="Esc",
            tip=tr("Give the left button in the slices back"),
            enabled=lambda: is_open() and painting.can_be_put_down,
        ),
        Command(
            id="grains.clear_strokes",
            title=tr("Take all strokes away"),
            run=painting.clear,
            menu="Grains",
            tip=tr("Begin anew with painting"),
            enabled=lambda: can_paint() and bool(space.state.strokes),
        ),
        Command(
            id="grains.load_classifier",
            title=tr("Load classifier…"),
            run=painting.ask_file_to_load,
            menu="Grains",
            tip=tr("Use what was learned in another scan"),
            enabled=lambda: is_open() and space.scan is not None,
        ),
        Command(
            id="grains.save_classifier",
            title=tr("Save classifier…"),
            run=painting.ask_file_to_save,
            menu="Grains",
            tip=tr("Keep what was learned for other scans"),
            enabled=lambda: is_open() and space.state.classifier is not None,
        ),
        Command(
            id="grains.preview_splitting",
            title=tr("Preview the splitting"),
            run=preview_splitting,
            menu="Grains",
            shortcut="P",
            icon="ph.eye",
            tip=tr("Part the grains about the crossing of the slices, and show them there"),
            enabled=lambda: is_open() and space.scan is not None,
        ),
    ]


def _take_up(painting: StrokePainting, kind: str, _on: bool = True) -> None:
    painting.take_up(kind)


def _is_in_hand(painting: StrokePainting, kind: str) -> bool:
    return painting.kind == kind
