"""The gallery: order, ranges, the one selection, pictures only of what is looked at."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.ui.stations.gallery.body_list import SIDE, Bodies, BodyList, rows_in_order
from tests.ui.conftest import PATIENCE


def bodies_of(count, drawn=None):
    def draw(row):
        if drawn is not None:
            drawn.append(row)
        picture = np.zeros((SIDE, SIDE, 4), dtype=np.uint8)
        picture[...] = (row % 250, 0, 0, 255)
        return picture

    keys = np.arange(1, count + 1)
    return Bodies("grains", keys, {"dn": keys[::-1].astype(float)}, "um", draw)


def test_order_and_ranges():
    columns = {
        "dn": np.array([3.0, 1.0, np.nan, 2.0, 2.0]),
        "sphericity": np.array([0.9, 0.8, 0.7, np.nan, 0.6]),
    }
    bodies = Bodies("grains", np.array([11, 12, 13, 14, 15]), columns, "um", lambda row: None)
    order = lambda *given: bodies.keys[rows_in_order(bodies, *given)].tolist()  # noqa: E731
    assert order([], "", False) == [11, 12, 13, 14, 15]
    assert order([], "", True) == [15, 14, 13, 12, 11]
    assert order([], "dn", False) == [12, 14, 15, 11, 13], "what is not known comes last"
    assert order([], "dn", True) == [11, 14, 15, 12, 13]
    assert order([("dn", 2.0, 3.0)], "dn", False) == [14, 15, 11]
    assert order([("dn", 2.0, 3.0), ("sphericity", 0.0, 0.7)], "dn", False) == [15]
    assert order([("dn", 4.0, 5.0)], "", False) == []


def test_only_what_is_looked_at_is_asked_for(qtbot):
    view = BodyList()
    qtbot.addWidget(view)
    view.resize(400, 300)
    bodies, asked = bodies_of(10_000), []
    view.pictures_wanted.connect(lambda given, rows: asked.append(rows))
    view.show_bodies(bodies, np.arange(10_000), "")
    view.show()
    qtbot.waitUntil(lambda: bool(asked), timeout=PATIENCE)
    assert asked[0][0] == 0
    assert len(asked[0]) < 20
    asked.clear()
    view.scrollTo(view.model().index(9_999, 0))
    qtbot.waitUntil(lambda: bool(asked), timeout=PATIENCE)
    assert 9_999 in asked[-1]
    assert len(asked[-1]) < 20
    view.close()


@pytest.fixture
def gallery(with_grains, idle):
    assert with_grains.commands.run("panel.bodies")
    idle()
    return with_grains.shell.gallery_link.gallery


def click(gallery, place, modifier=Qt.KeyboardModifier.NoModifier):
    rect = gallery.list.visualRect(gallery.list.model().index(place, 0))
    QTest.mouseClick(gallery.list.viewport(), Qt.MouseButton.LeftButton, modifier, rect.center())


def test_grains_have_pictures_and_share_the_selection(with_grains, gallery, idle, qtbot):
    window = with_grains
    bodies = gallery.bodies
    qtbot.waitUntil(lambda: len(bodies.pictures) == 2, timeout=PATIENCE)
    for picture in bodies.pictures.values():
        assert picture.toImage().pixelColor(SIDE // 2, SIDE // 2).alpha() == 255
    click(gallery, 1)
    assert window.workspace.selected == 2
    assert window.stations.grains.table.chosen_labels() == [2]
    click(gallery, 0, Qt.KeyboardModifier.ControlModifier)
    assert window.workspace.chosen == {1, 2}
    window.workspace.select(1)
    assert gallery.list.chosen_keys() == [1]
    window.workspace.select(None)
    assert gallery.list.chosen_keys() == []
    gallery.all.click()
    assert window.workspace.chosen == {1, 2}


def test_ranges_and_order_by_hand(with_grains, gallery, idle, qtbot):
    larger, smaller = sorted(
        (1, 2), key=lambda label: -with_grains.workspace.state.grains.grain(label).volume
    )
    assert [gallery.sort.itemData(row) for row in range(gallery.sort.count())] == ["", "dn", "volume"]
    gallery.sort.setCurrentIndex(1)
    gallery.falling.click()
    assert gallery.list.keys() == [larger, smaller]
    gallery.add.click()
    (row,) = gallery.ranges
    assert gallery.list.keys() == [larger, smaller], "the whole range holds all"
    row.low.setValue((row.low.value() + row.high.value()) / 2)
    assert gallery.list.keys() == [larger]
    assert gallery._count.text() == "1 of 2"
    row.remove.click()
    assert gallery.list.keys() == [larger, smaller]


def test_measured_factors_and_avatars_come_in(with_grains, gallery, idle, qtbot):
    window = with_grains
    assert gallery.measure.isVisible()
    assert window.commands.run("fit.all")
    idle()
    gallery.measure.click()
    idle()
    assert "sphericity" in gallery.bodies.columns
    assert np.isfinite(gallery.bodies.columns["sphericity"]).all()
    assert not gallery.measure.isVisible()
    gallery.tabs.setCurrentIndex(1)
    assert gallery.bodies.kind == "avatars"
    assert gallery.tabs.tabText(1) == "Avatars (2)"
    bodies = gallery.bodies
    qtbot.waitUntil(lambda: len(bodies.pictures) == 2, timeout=PATIENCE)
    avatar = window.workspace.state.fits[2].avatar
    assert isinstance(avatar, Avatar)
    click(gallery, 1)
    assert window.workspace.selected == 2
    gallery.tabs.setCurrentIndex(2)
    assert gallery.bodies is None
    assert "station Style" in gallery._hint.text()
    window.undo.undo()
    gallery.tabs.setCurrentIndex(1)
    assert "no avatars" in gallery._hint.text()


def test_bodies_of_which_nothing_was_measured_are_offered_no_range(window, idle):
    gallery = window.shell.gallery_link.gallery
    bodies = bodies_of(5)
    gallery.show_bodies(bodies)
    assert gallery.add.isEnabled()
    gallery.show_bodies(Bodies("clones", bodies.keys, {}, "um", bodies.draw))
    assert not gallery.add.isEnabled()
    gallery.add.click()
    assert gallery.ranges == []
    gallery.show_bodies(None)
