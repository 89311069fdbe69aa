"""The figures of Zhao et al. (2023) that explain metaballs and their imaging, from grains made here.

Figures 2 (a metaball in the plane), 3 (metaballs in space), 5 (loss against the number of control
points) and 6 (avatars at several numbers) of Computers and Geotechnics 161, 105564.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from jaxtyping import Float, UInt8

from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.units import VoxelSize
from mbstudio.scene import camera
from mbstudio.scene.pictures.figures import DPI, drawn
from mbstudio.scene.pictures.picture_file import write_picture
from mbstudio.scene.pictures.pictures import require_picture
from mbstudio.scene.surfaces import Surface, avatar_surface, grain_surface
from mbstudio.scene.theme import LIGHT, SceneTheme

if TYPE_CHECKING:
    from mbstudio.core.imaging import FitResult

Image = UInt8[np.ndarray, "h w 3"]
KINDS = ("cobble", "elongated", "angular", "concave")
_PANEL = 300
_LINES = ("#d99b45", "#2a7fb8", "#a33b76", "#2f8f6b")
_MARKS = ("o", "s", "^", "D")

# A metaball in the plane, as (x, y, k): unequal circles, one side hollow.
_PLANE = np.array(
    [[-1.25, -0.35, 0.30], [-0.45, 0.55, 0.22], [0.5, 0.25, 0.34], [1.35, 0.75, 0.12], [0.95, -0.75, 0.10]]
)
_DISTANCES = (3.6, 2.95, 2.7, 2.0)
_FACTORS = (0.1, 0.5, 1.0, 2.5)


@dataclass(frozen=True)
class FigurePlan:
    """What is drawn.

    Attributes
    ----------
    numbers : tuple of int
        Numbers of control points of figure 5, in rising order.
    shown : tuple of int
        Those of them that figure 6 shows.
    grains : int
        Grains of each kind in figure 5; figure 6 shows the first.
    diameter : float
        Nominal diameter of the grains in voxels, about.
    seed : int
        Of the grains' shapes.
    """

    numbers: tuple[int, ...] = (3, 5, 10, 20, 40, 60, 80, 100)
    shown: tuple[int, ...] = (5, 10, 20, 40, 100)
    grains: int = 2
    diameter: float = 80.0
    seed: int = 2023


def typical_grain(kind: str, diameter: float, seed: int) -> Grain:
    """Return one grain of a kind of the sample scan, as voxels of 10 um."""
    from mbstudio.core.grains.pieces import largest_piece
    from mbstudio.core.scan.phantom_grains import make_grain

    made = make_grain(kind, diameter, np.random.default_rng([seed, KINDS.index(kind)]))
    half = int(np.ceil(made.reach)) + 2
    axis = np.arange(-half, half + 1, dtype=np.float64)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    body = made.body(np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1))
    mask = largest_piece(body.reshape(z.shape) < 0)
    corner = -10.0 * half
    return Grain(mask, VoxelSize(10.0, 10.0, 10.0, "um"), (corner, corner, corner), name=kind)


def render_paper_figures(
    folder: Path,
    plan: FigurePlan | None = None,
    *,
    progress: Callable[[float, str], None] | None = None,
) -> list[Path]:
    """Draw the four figures and write the losses of figure 5 as CSV.

    Parameters
    ----------
    folder : Path
        An existing folder.
    plan : FigurePlan, optional
    progress : callable, optional
        Called with the share done and a message; raising in it cancels.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    BlankPictureError
        If a picture shows nothing.
    """
    plan = plan or FigurePlan()
    report = progress or (lambda _share, _message: None)
    written = []

    def save(name: str, image: Image) -> None:
        require_picture(image, name)
        write_picture(folder / name, image)
        written.append(folder / name)

    report(0.0, "metaballs in the plane and in space")
    save("figure_2_metaball_in_the_plane.png", plane_figure())
    save("figure_3_metaballs_in_space.png", space_figure())
    grains, fits = _fits(plan, lambda share, message: report(0.05 + 0.8 * share, message))
    save("figure_5_loss_against_control_points.png", loss_figure(fits))
    written.append(_write_losses(folder / "figure_5_losses.csv", fits))
    report(0.85, "avatars")
    firsts = {kind: grains[kind, 0] for kind in KINDS}
    avatars = {(kind, n): fits[kind, 0, n].avatar for kind, n in product(KINDS, plan.shown)}
    save("figure_6_avatars.png", avatars_figure(firsts, avatars, plan.shown))
    return written


def _fits(
    plan: FigurePlan, report: Callable[[float, str], None]
) -> tuple[dict[tuple[str, int], Grain], dict[tuple[str, int, int], FitResult]]:
    from mbstudio.core.imaging import fit

    grains: dict[tuple[str, int], Grain] = {}
    fits: dict[tuple[str, int, int], FitResult] = {}
    for done, (kind, index) in enumerate(product(KINDS, range(plan.grains))):
        grain = grains[kind, index] = typical_grain(kind, plan.diameter, plan.seed + index)
        for n in plan.numbers:
            report(
                (done + n / sum(plan.numbers)) / (len(KINDS) * plan.grains), f"{kind} {index + 1}, n = {n}"
            )
            fits[kind, index, n] = fit(grain, n)
    return grains, fits


def plane_figure(theme: SceneTheme = LIGHT) -> Image:
    """Draw figure 2: (a) contour, control points and control circles; (b) the range of values of f."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    avatar = Avatar(np.column_stack([_PLANE[:, :2], np.zeros(len(_PLANE))]), _PLANE[:, 2], "mm")
    x, y = np.linspace(-2.9, 2.9, 480), np.linspace(-2.1, 2.3, 364)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    f = avatar.field(np.column_stack([grid, np.zeros(len(grid))])).reshape(len(y), len(x))
    figure = Figure(figsize=(11, 4.6), dpi=DPI, facecolor="white", layout="constrained")
    left, right = figure.subplots(1, 2)
    for centre, k in zip(_PLANE[:, :2], _PLANE[:, 2], strict=True):
        left.add_patch(Circle(tuple(centre), float(np.sqrt(k)), fill=False, color="black", linewidth=1.2))
    left.contour(x, y, f, levels=[1.0], colors=["#c5342b"], linewidths=2.2)
    left.plot(*_PLANE[:, :2].T, "o", color="black", markersize=4)
    left.set_title("(a) surface f = 1, control points, control circles of radius √k", fontsize=10)
    shown = right.pcolormesh(x, y, np.log10(f), cmap="viridis", vmin=-1, vmax=1.5, rasterized=True)
    right.contour(x, y, f, levels=[1.0], colors=["#c5342b"], linewidths=2.2)
    figure.colorbar(shown, ax=right, label="log₁₀ f    (inside > 0, outside < 0)", extend="both")
    right.set_title("(b) values of f: 1 on the surface", fontsize=10)
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.set_xlim(x[0], x[-1])
        axes.set_ylim(y[0], y[-1])
        axes.set_xlabel("x", color=theme.ink)
        axes.set_ylabel("y", color=theme.ink)
    return drawn(figure)


