"""Pictures of a project as files: for reports, and for machines without a display."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv
from jaxtyping import UInt8
from PIL import Image

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
        if grains is not None:
            drawn.append(
                ("grain_and_avatar", lambda scene: show_pair(scene, project, typical_label(project)))
            )
    return [_render(folder / f"{name}.png", draw) for name, draw in drawn]


def typical_label(project: Project) -> int:
    """Return the fitted grain whose avatar is about as true as half of them are."""
    by_rms = sorted(project.fits, key=lambda label: project.fits[label].verdict.rms)
    return by_rms[len(by_rms) // 2]


def show_pair(scene: Scene, project: Project, label: int) -> None:
    """Show one grain, translucent, over its avatar and its control points."""
    assert project.grains is not None
    grain, avatar = project.grains.grain(label), project.fits[label].avatar
    scene.set_grain(grain_surface(grain), grain.unit)
    scene.set_avatar(avatar_surface(avatar), avatar.unit)
    scene.set_points(control_points(avatar))


def _render(path: Path, draw: Callable[[Scene], None]) -> Path:
    plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
    try:
        scene = Scene(plotter)
        draw(scene)
        scene.look_from("isometric")
        image = scene.screenshot()
    finally:
        plotter.close()
    require_picture(image, path.name)
    Image.fromarray(image).save(path)
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
