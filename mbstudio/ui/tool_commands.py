"""The commands of the 3-D view's tools: measuring, clipping, side by side, pictures and animations."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command

if TYPE_CHECKING:
    from mbstudio.ui.main_window import MainWindow

TOOLS = ("view.measure_distance", "view.measure_angle", "view.measure_clear", "view.clip", "view.clip_reset")
"""What the button Tools above the view offers."""


def tool_commands(window: MainWindow) -> list[Command]:
    """Return the commands of the tools."""
    return [*_measuring(window), *_clipping(window)]


def _measuring(window: MainWindow) -> list[Command]:
    tools = window.tools
    return [
        Command(
            "view.measure_distance",
            "Measure a distance",
            partial(tools.measure, "distance"),
            "View",
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
            "View",
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
            "View",
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
            "View",
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
            "View",
            "",
            "ph.arrows-out",
            "Put its faces back to the ends of what is shown",
            lambda: tools.is_clipping,
        ),
    ]
