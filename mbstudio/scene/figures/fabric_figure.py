"""The figure of a fabric: where contacts point (Lambert, 3-D rose), how many a grain has, the tensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.twin.fabric import Fabric, FabricTensor
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.core.twin.rose import from_lambert, lambert, rose_density
from mbstudio.scene.figures.population_style import plain_axes
from mbstudio.scene.pictures.figures import DPI
from mbstudio.scene.theme import LIGHT, SceneTheme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CELLS = 121
_ROUND, _UP = 60, 31
_TITLES = ("(a) Normals, Lambert's projection along z", "(b) Rose of the normals", "(c) Coordination")
_SHORT = ("Normals, along z", "Rose", "Coordination")


def fabric_figure(twin: KeptTwin, theme: SceneTheme = LIGHT, *, is_small: bool = False) -> Figure:
    """Draw the fabric of a twin's contacts.

    Parameters
    ----------
    twin : KeptTwin
    theme : SceneTheme
        Whose colours it has.
    is_small : bool
        For a narrow place: without the tensors (see :func:`words_of_fabric`).

    Raises
    ------
    TwinError
        If no pair of grains is a contact.
    """
    from matplotlib.figure import Figure

    fabric = twin.fabric()
    normals = twin.touching[["nx", "ny", "nz"]].to_numpy(float)
    size = (4.6, 4.0) if is_small else (9.0, 7.8)
    figure = Figure(figsize=size, dpi=DPI, facecolor=theme.top, layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.15, 0.75 if is_small else 1.0))
    words = _SHORT if is_small else _TITLES
    _draw_lambert(figure, figure.add_subplot(grid[0, 0]), normals, theme, words[0])
    _draw_rose(figure.add_subplot(grid[0, 1], projection="3d"), normals, theme, words[1])
    place = grid[1, :] if is_small else grid[1, 0]
    _draw_coordination(figure.add_subplot(place), fabric, twin, theme, words[2])
    if not is_small:
        _draw_tensors(figure.add_subplot(grid[1, 1]), fabric, theme)
    return figure


def words_of_fabric(fabric: Fabric) -> str:
    """Return the fabric tensors with their intervals as lines of plain text, to be read in even columns."""
    lines = [*_rows_of("Normals", fabric.normal), "", *_rows_of("Branches", fabric.branch)]
    if fabric.long_axis is not None:
        lines += ["", *_rows_of("Long axes of grains", fabric.long_axis)]
    return "\n".join(lines)


def _title(axes: Any, words: str, theme: SceneTheme) -> None:
    axes.set_title(words, fontsize=10.5, loc="left", color=theme.ink)


def _draw_lambert(figure: Figure, axes: Axes, normals: np.ndarray, theme: SceneTheme, title: str) -> None:
    ticks = np.linspace(-1, 1, _CELLS)
    x, y = np.meshgrid(ticks, ticks)
    inside = x**2 + y**2 <= 1.0
    density = np.full(x.shape, np.nan)
    density[inside] = rose_density(normals, from_lambert(np.column_stack((x[inside], y[inside]))))
    shown = axes.imshow(
        density, extent=(-1, 1, -1, 1), origin="lower", cmap="viridis", interpolation="bilinear", vmin=0.0
    )
    places = lambert(normals)
    axes.plot(*places.T, ".", color="white", markersize=2.5, alpha=0.7)
    turns = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(turns), np.sin(turns), color=theme.ink, linewidth=1)
    for words, across, up in (("x", 1.09, 0.0), ("y", 0.0, 1.09)):
        axes.text(across, up, words, ha="center", va="center", color=theme.ink, fontsize=9)
    axes.set_xlim(-1.18, 1.18)
    axes.set_ylim(-1.18, 1.18)
    axes.set_aspect("equal")
    axes.axis("off")
    bar = figure.colorbar(shown, ax=axes, shrink=0.72, pad=0.02)
    bar.ax.tick_params(colors=theme.ink, labelsize=8)
    bar.set_label("over even", color=theme.ink, fontsize=8.5)
    _title(axes, title, theme)


def _draw_rose(axes: Any, normals: np.ndarray, theme: SceneTheme, title: str) -> None:
    from matplotlib import colormaps

    turn, up = np.meshgrid(np.linspace(0, 2 * np.pi, _ROUND + 1), np.linspace(0, np.pi, _UP))
    sphere = np.stack((np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), np.cos(up)), axis=-1)
    density = rose_density(normals, sphere.reshape(-1, 3)).reshape(up.shape)
    most = float(density.max())
    middle = 0.25 * (density[1:, 1:] + density[:-1, 1:] + density[1:, :-1] + density[:-1, :-1])
    axes.plot_surface(
        *np.moveaxis(sphere * density[..., None], -1, 0), facecolors=colormaps["viridis"](middle / most),
        rcount=_UP, ccount=_ROUND, linewidth=0, antialiased=False, shade=True,
    )  # fmt: skip
    for set_limit in (axes.set_xlim, axes.set_ylim, axes.set_zlim):
        set_limit(-most, most)
    axes.set_box_aspect((1, 1, 1))
    axes.set_facecolor("none")
    for name, label in (("x", axes.set_xlabel), ("y", axes.set_ylabel), ("z", axes.set_zlabel)):
        label(name, color=theme.ink, fontsize=9, labelpad=-8)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.5, 0.5, 0.5, 0.06))
        axis.set_ticklabels([])
        axis.line.set_color(theme.muted)
    _title(axes, title, theme)


def _draw_coordination(axes: Axes, fabric: Fabric, twin: KeptTwin, theme: SceneTheme, title: str) -> None:
    whole = [count for label, count in fabric.coordination.items() if label not in twin.cut]
    counts = np.bincount(whole or [0])
    axes.bar(np.arange(len(counts)), counts, color=theme.avatar, width=0.82)
    plain_axes(axes, theme)
    axes.set_facecolor("none")
    axes.set_xlabel("Contacts of a grain", color=theme.ink, fontsize=9)
    axes.set_ylabel("Grains", color=theme.ink, fontsize=9)
    mean = fabric.mean_coordination
    told = "no grain is whole" if np.isnan(mean) else f"mean {mean:.2f} of {len(whole)} whole grains"
    _title(axes, f"{title}: {told}", theme)


def _rows_of(name: str, tensor: FabricTensor) -> list[str]:
    low, high = tensor.anisotropy_interval
    lines = [f"{name}  (n = {tensor.count}; xx yy zz xy xz yz)"]
    cells = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    for some in (cells[:3], cells[3:]):
        lines.append(
            "   ".join(
                f"{tensor.tensor[cell]:+.3f} ± {tensor.half_width[cell]:.3f}".replace("-", "\N{MINUS SIGN}")
                for cell in some
            )
        )
    return [*lines, f"anisotropy {tensor.anisotropy:.2f}  [{low:.2f}, {high:.2f}]"]


def _draw_tensors(axes: Axes, fabric: Fabric, theme: SceneTheme) -> None:
    axes.axis("off")
    axes.text(
        0.0, 0.96, words_of_fabric(fabric), transform=axes.transAxes, va="top", family="monospace",
        fontsize=7.2, color=theme.ink, linespacing=1.45,
    )  # fmt: skip
    _title(axes, "(d) Fabric tensors, 95 % by drawing again", theme)
