"""The view as a picture in the clipboard and in files, and turning once around."""

from __future__ import annotations

import imageio.v3 as imageio
import numpy as np
import pytest
from PySide6.QtGui import QGuiApplication

from mbstudio.scene import camera


@pytest.fixture
def looking(with_grains, idle):
    with_grains.enter("grains")
    with_grains.view.look_from("front")
    idle()
    return with_grains


def covered(picture):
    """Return which pixels differ from the background at the left end of their row."""
    return np.abs(picture.astype(int) - picture[:, :1].astype(int)).max(axis=2) > 40


def test_a_picture_twice_as_fine_shows_the_same(looking, idle, tmp_path):
    window = looking
    assert window.commands.run("view.picture_1")
    window.pictures.save(tmp_path / "one.png")
    window.messages.dismiss()
    idle()
    assert window.commands.run("view.picture_2")
    window.pictures.save(tmp_path / "two.png")
    one, two = imageio.imread(tmp_path / "one.png"), imageio.imread(tmp_path / "two.png")
    assert two.shape == (2 * one.shape[0], 2 * one.shape[1], 3)
    assert covered(two).mean() == pytest.approx(covered(one).mean(), rel=0.05)
    halved = two.reshape(one.shape[0], 2, one.shape[1], 2, 3).mean(axis=(1, 3))
    assert np.abs(halved - one).mean() < 3
    # The view itself has its pixels still, and the wish is kept.
    window.messages.dismiss()
    idle()
    assert window.viewport.picture().shape == one.shape
    assert window.settings.value("picture_scale") == "2"
    assert window.commands.action("view.picture_2").isChecked()
    assert not window.commands.action("view.picture_1").isChecked()


def test_the_clipboard_gets_the_view(looking):
    window = looking
    seen = window.viewport.picture()
    assert window.commands.run("view.copy_picture")
    image = QGuiApplication.clipboard().image()
    height, width, _ = seen.shape
    assert (image.width(), image.height()) == (width, height)
    rows, columns = np.nonzero(covered(seen))
    for place in range(0, len(rows), len(rows) // 7):
        x, y = int(columns[place]), int(rows[place])
        assert image.pixelColor(x, y).getRgb()[:3] == tuple(seen[y, x])
    assert f"{width} × {height}" in window.messages.text


def test_a_turntable_goes_once_around_and_comes_back(looking, idle, tmp_path):
    window = looking
    renderer = window.viewport.plotter.renderer
    begun, seen = camera.pose(renderer), window.viewport.picture()
    window.pictures.write_turntable(tmp_path / "turn.png", frames=4)
    assert window.pictures.is_turning
    assert not window.commands.run("view.turntable"), "one at a time"
    idle()
    files = sorted(tmp_path.glob("*.png"))
    assert len(files) == 4
    pictures = [imageio.imread(file) for file in files]
    assert (pictures[0] == seen).all()
    # A quarter on the camera looks along x: what the preset from the right shows.
    np.testing.assert_allclose(np.ravel(camera.pose(renderer)[0]), np.ravel(begun[0]))
    assert "4 pictures" in window.messages.text
    window.messages.dismiss()
    idle()
    camera.set_pose(renderer, begun)
    renderer.GetActiveCamera().Azimuth(90)
    quarter = window.viewport.picture()
    assert np.abs(pictures[1].astype(int) - quarter).mean() < 1
    assert (np.abs(pictures[1].astype(int) - seen).max(axis=2) > 40).mean() > 0.01


def test_a_turntable_that_is_cancelled_leaves_nothing(looking, idle, qtbot, tmp_path):
    window = looking
    begun = camera.pose(window.viewport.plotter.renderer)
    task = window.pictures.write_turntable(tmp_path / "turn.gif", frames=400)
    drawn = []
    task.reported.connect(drawn.append)
    qtbot.waitUntil(lambda: bool(drawn))
    assert window.commands.run("work.cancel")
    idle()
    assert task.state == "cancelled"
    assert not list(tmp_path.iterdir())
    np.testing.assert_allclose(camera.pose(window.viewport.plotter.renderer)[0], begun[0])


def test_mp4_without_its_writer_is_said_at_once(looking, tmp_path, monkeypatch):
    window = looking
    monkeypatch.setattr("mbstudio.scene.pictures.animation.find_spec", lambda name: None)
    assert window.pictures.write_turntable(tmp_path / "turn.mp4") is None
    assert window.messages.level == "error"
    assert "imageio-ffmpeg" in window.messages.text
