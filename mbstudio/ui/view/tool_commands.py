"""The commands of the 3-D view's tools: measuring, clipping, side by side, pictures and animations."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

TOOLS = (
    "view.measure_distance",
    "view.measure_angle",
    "view.measure_clear",
    "view.clip",
    "view.clip_reset",
    "view.side_by_side",
    "view.copy_picture",
    "view.turntable",
)
"""What the button Tools above the view offers."""


def tool_commands(window: MainWindow) -> list[Command]:
    """Return the commands of the tools."""
    comparing = window.comparing
    side_by_side = Command(
        "view.side_by_side",
        tr("Side by side: grain, avatar, clone"),
        comparing.show,
        "Tools",
        "Ctrl+Alt+S",
        "ph.columns",
        tr("Show grain, avatar and clone next to each other, turned together"),
        lambda: comparing.is_offered,
        lambda: comparing.is_shown,
        separated=True,
    )
    return [*_measuring(window), *_clipping(window), side_by_side, *_pictures(window)]


def _measuring(window: MainWindow) -> list[Command]:
    tools = window.tools
    return [
        Command(
            "view.measure_distance",
            tr("Measure a distance"),
            partial(tools.measure, "distance"),
            "Tools",
            "Ctrl+Alt+D",
            "ph.ruler",
            tr("Click two points of a surface or slice"),
            lambda: window.has_view,
            lambda: tools.measuring == "distance",
            separated=True,
        ),
        Command(
            "view.measure_angle",
            tr("Measure an angle"),
            partial(tools.measure, "angle"),
            "Tools",
            "Ctrl+Alt+A",
            "ph.triangle",
            tr("Click three points, the second is the corner"),
            lambda: window.has_view,
            lambda: tools.measuring == "angle",
        ),
        Command(
            "view.measure_clear",
            tr("Clear measurements"),
            tools.clear,
            "Tools",
            "Esc",
            "ph.eraser",
            tr("Take all measurements away and end measuring"),
            # Esc belongs to the message above the view as long as there is one.
            lambda: tools.holds_measurements and not window.messages.text,
        ),
    ]


def _clipping(window: MainWindow) -> list[Command]:
    tools = window.tools
    return [
        Command(
            "view.clip",
            tr("Clipping box"),
            tools.clip,
            "Tools",
            "Ctrl+Alt+C",
            "ph.crop",
            tr("Cut surfaces and volume open: drag the middles of the box's faces, or the sliders"),
            lambda: window.has_view,
            lambda: tools.is_clipping,
            separated=True,
        ),
        Command(
            "view.clip_reset",
            tr("Reset the clipping box"),
            tools.reset_clip,
            "Tools",
            "",
            "ph.arrows-out",
            tr("Put its faces back to the ends of what is shown"),
            lambda: tools.is_clipping,
        ),
    ]


def _pictures(window: MainWindow) -> list[Command]:
    pictures = window.pictures
    return [
        Command(
            "view.copy_picture",
            tr("Copy picture of the view"),
            pictures.copy,
            "Tools",
            "Ctrl+Alt+P",
            "ph.copy",
            tr("Put the 3-D view into the clipboard"),
            lambda: window.has_view,
            separated=True,
        ),
        Command(
            "view.turntable",
            tr("Save turntable…"),
            window.files.ask_turntable,
            "Tools",
            "",
            "ph.film-strip",
            tr("Write the view turning once around: GIF, MP4 or a PNG for each frame"),
            lambda: window.has_view and not pictures.is_turning,
        ),
        Command(
            "view.save_curve",
            tr("Save convergence curve…"),
            window.files.ask_curve,
            "Tools",
            "",
            "ph.chart-line",
            tr("Save the curve of the chosen grain's fit as SVG, PNG or PDF"),
            lambda: window.workspace.selected in window.workspace.state.fits,
        ),
        *(
            Command(
                f"view.picture_{scale}",
                title,
                partial(pictures.use_scale, scale),
                "Tools",
                "",
                "",
                tr(
                    "Save, copy and turn the view with {scale} × {scale} pixels for each of the screen's",
                    scale=scale,
                )
                if scale > 1
                else tr("Save, copy and turn the view with as many pixels as the screen shows"),
                checked=partial(pictures.has_scale, scale),
            )
            for scale, title in (
                (1, tr("Pictures: as on the screen")),
                (2, tr("Pictures: twice as fine")),
                (4, tr("Pictures: four times as fine")),
            )
        ),
    ]
