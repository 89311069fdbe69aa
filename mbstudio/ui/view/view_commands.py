"""The commands of the menu View: stations, camera, layers, panels, theme."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.scene import VIEWS, View, switched_layers
from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

STATIONS = (
    ("scan", mark("Scan"), "ph.stack", mark("The CT stack (Ctrl+1)")),
    ("grains", mark("Grains"), "ph.polygon", mark("Find the grains (Ctrl+2)")),
    ("fit", mark("Fit"), "ph.circles-three", mark("Fit avatars (Ctrl+3)")),
    ("populations", mark("Populations"), "ph.chart-bar", mark("Compare grains and avatars (Ctrl+4)")),
    ("style", mark("Style"), "ph.paint-brush", mark("Learn the form of grains, generate new ones (Ctrl+5)")),
    ("latent", mark("Latent"), "ph.sliders-horizontal", mark("Shape grains by hand (Ctrl+6)")),
    ("export", mark("Export"), "ph.export", mark("Write DEM files (Ctrl+7)")),
)

_FROM: dict[View, tuple[str, str]] = {
    "isometric": (mark("View: isometric"), mark("Look at it from an upper corner")),
    "front": (mark("View: front"), mark("Look at it from the front")),
    "back": (mark("View: back"), mark("Look at it from the back")),
    "left": (mark("View: left"), mark("Look at it from the left")),
    "right": (mark("View: right"), mark("Look at it from the right")),
    "top": (mark("View: top"), mark("Look at it from the top")),
    "bottom": (mark("View: bottom"), mark("Look at it from the bottom")),
}


def view_commands(window: MainWindow) -> list[Command]:
    """Return the commands of the menu View."""
    link = window.link
    commands = [
        Command(
            f"station.{name}",
            tr("Go to {station}", station=tr(title)),
            partial(window.enter, name),
            "View",
            f"Ctrl+{number}",
            icon,
            tr(tip),
        )
        for number, (name, title, icon, tip) in enumerate(STATIONS, 1)
    ]
    commands.append(
        Command(
            "view.fit",
            tr("Fit view"),
            link.fit_view,
            "View",
            "Home",
            "ph.frame-corners",
            tr("Bring all that is shown into the picture"),
            lambda: window.has_view,
            separated=True,
        )
    )
    commands += [
        Command(
            f"view.from_{view}",
            tr(_FROM[view][0]),
            partial(link.look_from, view),
            "View",
            f"Alt+{number}",
            "",
            tr(_FROM[view][1]),
            lambda: window.has_view,
        )
        for number, view in enumerate(VIEWS, 1)
    ]
    commands += [
        Command(
            f"layer.{layer}",
            tr(kind.title),
            partial(link.show_layer, layer),
            "View",
            "",
            kind.icon,
            tr(kind.tip),
            lambda: window.has_view,
            partial(link.is_shown, layer),
            separated=number == 0,
        )
        for number, (layer, kind) in enumerate(switched_layers().items())
    ]
    commands += [
        Command(
            "panel.table",
            tr("Table of grains"),
            window.show_table,
            "View",
            "Ctrl+T",
            "ph.table",
            tr("Show or hide the table of grains"),
            checked=lambda: not window.table_dock.isHidden(),
            separated=True,
        ),
        Command(
            "panel.curve",
            tr("Convergence curve"),
            window.show_curve,
            "View",
            "",
            "ph.chart-line",
            tr("Show or hide the convergence curve"),
            checked=lambda: not window.curve_dock.isHidden(),
        ),
        Command(
            "panel.slices",
            tr("Slice views"),
            window.slicing.show,
            "View",
            "Ctrl+Shift+L",
            "ph.columns",
            tr("Show or hide the three slices as flat pictures, at stations Scan and Grains"),
            lambda: window.slicing.is_offered,
            checked=lambda: not window.slices_dock.isHidden(),
        ),
        Command(
            "panel.plots",
            tr("Plots of populations"),
            window.show_plots,
            "View",
            "",
            "ph.chart-bar",
            tr("Show or hide the plots at station Populations"),
            lambda: window.station == "populations",
            checked=lambda: not window.plots_dock.isHidden(),
        ),
        Command(
            "panel.style",
            tr("Curves and clones"),
            window.show_style_page,
            "View",
            "",
            "ph.chart-line-up",
            tr("Show or hide curves, clones and quality at station Style"),
            lambda: window.station == "style",
            checked=lambda: not window.style_dock.isHidden(),
        ),
        Command(
            "panel.reset", tr("Reset layout"), window.reset_layout, "View", "", "", tr("Put the panels back")
        ),
    ]
    commands += [
        Command(
            f"theme.{choice}",
            title,
            partial(window.choose_theme, choice),
            "View",
            "",
            icon,
            tip,
            checked=partial(window.has_theme, choice),
            separated=choice == "system",
        )
        for choice, title, icon, tip in (
            (
                "system",
                tr("Theme: as the system"),
                "ph.circle-half",
                tr("Follow the system's light or dark theme"),
            ),
            ("light", tr("Theme: light"), "ph.sun", tr("Dark text on light")),
            ("dark", tr("Theme: dark"), "ph.moon", tr("Light text on dark")),
        )
    ]
    return commands
