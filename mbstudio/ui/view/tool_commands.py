"""The commands of the 3-D view's tools: measuring, clipping, side by side, pictures and animations."""

from __future__ import annotations

from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.comparison import Comparison
from mbstudio.ui.view.pictures import Pictures
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.view.view_tools import ViewTools

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


def tool_commands(
    studio: Studio, view: SceneView, tools: ViewTools, comparison: Comparison, pictures: Pictures
) -> list[Command]:
    """Return the commands of the tools."""
    side_by_side = Command(
        id="view.side_by_side",
        title=tr("Side by side: grain, avatar, clone"),
        run=comparison.show,
        menu="Tools",
        shortcut="Ctrl+Alt+S",
        icon="ph.columns",
        tip=tr("Show grain, avatar and clone side by side, turned together"),
        enabled=lambda: comparison.is_offered,
        checked=lambda: comparison.is_shown,
        separated=True,
    )
    return [
        *_measuring(studio, view, tools),
        *_clipping(view, tools),
        side_by_side,
        *_pictures(view, pictures),
    ]


def _measuring(studio: Studio, view: SceneView, tools: ViewTools) -> list[Command]:
    return [
        Command(
            id="view.measure_distance",
            title=tr("Measure a distance"),
            run=partial(tools.measure, "distance"),
            menu="Tools",
            shortcut="Ctrl+Alt+D",
            icon="ph.ruler",
            tip=tr("Click two points of a surface or slice"),
            enabled=lambda: view.has_content,
            checked=lambda: tools.measuring == "distance",
            separated=True,
        ),
        Command(
            id="view.measure_angle",
            title=tr("Measure an angle"),
            run=partial(tools.measure, "angle"),
            menu="Tools",
            shortcut="Ctrl+Alt+A",
            icon="ph.triangle",
            tip=tr("Click three points; the second is the vertex"),
            enabled=lambda: view.has_content,
            checked=lambda: tools.measuring == "angle",
        ),
        Command(
            id="view.measure_clear",
            title=tr("Clear measurements"),
            run=tools.clear,
            menu="Tools",
            shortcut="Esc",
            icon="ph.eraser",
            tip=tr("Remove all measurements and stop measuring"),
            enabled=lambda: tools.holds_measurements and not studio.messages.text,
        ),
    ]


def _clipping(view: SceneView, tools: ViewTools) -> list[Command]:
    return [
        Command(
            id="view.clip",
            title=tr("Clipping box"),
            run=tools.clip,
            menu="Tools",
            shortcut="Ctrl+Alt+C",
            icon="ph.crop",
            tip=tr("Cut surfaces and volume open: drag the centres of the box's faces, or use the sliders"),
            enabled=lambda: view.has_content,
            checked=lambda: tools.is_clipping,
            separated=True,
        ),
        Command(
            id="view.clip_reset",
            title=tr("Reset the clipping box"),
            run=tools.reset_clip,
            menu="Tools",
            icon="ph.arrows-out",
            tip=tr("Move its faces back to the bounds of the visible bodies"),
            enabled=lambda: tools.is_clipping,
        ),
    ]


def _pictures(view: SceneView, pictures: Pictures) -> list[Command]:
    return [
        Command(
            id="view.copy_picture",
            title=tr("Copy picture of the view"),
            run=pictures.copy,
            menu="Tools",
            shortcut="Ctrl+Alt+P",
            icon="ph.copy",
            tip=tr("Copy the 3-D view to the clipboard"),
            enabled=lambda: view.has_content,
            separated=True,
        ),
        Command(
            id="view.turntable",
            title=tr("Save turntable…"),
            run=pictures.ask_turntable,
            menu="Tools",
            icon="ph.film-strip",
            tip=tr("Save a full turn of the view as GIF, MP4 or one PNG per frame"),
            enabled=lambda: view.has_content and not pictures.is_turning,
        ),
        *(
            Command(
                id=f"view.picture_{scale}",
                title=title,
                run=partial(pictures.use_scale, scale),
                menu="Tools",
                tip=tr(
                    "Save, copy and animate the view with {scale} × {scale} pixels for each screen pixel",
                    scale=scale,
                )
                if scale > 1
                else tr("Save, copy and animate the view at screen resolution"),
                checked=partial(pictures.has_scale, scale),
            )
            for scale, title in (
                (1, tr("Pictures: screen resolution")),
                (2, tr("Pictures: double resolution")),
                (4, tr("Pictures: four times the resolution")),
            )
        ),
    ]
