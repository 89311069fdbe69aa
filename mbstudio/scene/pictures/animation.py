"""Animations as files: GIF, MP4 where ffmpeg is there, or a picture for each frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from mbstudio.core.errors import MbstudioError

ENDINGS = (".gif", ".png", ".mp4")
SECONDS = 0.06
"""For which a frame stands, by default."""


class AnimationError(MbstudioError):
    """An animation that cannot be written."""


def require_writer(path: Path) -> None:
    """Raise AnimationError unless an animation of this ending can be written here."""
    if path.suffix.lower() not in ENDINGS:
        raise AnimationError(
            f"{path.name} does not have the ending of an animation: use {' or '.join(ENDINGS)}."
        )
    if path.suffix.lower() == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise AnimationError(
            f"{path.name} cannot be written: MP4 needs the package imageio-ffmpeg, which is not installed "
            "here. Install it (pip install mbstudio[mp4]), or save as .gif, or as .png for numbered pictures."
        )


@contextmanager
def animation_file(
    path: Path, seconds: float = SECONDS
) -> Iterator[Callable[[UInt8[np.ndarray, "h w 3"]], None]]:
    """Write frames as they come; what is yielded takes the next one.

    Parameters
    ----------
    path : Path
        Ending in .gif, .mp4, or .png: then ``turn.png`` becomes ``turn_000.png``, ``turn_001.png`` ...
    seconds : float
        For which each frame stands.

    Raises
    ------
    AnimationError
        If nothing here can write it, or not there. Nothing half done is left behind.
    """
    require_writer(path)
    try:
        with _sequence(path) if path.suffix.lower() == ".png" else _film(path, seconds) as add:
            yield add
    except OSError as error:
        raise AnimationError(f"{path} cannot be written ({error}): choose another folder.") from error


@contextmanager
def _sequence(path: Path) -> Iterator[Callable[[UInt8[np.ndarray, "h w 3"]], None]]:
    import imageio.v3 as imageio

    written: list[tuple[Path, Path]] = []

    def add(frame: UInt8[np.ndarray, "h w 3"]) -> None:
        name = f"{path.stem}_{len(written):03d}.png"
        written.append((path.with_name(f".{name}.part"), path.with_name(name)))
        imageio.imwrite(written[-1][0], frame, extension=".png")

    try:
        yield add
        for part, whole in written:
            part.replace(whole)
    finally:
        for part, _ in written:
            part.unlink(missing_ok=True)


@contextmanager
def _film(path: Path, seconds: float) -> Iterator[Callable[[UInt8[np.ndarray, "h w 3"]], None]]:
    import imageio.v2 as imageio

    # Beside its place and then renamed: no half an animation is left behind.
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    options: dict[str, Any] = {"duration": 1000 * seconds, "loop": 0}
    if path.suffix.lower() == ".mp4":
        options = {"fps": 1 / seconds, "macro_block_size": 2}

    try:
        with imageio.get_writer(part, **options) as opened:
            writer: Any = opened

            def add(frame: UInt8[np.ndarray, "h w 3"]) -> None:
                height, width = (side // 2 * 2 for side in frame.shape[:2])  # MP4 takes even sides only
                writer.append_data(np.ascontiguousarray(frame[:height, :width]))

            yield add
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
