"""The box over a slice: its edges and corners are dragged, the rest of the slice is veiled."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtTest import QTest

from mbstudio.ui.view.pane_box import PaneBox
from mbstudio.ui.view.slice_pane import SlicePane
from tests.ui.view.test_slices import drag, hover


@pytest.fixture
def box() -> PaneBox:
    """Of columns 10 to 30 and rows 5 to 15, where a voxel is 10 pixels and row 0 lies at 400."""
    box = PaneBox(lambda column, row: QPointF(10 * (column + 0.5), 400 - 10 * (row + 0.5)))
    box.ends = (10, 30), (5, 15)
    return box


@pytest.mark.parametrize(
    ("place", "grip", "cursor"),
    [
        ((100, 300), (-1, 0), Qt.CursorShape.SizeHorCursor),
        ((304, 300), (1, 0), Qt.CursorShape.SizeHorCursor),
        ((200, 346), (0, -1), Qt.CursorShape.SizeVerCursor),
        ((200, 250), (0, 1), Qt.CursorShape.SizeVerCursor),
        ((98, 352), (-1, -1), Qt.CursorShape.SizeBDiagCursor),
        ((300, 250), (1, 1), Qt.CursorShape.SizeBDiagCursor),
        ((100, 250), (-1, 1), Qt.CursorShape.SizeFDiagCursor),
        ((200, 300), None, None),
        ((80, 300), None, None),
    ],
)
def test_edges_and_corners_are_found(box: PaneBox, place, grip, cursor) -> None:
    assert box.grip_at(QPointF(*place)) == grip
    assert box.cursor_at(QPointF(*place)) == cursor
    assert box.grab(QPointF(*place)) == (grip is not None)


def test_an_edge_moves_to_between_the_nearest_voxels_and_stays_in_the_slice(box: PaneBox) -> None:
    counts = (50, 40)
    assert box.grab(QPointF(100, 300))
    assert box.dragged_to(13.4, 99, counts) == ((14, 30), (5, 15))
    assert box.dragged_to(13.6, 99, counts) == ((14, 30), (5, 15))
    assert box.dragged_to(-9, 9, counts) == ((0, 30), (5, 15))
    assert box.dragged_to(80, 9, counts) == ((29, 30), (5, 15)), "a voxel is left"
    assert box.grab(QPointF(300, 250))
    assert box.dragged_to(99, 99, counts) == ((10, 50), (5, 40))
    assert box.dragged_to(0, 0, counts) == ((10, 11), (5, 6))
    box.drop()
    assert box.dragged_to(20, 9, counts) is None


@pytest.fixture
def pane(qtbot):
    pane = SlicePane("XY", "z")
    qtbot.addWidget(pane)
    pane.resize(412, 312)
    pane.set_colours("#ff0000", "#00ff00", "#0000ff", "#102030")
    pane.box.colour = "#ff00ff"
    pane.show_slice(np.full((30, 40), 200, np.uint8))
    pane.show()
    qtbot.waitExposed(pane)
    return pane


def colour_at(pane: SlicePane, column: float, row: float) -> tuple[int, int, int]:
    picture, place = pane.grab().toImage(), pane.place_of(column, row)
    ratio = picture.devicePixelRatio()
    colour = picture.pixelColor(round(place.x() * ratio), round(place.y() * ratio))
    return colour.red(), colour.green(), colour.blue()


def test_the_rest_lies_behind_a_veil(pane: SlicePane) -> None:
    plain, veiled = (200, 200, 200), pytest.approx((92, 101, 111), abs=3)
    assert colour_at(pane, 35, 25) == plain
    pane.set_box(((10, 30), (5, 20)))
    assert colour_at(pane, 20, 12) == plain
    for column, row in ((5, 12), (35, 12), (20, 2), (20, 25), (35, 25), (3, 3)):
        assert colour_at(pane, column, row) == veiled
    for column, row in ((9.5, 8), (29.5, 8), (15, 4.5), (15, 19.5)):
        assert colour_at(pane, column, row) == (255, 0, 255)
    pane.set_box(((10, 30), (5, 20)), cuts_slice=False)
    assert colour_at(pane, 20, 12) == veiled
    pane.set_box(None)
    assert colour_at(pane, 35, 25) == plain


def test_dragging_an_edge_asks_for_a_box_and_leaves_the_lines(pane: SlicePane, qtbot) -> None:
    asked, crossed = [], []
    pane.boxed.connect(asked.append)
    pane.crossed.connect(lambda *place: crossed.append(place))
    pane.set_box(((10, 30), (5, 20)))
    hover(pane, pane.place_of(29.5, 12))
    assert pane.cursor().shape() == Qt.CursorShape.SizeHorCursor
    drag(pane, Qt.MouseButton.LeftButton, pane.place_of(29.5, 12), pane.place_of(24.5, 12))
    assert asked == [((10, 25), (5, 20))]
    assert crossed == []
    drag(pane, Qt.MouseButton.LeftButton, pane.place_of(29.5, 19.5), pane.place_of(60, 60))
    assert asked[-1] == ((10, 40), (5, 30)), "the mouse may leave the slice"
    # Inside the box a click moves the lines, as without one.
    hover(pane, pane.place_of(20, 12))
    assert pane.cursor().shape() == Qt.CursorShape.CrossCursor
    QTest.mouseClick(pane, Qt.MouseButton.LeftButton, pos=pane.place_of(20, 12).toPoint())
    assert len(crossed) == 1
    assert len(asked) == 2