def space_figure(theme: SceneTheme = LIGHT) -> Image:
    """Draw figure 3: (a) two metaballs that approach each other; (b) one weight from small to large.

    Weights are positive here, so the hollow is made by a small weight, not by a negative one.
    """
    reach = np.array([[-3.0, -1.2, -1.2], [3.0, 1.2, 1.2]])
    near = [
        Avatar(np.array([[-d / 2, 0, 0], [d / 2, 0, 0]]), np.ones(2), "mm", name=f"distance {d:g} mm")
        for d in _DISTANCES
    ]
    angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    weights = [np.where(np.arange(6) == 4, 0.22 * factor, 0.22) for factor in _FACTORS]
    body = np.vstack([ring, [[0, 0, 0]]])
    grown = [
        Avatar(body, np.append(k, 0.25), "mm", name=f"{factor:g} k")
        for k, factor in zip(weights, _FACTORS, strict=True)
    ]
    box = np.array([[-1.9, -2.4, -0.9], [1.9, 1.9, 0.9]])
    rows = [
        [_panel([(avatar_surface(a), theme.avatar)], reach, "front", a.name) for a in near],
        [_panel([(avatar_surface(a), theme.avatar)], box, "top", a.name) for a in grown],
    ]
    return _sheet(
        rows,
        columns=None,
        titles=[[a.name for a in near], [a.name for a in grown]],
        rows_named=["(a) two metaballs\napproaching", "(b) one weight k\nof seven changed"],
    )


