"""Animations as files: GIF, MP4 where ffmpeg is there, or a picture for each frame."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from mbstudio.core.errors import MbstudioError
from mbstudio.core.replacement import flush_folder, flush_to_disk, name_beside, remove_leftovers

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

    names: list[str] = []
    with _workplace(path) as folder:

        def add(frame: UInt8[np.ndarray, "h w 3"]) -> None:
            names.append(f"{path.stem}_{len(names):03d}.png")
            (folder / names[-1]).write_bytes(imageio.imwrite("<bytes>", frame, extension=".png"))

        yield add
        _put_in_place(path, folder, names)


@contextmanager
def _film(path: Path, seconds: float) -> Iterator[Callable[[UInt8[np.ndarray, "h w 3"]], None]]:
    import imageio.v2 as imageio

    options: dict[str, Any] = {"duration": 1000 * seconds, "loop": 0}
    if path.suffix.lower() == ".mp4":
        options = {"fps": 1 / seconds, "macro_block_size": 2}
    count = 0
    with _workplace(path) as folder:
        with imageio.get_writer(folder / path.name, **options) as opened:
            writer: Any = opened

            def add(frame: UInt8[np.ndarray, "h w 3"]) -> None:
                nonlocal count
                height, width = (side // 2 * 2 for side in frame.shape[:2])  # MP4 takes even sides only
                writer.append_data(np.ascontiguousarray(frame[:height, :width]))
                count += 1

            yield add
        if path.suffix.lower() == ".mp4":
            _require_frames(folder / path.name, count)
        _put_in_place(path, folder, [path.name])


@contextmanager
def _workplace(path: Path) -> Iterator[Path]:
    """Give a folder beside an animation: nothing half done is ever in its place, nor is it left behind."""
    folder = path.resolve().parent
    remove_leftovers(folder)
    workplace = name_beside(folder / path.name)
    workplace.mkdir()
    try:
        yield workplace
    finally:
        shutil.rmtree(workplace, ignore_errors=True)


def _put_in_place(path: Path, workplace: Path, names: list[str]) -> None:
    """Move files to their places, once all of them lie on the disk."""
    folder = path.resolve().parent
    for name in names:
        if (folder / name).is_dir():
            raise IsADirectoryError(f"{folder / name} is a folder")
        flush_to_disk(workplace / name)
    for name in names:
        (workplace / name).replace((folder / name).resolve())
    flush_folder(folder)


def _require_frames(film: Path, count: int) -> None:
    """Raise OSError unless a film is whole, with all frames: ffmpeg does not say why it has ended."""
    import imageio.v2 as imageio

    _require_whole_boxes(film)

    try:
        with imageio.get_reader(film) as opened:
            reader: Any = opened
            found = reader.count_frames()
    except (OSError, RuntimeError, ValueError, IndexError):
        found = 0
    if found != count:
        raise OSError(f"only {found} of {count} frames could be written: is the disk full?")


def _require_whole_boxes(film: Path) -> None:
    """Raise OSError unless the last of the boxes that an MP4 consists of ends with the file."""
    length, place = film.stat().st_size if film.exists() else 0, 0
    with film.open("rb") as stream:
        while place < length:
            stream.seek(place)
            head = stream.read(16)
            size = int.from_bytes(head[:4], "big")
            if size == 1:  # the length follows in eight bytes
                size = int.from_bytes(head[8:16], "big")
            place = place + size if size >= 8 else length + 1
    if not length or place != length:
        raise OSError(f"{film.name} is cut off: is the disk full?")
