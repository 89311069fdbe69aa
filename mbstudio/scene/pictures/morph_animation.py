"""The way from one grain to another as an animation, drawn by rays: any thread may write it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.shaping.latent import morph
from mbstudio.scene.pictures.animation import animation_file, require_writer
from mbstudio.scene.pictures.thumbnails import pictured_reach, thumbnail
from mbstudio.scene.theme import SceneTheme, rgb

_REST = 8
"""Frames for which each end stands still."""


def write_morph(
    learner: StyleLearner,
    first: Float[np.ndarray, " d"],
    second: Float[np.ndarray, " d"],
    path: Path,
    theme: SceneTheme,
    *,
    steps: int = 30,
    side: int = 320,
    progress: Callable[[float, str], object] | None = None,
) -> Path:
    """Write the way from one grain to another and back, each step an equal change of the surface.

    Parameters
    ----------
    learner : StyleLearner
    first, second : float array, shape (d,)
    path : Path
        Ending in .gif or .mp4; or in .png for a numbered picture of each step, for any program that makes
        films: ``morph.png`` becomes ``morph_000.png`` and so on.
    theme : SceneTheme
    steps : int
        Grains on the way, ends included.
    side : int
        Pixels; even for .mp4.
    progress : callable, optional
        Told the share done and what is done; what it raises ends the work.

    Returns
    -------
    Path
        As it was given.

    Raises
    ------
    AnimationError
        If the ending is another, or nothing here can write it.
    """
    require_writer(path)
    avatars = learner.decode(morph(learner, first, second, steps)).avatars()
    reach = max(pictured_reach(avatar) for avatar in avatars)
    frames = []
    for place, avatar in enumerate(avatars):
        frames.append(_blend_over(thumbnail(avatar, theme.avatar, side, reach), theme))
        if progress is not None:
            progress(0.95 * (place + 1) / len(avatars), f"frame {place + 1} of {len(avatars)}")
    there = frames
    if path.suffix.lower() != ".png":
        there = [frames[0]] * _REST + frames[1:-1] + [frames[-1]] * _REST + frames[-2:0:-1]
    with animation_file(path) as add:
        for frame in there:
            add(frame)
    return path


def _blend_over(picture: UInt8[np.ndarray, "h w 4"], theme: SceneTheme) -> UInt8[np.ndarray, "h w 3"]:
    """Lay a picture over the background of the scene."""
    share = np.linspace(0.0, 1.0, len(picture))[:, None, None]
    ground = (1 - share) * np.array(rgb(theme.top)) + share * np.array(rgb(theme.bottom))
    cover = picture[..., 3:] / 255.0
    return np.asarray(np.round(cover * picture[..., :3] + (1 - cover) * ground), dtype=np.uint8)