def loss_figure(fits: Mapping[tuple[str, int, int], FitResult]) -> Image:
    """Draw figure 5: log10 of the last mean loss against n, mean and range over the grains of a kind."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 5), dpi=DPI, facecolor="white", layout="constrained")
    axes = figure.subplots()
    for kind, colour, mark in zip(KINDS, _LINES, _MARKS, strict=True):
        numbers, losses = _losses_of(kind, fits)
        axes.fill_between(
            numbers, losses.min(axis=0), losses.max(axis=0), color=colour, alpha=0.15, linewidth=0
        )
        axes.plot(numbers, losses.mean(axis=0), color=colour, marker=mark, label=kind, linewidth=1.8)
    axes.set_xlabel("Number of control points n")
    axes.set_ylabel("log₁₀ of the mean loss after the search")
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return drawn(figure)


def _losses_of(
    kind: str, fits: Mapping[tuple[str, int, int], FitResult]
) -> tuple[list[int], Float[np.ndarray, "grains numbers"]]:
    numbers = sorted({n for which, _, n in fits if which == kind})
    indices = sorted({index for which, index, _ in fits if which == kind})
    return numbers, np.log10([[fits[kind, index, n].history[-1] for n in numbers] for index in indices])


def _write_losses(path: Path, fits: Mapping[tuple[str, int, int], FitResult]) -> Path:
    from mbstudio.core.replacement import replacing

    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["kind", "grain", "n", "mean_loss", "rms_um", "volume_error", "valid"])
        for (kind, index, n), result in fits.items():
            verdict = result.verdict
            writer.writerow(
                [kind, index + 1, n, result.history[-1], verdict.rms, verdict.volume_error, verdict.valid]
            )
    return path


def avatars_figure(
    grains: Mapping[str, Grain],
    avatars: Mapping[tuple[str, int], Avatar],
    numbers: Sequence[int],
    theme: SceneTheme = LIGHT,
) -> Image:
    """Draw figure 6: each grain and its avatars at several numbers of control points, from one camera."""
    rows = []
    for kind, grain in grains.items():
        surface = grain_surface(grain)
        box = np.array([surface.points.min(axis=0), surface.points.max(axis=0)], dtype=np.float64)
        row = [_panel([(surface, theme.grain)], box, "isometric", kind)]
        for n in numbers:
            shown = [(avatar_surface(avatars[kind, n]), theme.avatar)]
            row.append(_panel(shown, box, "isometric", f"{kind}, n = {n}"))
        rows.append(row)
    return _sheet(
        rows, columns=["grain", *(f"n = {n}" for n in numbers)], titles=None, rows_named=list(grains)
    )


def _panel(
    surfaces: Sequence[tuple[Surface, str]], box: Float[np.ndarray, "2 3"], view: camera.View, name: str
) -> Image:
    """Render surfaces on white so that the box fills the picture."""
    plotter: Any = pv.Plotter(off_screen=True, window_size=[_PANEL, _PANEL], lighting="light kit")
    try:
        plotter.set_background("white")
        for surface, colour in surfaces:
            plotter.add_mesh(
                surface.poly_data(), color=colour, smooth_shading=True, specular=0.25, specular_power=20
            )
        renderer = plotter.renderer
        renderer.camera.SetParallelProjection(True)
        renderer.camera_set = True
        camera.turn(renderer, view)
        corners = np.array(list(product(*box.T)))
        camera.fit(renderer, corners)
        plotter.render()
        image = np.asarray(plotter.screenshot(return_img=True))[..., :3].copy()
    finally:
        plotter.close()
    require_picture(image, name)
    return image


def _sheet(
    rows: Sequence[Sequence[Image]],
    *,
    columns: Sequence[str] | None,
    titles: Sequence[Sequence[str]] | None,
    rows_named: Sequence[str],
) -> Image:
    """Lay panels out in rows, with a name before each row and above the columns or panels."""
    from matplotlib.figure import Figure

    width, height = len(rows[0]), len(rows)
    figure = Figure(figsize=(2.2 * width, 2.35 * height), dpi=DPI, facecolor="white", layout="constrained")
    places = figure.subplots(height, width, squeeze=False)
    for r, row in enumerate(rows):
        for c, image in enumerate(row):
            axes = places[r, c]
            axes.imshow(image)
            axes.set_xticks([])
            axes.set_yticks([])
            axes.spines[:].set_visible(False)
            if titles is not None:
                axes.set_title(titles[r][c], fontsize=10)
            elif columns is not None and r == 0:
                axes.set_title(columns[c], fontsize=11)
        places[r, 0].set_ylabel(rows_named[r], fontsize=11)
    return drawn(figure)
