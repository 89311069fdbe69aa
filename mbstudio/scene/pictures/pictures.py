"""Pictures of a project as files: for reports, and for machines without a display."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv
from jaxtyping import UInt8

from mbstudio.core.errors import MbstudioError
from mbstudio.scene.grain_surfaces import overview_of_grains, surface_of_grain
from mbstudio.scene.pictures.figures import convergence_figure, slices_figure
from mbstudio.scene.pictures.picture_file import write_picture
from mbstudio.scene.scene import Scene
from mbstudio.scene.surfaces import (
    avatar_surface,
    avatars_surface,
    control_points,
)

if TYPE_CHECKING:
    from mbstudio.core.project import Project

SIZE = (1280, 960)
# A plain background with its gradient has some hundred colours and hardly any contrast.
LEAST_CONTRAST = 3.0


class BlankPictureError(MbstudioError):
    """A picture that shows nothing: the machine's OpenGL does not work."""


def render_tour(project: Project, folder: Path) -> list[Path]:
    """Render what a project holds, each station as its own picture.

    Parameters
    ----------
    project : Project
    folder : Path
        An existing folder for the PNG files.

    Returns
    -------
    list of Path
        The pictures written, none of them blank.

    Raises
    ------
    BlankPictureError
        If a picture shows nothing.
    """
    drawn: list[tuple[str, Callable[[Scene], None]]] = []
    scan, grains = project.scan, project.grains
    if scan is not None:
        drawn.append(("scan", lambda scene: scene.set_scan(scan)))
    if grains is not None:
        overview = overview_of_grains(grains, 200, 500_000)
        drawn.append(("grains", lambda scene: scene.layers.grains.set(overview, grains.unit)))
    if project.fits:
        avatars = project.avatars
        surface, unit = avatars_surface(avatars), avatars[0].unit
        drawn.append(("avatars", lambda scene: scene.layers.avatars.set(surface, unit)))
    written = [_save(folder / f"{name}.png", _render(draw)) for name, draw in drawn]
    if scan is not None:
        outlined = grains if grains is not None and grains.labels.shape == scan.shape else None
        written.append(_save(folder / "slices.png", slices_figure(scan, outlined)))
    if project.fits:
        written.append(_save(folder / "convergence.png", convergence_figure(project.fits)))
    if project.fits and grains is not None:
        rows = [render_grain_and_avatar(project, label) for label in pick_typical_labels(project)]
        written.append(_save(folder / "grain_and_avatar.png", np.concatenate(rows)))
    return written


def pick_typical_labels(project: Project, most: int = 3) -> list[int]:
    """Return fitted grains whose avatars are the truest for their size, the typical, and the least true."""
    assert project.grains is not None
    diameters = {label: project.grains.grain(label).nominal_diameter for label in project.fits}
    by_rms = sorted(project.fits, key=lambda label: project.fits[label].verdict.rms / diameters[label])
    places = np.unique(np.linspace(0, len(by_rms) - 1, min(most, len(by_rms))).round().astype(int))
    return [by_rms[place] for place in places]


def render_grain_and_avatar(
    project: Project, label: int, size: tuple[int, int] = (640, 560)
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a grain, its avatar with the control points shining through, and both, from one camera."""
    assert project.grains is not None
    avatar = project.fits[label].avatar
    plotter = pv.Plotter(off_screen=True, window_size=list(size))
    shown: list[tuple[set[str], dict[str, float]]] = [
        ({"grain"}, {"grain": 1.0}),
        ({"avatar", "points"}, {"avatar": 0.5}),
        ({"grain", "avatar"}, {"grain": 0.6, "avatar": 1.0}),
    ]
    images = []
    try:
        scene = Scene(plotter)
        scene.layers.grain.set(surface_of_grain(project.grains, label), project.grains.unit)
        scene.layers.avatar.set(avatar_surface(avatar), avatar.unit)
        scene.layers.points.set(control_points(avatar))
        scene.look_from("isometric")
        for layers, opacities in shown:
            scene.show_layers(layers)
            for layer, opacity in opacities.items():
                scene.layers[layer].set_opacity(opacity)
            images.append(scene.screenshot())
            require_picture(images[-1], f"grain {label}")
    finally:
        plotter.close()
    return np.concatenate(images, axis=1)


def _render(draw: Callable[[Scene], None], size: tuple[int, int] = SIZE) -> UInt8[np.ndarray, "h w 3"]:
    plotter = pv.Plotter(off_screen=True, window_size=list(size))
    try:
        scene = Scene(plotter)
        draw(scene)
        scene.look_from("isometric")
        return scene.screenshot()
    finally:
        plotter.close()


def _save(path: Path, image: UInt8[np.ndarray, "h w 3"]) -> Path:
    require_picture(image, path.name)
    write_picture(path, image)
    return path


def require_picture(image: UInt8[np.ndarray, "h w 3"], name: str) -> None:
    """Raise BlankPictureError unless a picture shows something.

    A machine whose OpenGL is broken often renders nothing and reports no error.
    """
    rows = np.asarray(image, dtype=float)
    # The background is a gradient from top to bottom: contrast within the rows is what is drawn.
    contrast = float(rows.std(axis=1).max())
    if contrast < LEAST_CONTRAST:
        raise BlankPictureError(
            f"The picture {name} came out blank (contrast {contrast:.2f}): OpenGL does not work here. "
            "See what 'mbstudio doctor' says."
        )
