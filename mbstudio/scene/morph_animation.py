"""The way from one grain to another as an animation, drawn by rays: any thread may write it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from mbstudio.core.errors import MbstudioError
from mbstudio.core.vae.latent import morphed
from mbstudio.core.vae.style_learner import StyleLearner
from mbstudio.scene.theme import SceneTheme, rgb
from mbstudio.scene.thumbnails import seen_reach, thumbnail

ENDINGS = (".gif", ".png", ".mp4")
_SECONDS = 0.06
_REST = 8
"""Frames for which each end stands still."""


class AnimationError(MbstudioError):
    """An animation that cannot be written."""


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
        films: ``morph.png`` becomes ``morph_01.png`` and so on.
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
        The file, the last one of numbered pictures.

    Raises
    ------
    AnimationError
        If the ending is another, or nothing here can write it.
    """
    require_writer(path)
    avatars = learner.decode(morphed(learner, first, second, steps)).avatars()
    reach = max(seen_reach(avatar) for avatar in avatars)
    frames = []
    for place, avatar in enumerate(avatars):
        frames.append(_over(thumbnail(avatar, theme.avatar, side, reach), theme))
        if progress is not None:
            progress(0.95 * (place + 1) / len(avatars), f"frame {place + 1} of {len(avatars)}")
    if path.suffix.lower() == ".png":
        return _write_pictures(path, frames)
    there = [frames[0]] * _REST + frames[1:-1] + [frames[-1]] * _REST + frames[-2:0:-1]
    _write(path, np.stack(there))
    return path


def require_writer(path: Path) -> None:
    """Raise AnimationError unless an animation of this ending can be written here."""
    if path.suffix.lower() not in ENDINGS:
        raise AnimationError(f"{path.name} has no ending of an animation: use {' or '.join(ENDINGS)}.")
    if path.suffix.lower() == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise AnimationError(
            f"{path.name} cannot be written: MP4 needs the package imageio-ffmpeg, which is not installed "
            "here. Install it (pip install mbstudio[mp4]), or save as .gif, or as .png for numbered pictures."
        )


def _over(picture: UInt8[np.ndarray, "h w 4"], theme: SceneTheme) -> UInt8[np.ndarray, "h w 3"]:
    """Lay a picture over the background of the scene."""
    share = np.linspace(0.0, 1.0, len(picture))[:, None, None]
    ground = (1 - share) * np.array(rgb(theme.top)) + share * np.array(rgb(theme.bottom))
    cover = picture[..., 3:] / 255.0
    return np.asarray(np.round(cover * picture[..., :3] + (1 - cover) * ground), dtype=np.uint8)


def _write_pictures(path: Path, frames: Sequence[UInt8[np.ndarray, "h w 3"]]) -> Path:
    import imageio.v2 as imageio

    digits, last = len(str(len(frames))), path
    try:
        for number, frame in enumerate(frames, 1):
            last = path.with_name(f"{path.stem}_{number:0{digits}d}{path.suffix}")
            imageio.imwrite(last, frame)
    except OSError as error:
        raise AnimationError(f"{path} cannot be written ({error}): choose another folder.") from error
    return last


def _write(path: Path, frames: UInt8[np.ndarray, "frames h w 3"]) -> None:
    import imageio.v2 as imageio

    # Beside its place and then renamed: no half an animation is left behind.
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        if path.suffix.lower() == ".gif":
            imageio.mimwrite(part, list(frames), duration=1000 * _SECONDS, loop=0)  # type: ignore[arg-type]
        else:
            imageio.mimwrite(part, list(frames), fps=1 / _SECONDS)  # type: ignore[arg-type]
        part.replace(path)
    except OSError as error:
        raise AnimationError(f"{path} cannot be written ({error}): choose another folder.") from error
    finally:
        part.unlink(missing_ok=True)
