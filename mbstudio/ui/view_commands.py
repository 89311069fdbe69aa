"""The commands of the menu View: stations, camera, layers, panels, theme."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.scene import VIEWS, Layer
from mbstudio.ui.commands import Command

if TYPE_CHECKING:
    from mbstudio.ui.main_window import MainWindow

STATIONS = (
    ("scan", "Scan", "ph.stack", "The CT stack (Ctrl+1)"),
    ("grains", "Grains", "ph.polygon", "Find the grains (Ctrl+2)"),
    ("fit", "Fit", "ph.circles-three", "Fit avatars (Ctrl+3)"),
    ("populations", "Populations", "ph.chart-bar", "Compare grains and avatars (Ctrl+4)"),
    ("style", "Style", "ph.paint-brush", "Learn the form of grains, generate new ones (Ctrl+5)"),
    ("latent", "Latent", "ph.sliders-horizontal", "Shape grains by hand (Ctrl+6)"),
    ("export", "Export", "ph.export", "Write DEM files (Ctrl+7)"),
)

_LAYERS: tuple[tuple[Layer, str, str, str], ...] = (
    ("slices", "Slices", "ph.squares-four", "Slices through the scan"),
    ("volume", "Volume", "ph.cube", "The whole scan as a cloud"),
    ("grains", "All grains", "ph.polygon", "All grains, each in its colour"),
    ("grain", "Grain", "ph.circle-half", "Surface of the chosen grain"),
    ("avatar", "Avatar", "ph.circles-three", "Surface of the chosen grain's avatar"),
    (
        "deviation",
        "Deviation",
        "ph.thermometer",
        "How far the avatar lies outside its grain, as colours",
    ),
    ("points", "Control points", "ph.dots-nine", "Control points of the avatar"),
    ("avatars", "All avatars", "ph.selection-all", "All avatars where their grains lie"),
    ("live", "Live grain", "ph.hand", "The grain under the hand"),
    ("ghost_a", "Ghost of A", "ph.ghost", "Grain A, seen through"),
    ("ghost_b", "Ghost of B", "ph.ghost", "Grain B, seen through"),
    ("shape", "Export", "ph.circles-four", "Spheres or mesh that stand for the avatar in the export"),
    ("envelope", "Avatar over it", "ph.circle-half", "The avatar itself, seen through"),
)


def view_commands(window: MainWindow) -> list[Command]:
    """Return the commands of the menu View."""
    link = window.link
    commands = [
        Command(
            f"station.{name}",
            f"Go to {title}",
            partial(window.enter, name),
            "View",
            f"Ctrl+{number}",
            icon,
            tip,
        )
        for number, (name, title, icon, tip) in enumerate(STATIONS, 1)
    ]
    commands.append(
        Command(
            "view.fit",
            "Fit view",
            link.fit_view,
            "View",
            "Home",
            "ph.frame-corners",
            "Bring all that is shown into the picture",
            lambda: window.has_view,
            separated=True,
        )
    )
    commands += [
        Command(
            f"view.from_{view}",
            f"View: {view}",
            partial(link.look_from, view),
            "View",
            f"Alt+{number}",
            "",
            f"Look at it from the {view}" if view != "isometric" else "Look at it from an upper corner",
            lambda: window.has_view,
        )
        for number, view in enumerate(VIEWS, 1)
    ]
    commands += [
        Command(
            f"layer.{layer}",
            title,
            partial(link.show_layer, layer),
            "View",
            "",
            icon,
            tip,
            lambda: window.has_view,
            partial(link.is_shown, layer),
            separated=number == 0,
        )
        for number, (layer, title, icon, tip) in enumerate(_LAYERS)
    ]
    commands += [
        Command(
            "panel.table",
            "Table of grains",
            window.show_table,
            "View",
            "Ctrl+T",
            "ph.table",
            "Show or hide the table of grains",
            checked=lambda: not window.table_dock.isHidden(),
            separated=True,
        ),
        Command(
            "panel.curve",
            "Convergence curve",
            window.show_curve,
            "View",
            "",
            "ph.chart-line",
            "Show or hide the convergence curve",
            checked=lambda: not window.curve_dock.isHidden(),
        ),
        Command(
            "panel.slices",
            "Slice views",
            window.slicing.show,
            "View",
            "Ctrl+Shift+L",
            "ph.columns",
            "Show or hide the three slices as flat pictures, at stations Scan and Grains",
            lambda: window.slicing.is_offered,
            checked=lambda: not window.slices_dock.isHidden(),
        ),
        Command(
            "panel.plots",
            "Plots of populations",
            window.show_plots,
            "View",
            "",
            "ph.chart-bar",
            "Show or hide the plots at station Populations",
            lambda: window.station == "populations",
            checked=lambda: not window.plots_dock.isHidden(),
        ),
        Command(
            "panel.style",
            "Curves and clones",
            window.show_style_page,
            "View",
            "",
            "ph.chart-line-up",
            "Show or hide curves, clones and quality at station Style",
            lambda: window.station == "style",
            checked=lambda: not window.style_dock.isHidden(),
        ),
        Command("panel.reset", "Reset layout", window.reset_layout, "View", "", "", "Put the panels back"),
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
            ("system", "Theme: as the system", "ph.circle-half", "Follow the system's light or dark theme"),
            ("light", "Theme: light", "ph.sun", "Dark text on light"),
            ("dark", "Theme: dark", "ph.moon", "Light text on dark"),
        )
    ]
    return commands
