"""Columns next to each other: each with its body, at one scale, seen by one camera."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.scene import DARK, LIGHT, Scene
from mbstudio.scene.layers.side_by_side import Column
from mbstudio.scene.surfaces import surface_of
from mbstudio.scene.theme import rgb


def body(extents, centre):
    mesh = trimesh.creation.box(extents).subdivide().subdivide()
    mesh.apply_translation(centre)
    return surface_of(mesh)


@pytest.fixture
def scene(plotter):
    scene = Scene(plotter, LIGHT)
    scene.layers.grain.set(body((50, 50, 50), (0, 0, 0)), "um")
    scene.look_from("front")
    scene.layers.side_by_side.set(
        [
            Column("Grain 1", body((40, 40, 80), (500, 0, 0)), "grain"),
            Column("Avatar", body((80, 40, 40), (0, 900, -300)), "avatar"),
            Column("Clone", None, "points", "No clone yet"),
        ],
        "um",
    )
    return scene


def columns_of(picture):
    """Return of each third of the picture which pixels are no background: far from each row's first."""
    far = np.abs(picture.astype(int) - picture[:, :1].astype(int)).max(axis=2) > 60
    return np.split(far[:, :399], 3, axis=1)


def extent(mask):
    rows, columns = np.nonzero(mask[40:235])
    return np.ptp(columns) + 1, np.ptp(rows) + 1


def test_each_body_stands_in_the_middle_of_its_column_at_one_scale(scene):
    scene.layers.side_by_side.show(True)
    first, second, third = columns_of(scene.screenshot())
    width, height = extent(first)
    assert height == pytest.approx(2 * width, rel=0.06)
    assert extent(second) == pytest.approx((height, width), rel=0.06)
    for mask in (first, second):
        rows, columns = np.nonzero(mask[40:235])
        assert columns.mean() == pytest.approx(66.5, abs=2)
        assert rows.mean() + 40 == pytest.approx(150, abs=2)
    assert 0 < third[130:170].mean() < 0.3, "only the hint is written there"


def test_all_turn_together(scene):
    scene.layers.side_by_side.show(True)
    before = [extent(mask) for mask in columns_of(scene.screenshot())[:2]]
    scene.look_from("top")
    after = [extent(mask) for mask in columns_of(scene.screenshot())[:2]]
    # From above the first is 40 by 40: the same width, half the height.
    assert after[0][0] == pytest.approx(after[0][1], rel=0.06)
    assert after[1][0] / after[1][1] == pytest.approx(before[1][0] / before[1][1], rel=0.08)


def test_a_column_is_replaced_where_it_stands(scene):
    scene.layers.side_by_side.show(True)
    scene.screenshot()
    scene.layers.side_by_side.replace(1, body((40, 40, 80), (77, 0, 0)))
    first, second, _ = columns_of(scene.screenshot())
    assert extent(second) == pytest.approx(extent(first), rel=0.05)


def test_switching_off_brings_the_view_back(scene):
    before = scene.screenshot()
    renderers = scene.plotter.render_window.GetRenderers().GetNumberOfItems()
    scene.layers.side_by_side.show(True)
    scene.look_from("top")
    beside = scene.screenshot()
    assert (beside != before).any(axis=2).mean() > 0.05
    scene.layers.side_by_side.show(False)
    assert (scene.screenshot() == before).all()
    assert scene.plotter.render_window.GetRenderers().GetNumberOfItems() == renderers


def test_the_columns_take_the_theme(scene):
    scene.layers.side_by_side.show(True)
    scene.set_theme(DARK)
    picture = scene.screenshot().astype(int)
    assert picture[5, 5].mean() < 60
    assert np.abs(picture[150, 66] - rgb(DARK.grain)).max() < 90
