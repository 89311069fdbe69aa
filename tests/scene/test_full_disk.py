"""The disk is full while a picture or a film is written: what was there stays, the message names it."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.imaging.sweep import SweepRow
from mbstudio.scene.figures.sweep_figure import save_sweep_figure
from mbstudio.scene.pictures.animation import animation_file
from mbstudio.scene.pictures.picture_file import write_picture
from tests.full_disk import POSSIBLE, require_nothing_is_lost

pytestmark = [
    pytest.mark.skipif(not POSSIBLE, reason="the size of files is limited as on Linux"),
    # Of libraries that cannot end their files.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def _frames(count: int = 6) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    return [rng.integers(0, 255, (64, 96, 3)).astype(np.uint8) for _ in range(count)]


def _film(path: Path) -> None:
    with animation_file(path) as add:
        for frame in _frames():
            add(frame)


def _figure(path: Path) -> None:
    words = "", {"hull": "mesh"}
    rows = [
        SweepRow(1, "grain 1", n, "fast", 0, 0.1, 0.02, 0.01, 0.9, 0.1, {"csf": 0.01}, True, 2.0, *words)
        for n in (10, 20)
    ]
    save_sweep_figure(path, rows)


@pytest.mark.parametrize("name", ["view.png", "view.bmp", "view.jpg", "view.tif"])
def test_pictures_are_whole_or_as_they_were(tmp_path: Path, name: str) -> None:
    require_nothing_is_lost(tmp_path, name, lambda path: write_picture(path, _frames(1)[0]))


@pytest.mark.parametrize("ending", ["gif", "png", "mp4"])
def test_films_are_whole_or_as_they_were(tmp_path: Path, ending: str) -> None:
    if ending == "mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        pytest.skip("MP4: imageio-ffmpeg is not installed")
    require_nothing_is_lost(tmp_path, f"turn.{ending}", _film)


def test_figures_are_whole_or_as_they_were(tmp_path: Path) -> None:
    require_nothing_is_lost(tmp_path, "sweep.svg", _figure)
