"""Animations as files: frames come back, nothing half done stays, and what is missing is said."""

from __future__ import annotations

import re
import subprocess

import imageio.v3 as imageio
import numpy as np
import pytest

from mbstudio.scene.pictures.animation import AnimationError, animation_file, require_writer


def frames(count=5, size=(20, 30)):
    """Return frames of one colour each, far apart."""
    return [np.full((*size, 3), 40 * number + 20, np.uint8) for number in range(count)]


def test_a_gif_has_the_frames_that_were_added(tmp_path):
    with animation_file(tmp_path / "turn.gif", seconds=0.08) as add:
        for frame in frames():
            add(frame)
    read = imageio.imread(tmp_path / "turn.gif", index=None)
    assert read.shape[:3] == (5, 20, 30)
    for number, frame in enumerate(frames()):
        assert abs(int(read[number, 10, 15, 0]) - int(frame[0, 0, 0])) <= 3
    assert imageio.immeta(tmp_path / "turn.gif", index=0)["duration"] == 80


def test_a_film_has_the_frames_that_were_added(tmp_path):
    """Colours are compressed, and sides are even."""
    films = pytest.importorskip("imageio_ffmpeg", reason="MP4: imageio-ffmpeg is not installed")
    with animation_file(tmp_path / "turn.mp4", seconds=0.1) as add:
        for frame in frames(5, (65, 97)):
            add(frame)
    assert [path.name for path in tmp_path.iterdir()] == ["turn.mp4"]
    command = [
        films.get_ffmpeg_exe(),
        "-i",
        tmp_path / "turn.mp4",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    ]
    run = subprocess.run(command, capture_output=True, check=True)
    assert re.search(r"Video: h264.* 96x64\b.*, 10 fps", run.stderr.decode())
    read = np.frombuffer(run.stdout, np.uint8).reshape(5, 64, 96, 3)
    for number, frame in enumerate(frames()):
        assert abs(int(read[number, 30, 40, 0]) - int(frame[0, 0, 0])) <= 6


def test_a_sequence_has_a_picture_for_each_frame(tmp_path):
    with animation_file(tmp_path / "turn.png") as add:
        for frame in frames(3):
            add(frame)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["turn_000.png", "turn_001.png", "turn_002.png"]
    assert (imageio.imread(tmp_path / "turn_002.png") == frames(3)[2]).all()


@pytest.mark.parametrize("ending", ["gif", "png"])
def test_nothing_half_done_is_left(tmp_path, ending):
    def fail():
        with animation_file(tmp_path / f"turn.{ending}") as add:
            add(frames()[0])
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "no" / "turn.gif"
    with pytest.raises(AnimationError, match="choose another folder"), animation_file(path) as add:
        add(frames()[0])


def test_what_cannot_be_written_is_said(tmp_path, monkeypatch):
    with pytest.raises(AnimationError, match=r"use \.gif or \.png or \.mp4"):
        require_writer(tmp_path / "turn.avi")
    monkeypatch.setattr("mbstudio.scene.pictures.animation.find_spec", lambda name: None)
    with pytest.raises(AnimationError, match=r"imageio-ffmpeg.*save as \.gif"):
        require_writer(tmp_path / "turn.mp4")
