"""Figure of a specimen: porosity along its axes, boxes that grow, sizes against height and radius."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.porosity import PorosityProfile, RepresentativeVolume, SizeProfile
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.population_style import plain_axes
from mbstudio.scene.pictures.figures import DPI
from mbstudio.scene.theme import LIGHT, SceneTheme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def specimen_figure(
    profiles: Mapping[str, PorosityProfile],
    boxes: RepresentativeVolume | None,
    sizes: Mapping[str, SizeProfile],
    *,
    theme: SceneTheme = LIGHT,
) -> Figure:
    """Draw porosity profiles, porosity of growing boxes, and sizes of grains by height and radius.

    Parameters
    ----------
    profiles : mapping of str to PorosityProfile
    boxes : RepresentativeVolume or None
    sizes : mapping of str to SizeProfile
        May be empty.
    theme : SceneTheme
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, 6.4), dpi=DPI, facecolor="white", layout="constrained")
    places = figure.subplots(2, 2)
    for axes in places.ravel():
        plain_axes(axes, theme)
    unit = unit_label(profiles["z"].unit)
    _draw_profiles(places[0, 0], profiles, unit, theme)
    _draw_boxes(places[0, 1], boxes, unit, theme)
    for axes, name in zip(places[1], ("height", "radius"), strict=True):
        _draw_sizes(axes, sizes.get(name), name, unit, theme)
    return figure


def _draw_profiles(axes: Axes, profiles: Mapping[str, PorosityProfile], unit: str, theme: SceneTheme) -> None:
    colours = {"z": theme.grain, "radius": theme.avatar, "y": "#6b7680", "x": "#a3adb5"}
    for name, profile in profiles.items():
        axes.plot(
            profile.places - profile.places.min() * (name != "radius"), profile.porosity,
            color=colours[name], linewidth=1.5, label=f"along {name}" if name != "radius" else "by radius",
        )  # fmt: skip
    axes.axhline(profiles["z"].mean, color=theme.ink, linewidth=0.8, linestyle="--")
    axes.set_xlabel(f"Distance from the first slice, or from the axis ({unit})", color=theme.ink)
    axes.set_ylabel("Porosity", color=theme.ink)
    axes.set_ylim(0, 1)
    axes.legend(fontsize=7.5, frameon=False, labelcolor=theme.ink, ncols=2)


def _draw_boxes(axes: Axes, boxes: RepresentativeVolume | None, unit: str, theme: SceneTheme) -> None:
    axes.set_xlabel(f"Edge of the boxes ({unit})", color=theme.ink)
    axes.set_ylabel("Porosity of boxes, ± s.d.", color=theme.ink)
    if boxes is None:
        return
    axes.plot(boxes.edges, boxes.mean, color=theme.grain, linewidth=1.6)
    axes.fill_between(
        boxes.edges, boxes.mean - boxes.deviation, boxes.mean + boxes.deviation, color=theme.grain,
        alpha=0.22, linewidth=0,
    )  # fmt: skip
    if boxes.edge is not None:
        axes.axvline(boxes.edge, color=theme.avatar, linewidth=1.2, linestyle="--")
        axes.annotate(
            f"{boxes.edge:.3g} {unit}", (boxes.edge, 0.02), xycoords=("data", "axes fraction"), fontsize=8,
            color=theme.ink, xytext=(4, 0), textcoords="offset points",
        )  # fmt: skip


def _draw_sizes(axes: Axes, found: SizeProfile | None, name: str, unit: str, theme: SceneTheme) -> None:
    axes.set_xlabel(f"{'Height' if name == 'height' else 'Distance from the axis'} ({unit})", color=theme.ink)
    axes.set_ylabel(f"Size b ({unit})", color=theme.ink)
    if found is None:
        return
    axes.scatter(found.places, found.sizes, s=8, color=theme.grain, alpha=0.4, linewidths=0)
    middles = (found.bins[:-1] + found.bins[1:]) / 2
    axes.errorbar(
        middles, found.mean, yerr=np.where(np.isfinite(found.error), 1.96 * found.error, 0.0),
        color=theme.avatar, linewidth=1.5, capsize=2, marker="o", markersize=3.5,
    )  # fmt: skip
    p = "< 0.001" if found.p < 0.001 else f"= {found.p:.2f}"
    axes.set_title(
        f"rank correlation {found.rank_correlation:+.2f}, p {p}", fontsize=8.5, color=theme.ink, loc="left"
    )
