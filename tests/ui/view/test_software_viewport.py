"""The view drawn in software: coarse while it moves where it is slow, sharp at rest; places stay places."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.scene import Scene
from mbstudio.scene.layers.picking import to_display
from mbstudio.scene.surfaces import surface_of
from mbstudio.ui.viewport.software import BUDGET, COARSEST, SoftwareViewport


@pytest.fixture
def viewport(qtbot):
    viewport = SoftwareViewport()
    viewport.resize(400, 300)
    scene = Scene(viewport.plotter)
    viewport.scaled.connect(scene.set_pixel_ratio)
    scene.layers.avatar.set(surface_of(trimesh.creation.icosphere(subdivisions=3, radius=100)), "um")
    scene.look_from("front")
    viewport.show()
    qtbot.waitExposed(viewport)
    qtbot.wait(50)  # what showing it asked for
    viewport.render_now()
    yield viewport
    scene.close()
    viewport.close_viewport()
    viewport.deleteLater()


def test_a_slow_picture_is_coarse_at_first_and_sharp_at_rest(viewport, qtbot):
    sharp = np.array(viewport._pixels())
    assert viewport._image.size().toTuple() == tuple(sharp)
    viewport._per_pixel = 4 * BUDGET / sharp.prod()  # as if it took four times what it may
    assert viewport.coarseness() == pytest.approx(0.5)
    viewport._render_soon.timeout.emit()
    np.testing.assert_allclose(np.array(viewport._image.size().toTuple()), sharp / 2, atol=1)
    assert not viewport.is_sharp
    # Where a point stands is told for the whole picture all the same.
    place = to_display(viewport.plotter.renderer, np.array([[0.0, 0, 0]]))[0]
    np.testing.assert_allclose(place, sharp / 2, atol=1)
    qtbot.waitUntil(lambda: viewport._image.width() == sharp[0])
    assert viewport.is_sharp


def test_a_coarse_picture_shows_the_same(viewport):
    whole = viewport.picture().astype(float)
    viewport._render(0.5, 0)
    image = viewport._image
    coarse = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    coarse = coarse[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).astype(float)
    ball = whole[..., 2] - whole[..., 0] > 40
    small = coarse[..., 2] - coarse[..., 0] > 40
    assert small.mean() == pytest.approx(ball.mean(), rel=0.04)


def test_a_quick_picture_is_never_coarse_and_a_slow_one_never_useless(viewport):
    viewport._per_pixel = 0.5 * BUDGET / np.prod(viewport._pixels())
    assert viewport.coarseness() == 1.0
    viewport._per_pixel = 1e3
    assert viewport.coarseness() == COARSEST


def test_pictures_to_keep_are_sharp(viewport):
    viewport._per_pixel = 1e3
    viewport.request_render()
    assert viewport.picture().shape[:2] == viewport._pixels()[::-1]


def test_a_sharp_picture_that_comes_late_waits_once_for_what_stands_behind_it(viewport):
    viewport._render_quickly()
    viewport._latest_sharp = 0.0  # as after a long act
    viewport._sharpen()
    assert not viewport.is_sharp
    viewport._sharpen()
    assert viewport.is_sharp
