"""Figures of a report: slices with the outlines of the grains, and convergence curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from mbstudio.scene.layers.annotations import readable_length, round_length
from mbstudio.scene.layers.slices import AXES, cut, grey_window, slice_image
from mbstudio.scene.theme import LIGHT, SceneTheme, label_colours

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mbstudio.core.grains import GrainSet
    from mbstudio.core.imaging import FitResult
    from mbstudio.core.scan import Scan

DPI = 120


def slices_figure(
    scan: Scan, grains: GrainSet | None = None, theme: SceneTheme = LIGHT
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw the middle slice across each axis to scale, the grains outlined, with a scale bar."""
    from matplotlib import patheffects
    from matplotlib.figure import Figure

    window = grey_window(scan)
    colours = None if grains is None else label_colours(int(grains.labels.max()))
    edges = dict(zip(AXES, scan.voxel_size.xyz, strict=True))
    figure = Figure(figsize=(13, 4.9), dpi=DPI, facecolor="white", layout="constrained")
    for axes, axis in zip(figure.subplots(1, 3), reversed(AXES), strict=True):
        index = scan.shape[::-1][AXES.index(axis)] // 2
        labels = None if grains is None else cut(grains.labels, axis, index)
        image = slice_image(cut(scan.voxels, axis, index), window, labels, colours)
        along, up = [name for name in AXES if name != axis]
        width, height = image.shape[1] * edges[along], image.shape[0] * edges[up]
        axes.imshow(image, extent=(0, width, 0, height), origin="lower", interpolation="nearest")
        axes.set_title(f"slice {index} across {axis}", color=theme.ink, fontsize=11)
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_xlabel(along, color=theme.ink)
        axes.set_ylabel(up, color=theme.ink)
        bar = round_length(0.25 * width)
        right, low = 0.95 * width, 0.05 * height
        # A dark rim keeps bar and words to be seen on bright grains.
        rim = [patheffects.withStroke(linewidth=6.5, foreground="black")]
        axes.plot(
            [right - bar, right],
            [low, low],
            color="white",
            linewidth=4,
            solid_capstyle="butt",
            path_effects=rim,
        )
        axes.text(
            right - bar / 2,
            low + 0.02 * height,
            readable_length(bar, scan.unit),
            color="white",
            ha="center",
            path_effects=[patheffects.withStroke(linewidth=2.5, foreground="black")],
        )
    return drawn(figure)


def convergence_figure(
    fits: Mapping[int, FitResult], most: int = 12, theme: SceneTheme = LIGHT
) -> UInt8[np.ndarray, "h w 3"]:
    """Return :func:`convergence_plot` as pixels."""
    return drawn(convergence_plot(fits, most, theme))


def convergence_plot(fits: Mapping[int, FitResult], most: int = 12, theme: SceneTheme = LIGHT) -> Figure:
    """Draw the loss of some fits against their generations, on a log axis, and the median of several."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.6), dpi=DPI, facecolor="white", layout="constrained")
    axes = figure.subplots()
    longest = max(len(fit.history) for fit in fits.values())
    # A fit that has ended keeps its last loss.
    losses = np.array([np.pad(fit.history, (0, longest - len(fit.history)), "edge") for fit in fits.values()])
    for label in sorted(fits)[:most]:
        axes.plot(fits[label].history, color=theme.grain, linewidth=1, alpha=0.75)
    told = f"median of {len(fits)} grains" if len(fits) > 1 else f"grain {next(iter(fits))}"
    axes.plot(np.median(losses, axis=0), color=theme.avatar, linewidth=2.2, label=told)
    axes.set_yscale("log")
    axes.set_xlabel("Generation of the search")
    axes.set_ylabel("Mean loss")
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure


def drawn(figure: Figure) -> UInt8[np.ndarray, "h w 3"]:
    """Return a matplotlib figure as pixels, without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
