"""Pictures of a project as files: for reports, and for machines without a display."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import imageio.v3 as imageio
import numpy as np
import pyvista as pv
from jaxtyping import UInt8

from mbstudio.core.errors import MbstudioError
from mbstudio.scene.scene import Scene
from mbstudio.scene.surfaces import (
    avatar_surface,
    avatars_surface,
    control_points,
    grain_surface,
    label_surface,
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
        drawn.append(("grains", lambda scene: scene.set_grains(label_surface(grains), grains.unit)))
    if project.fits:
        avatars = project.avatars
        drawn.append(("avatars", lambda scene: scene.set_avatars(avatars_surface(avatars), avatars[0].unit)))
    written = [_save(folder / f"{name}.png", _render(draw)) for name, draw in drawn]
    if project.fits and grains is not None:
        written.append(_save(folder / "grain_and_avatar.png", render_pair(project, typical_label(project))))
    return written


def typical_label(project: Project) -> int:
    """Return the fitted grain whose avatar is about as true, for its size, as half of them are."""
    assert project.grains is not None
    diameters = {label: project.grains.grain(label).nominal_diameter for label in project.fits}
    by_rms = sorted(project.fits, key=lambda label: project.fits[label].verdict.rms / diameters[label])
    return by_rms[len(by_rms) // 2]


def render_pair(project: Project, label: int) -> UInt8[np.ndarray, "h w 3"]:
    """Return a grain, and beside it its avatar with the control points shining through."""
    assert project.grains is not None
    grain, avatar = project.grains.grain(label), project.fits[label].avatar

    def draw_grain(scene: Scene) -> None:
        scene.set_grain(grain_surface(grain), grain.unit)
        scene.set_opacity("grain", 1.0)

    def draw_avatar(scene: Scene) -> None:
        scene.set_avatar(avatar_surface(avatar), avatar.unit)
        scene.set_points(control_points(avatar))
        scene.set_opacity("avatar", 0.5)

    half = (SIZE[0] // 2, SIZE[1])
    pair = [_render(draw, half) for draw in (draw_grain, draw_avatar)]
    for image, name in zip(pair, ("grain", "avatar"), strict=True):
        require_picture(image, name)
    return np.concatenate(pair, axis=1)


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
    imageio.imwrite(path, image)
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
