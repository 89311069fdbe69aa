"""The commands of the 3-D view's tools: measuring, clipping, side by side, pictures and animations."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command

if TYPE_CHECKING:
    from mbstudio.ui.main_window import MainWindow

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
        "Side by side: grain, avatar, clone",
        comparing.show,
        "Tools",
        "Ctrl+Alt+S",
        "ph.columns",
        "Show grain, avatar and clone next to each other, turned together",
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
            "Measure a distance",
            partial(tools.measure, "distance"),
            "Tools",
            "Ctrl+Alt+D",
            "ph.ruler",
            "Click two points of a surface or slice",
            lambda: window.has_view,
            lambda: tools.measuring == "distance",
            separated=True,
        ),
        Command(
            "view.measure_angle",
            "Measure an angle",
            partial(tools.measure, "angle"),
            "Tools",
            "Ctrl+Alt+A",
            "ph.triangle",
            "Click three points, the second is the corner",
            lambda: window.has_view,
            lambda: tools.measuring == "angle",
        ),
        Command(
            "view.measure_clear",
            "Clear measurements",
            tools.clear,
            "Tools",
            "Esc",
            "ph.eraser",
            "Take all measurements away and end measuring",
            # Esc belongs to the message above the view as long as there is one.
            lambda: tools.holds_measurements and not window.messages.text,
        ),
    ]


def _clipping(window: MainWindow) -> list[Command]:
    tools = window.tools
    return [
        Command(
            "view.clip",
            "Clipping box",
            tools.clip,
            "Tools",
            "Ctrl+Alt+C",
            "ph.crop",
            "Cut surfaces and volume open: drag the middles of the box's faces, or the sliders",
            lambda: window.has_view,
            lambda: tools.is_clipping,
            separated=True,
        ),
        Command(
            "view.clip_reset",
            "Reset the clipping box",
            tools.reset_clip,
            "Tools",
            "",
            "ph.arrows-out",
            "Put its faces back to the ends of what is shown",
            lambda: tools.is_clipping,
        ),
    ]


def _pictures(window: MainWindow) -> list[Command]:
    pictures = window.pictures
    return [
        Command(
            "view.copy_picture",
            "Copy picture of the view",
            pictures.copy,
            "Tools",
            "Ctrl+Alt+P",
            "ph.copy",
            "Put the 3-D view into the clipboard",
            lambda: window.has_view,
            separated=True,
        ),
        Command(
            "view.turntable",
            "Save turntable…",
            window.files.ask_turntable,
            "Tools",
            "",
            "ph.film-strip",
            "Write the view turning once around: GIF, MP4 or a PNG for each frame",
            lambda: window.has_view and not pictures.is_turning,
        ),
        Command(
            "view.save_curve",
            "Save convergence curve…",
            window.files.ask_curve,
            "Tools",
            "",
            "ph.chart-line",
            "Save the curve of the chosen grain's fit as SVG, PNG or PDF",
            lambda: window.workspace.selected in window.workspace.state.fits,
        ),
        *(
            Command(
                f"view.picture_{scale}",
                f"Pictures: {words}",
                partial(pictures.use_scale, scale),
                "Tools",
                "",
                "",
                f"Save, copy and turn the view with {scale} × {scale} pixels for each of the screen's"
                if scale > 1
                else "Save, copy and turn the view with as many pixels as the screen shows",
                checked=partial(pictures.has_scale, scale),
            )
            for scale, words in ((1, "as on the screen"), (2, "twice as fine"), (4, "four times as fine"))
        ),
    ]
