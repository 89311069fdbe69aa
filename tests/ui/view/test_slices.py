"""The flat slices beside the view: linked both ways, grey window by dragging, what lies under the mouse."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent, QWheelEvent
from PySide6.QtTest import QTest

from mbstudio.scene.layers.picking import to_display


def drag(widget, button, start, end):
    """Drag the mouse over a widget; both places are in its own pixels."""
    QTest.mousePress(widget, button, pos=start.toPoint())
    move = QMouseEvent(
        QMouseEvent.Type.MouseMove, end, widget.mapToGlobal(end), Qt.MouseButton.NoButton, button,
        Qt.KeyboardModifier.NoModifier,
    )  # fmt: skip
    widget.mouseMoveEvent(move)
    QTest.mouseRelease(widget, button, pos=end.toPoint())


def hover(widget, place):
    widget.mouseMoveEvent(
        QMouseEvent(
            QMouseEvent.Type.MouseMove,
            place,
            widget.mapToGlobal(place),
            Qt.MouseButton.NoButton,
            Qt.MouseButton.NoButton,
            Qt.KeyboardModifier.NoModifier,
        )
    )


def wheel(widget, steps, modifiers=Qt.KeyboardModifier.NoModifier):
    place = QPointF(widget.rect().center())
    widget.wheelEvent(
        QWheelEvent(
            place,
            widget.mapToGlobal(place),
            QPoint(),
            QPoint(0, 120 * steps),
            Qt.MouseButton.NoButton,
            modifiers,
            Qt.ScrollPhase.NoScrollPhase,
            False,
        )
    )


@pytest.fixture
def panes(scanned, idle):
    idle()
    assert scanned.docks["slices"].isVisible()
    return scanned.slice_views.panes.panes


def test_a_pane_shows_the_voxels_of_its_plane(scanned, panes):
    scan, pane = scanned.workspace.scan, panes["y"]
    slices = scanned.view.scene.layers.slices.planes
    index = slices.index["y"]
    shown = pane.grab().toImage()
    ratio = shown.devicePixelRatio()
    low, high = slices.window
    # Voxels far from the lines: column is x, row is z, upwards.
    for column, row in ((10, 10), (22, 20), (50, 45), (60, 8)):
        place = pane.place_of(column, row) * ratio
        grey = shown.pixelColor(round(place.x()), round(place.y())).red()
        expected = 255 * np.clip((float(scan.voxels[row, index, column]) - low) / (high - low), 0, 1)
        assert grey == pytest.approx(expected, abs=14), (column, row)


def test_the_wheel_moves_the_slice_in_every_place_where_it_shows(scanned, panes):
    link, panel = scanned.view, scanned.stations.scan.panel
    wheel(panes["z"], 3)
    assert link.scene.layers.slices.planes.index["z"] == 35
    assert panel.sliders["z"].number.value() == 35
    assert panes["x"]._cross == (32, 35)
    assert panes["y"]._cross == (32, 35)
    QTest.keyClick(panes["z"], Qt.Key.Key_Down)
    assert link.scene.layers.slices.planes.index["z"] == 34
    wheel(panes["z"], 99)
    assert link.scene.layers.slices.planes.index["z"] == 63


def test_a_click_moves_both_other_slices(scanned, panes):
    pane = panes["z"]
    QTest.mouseClick(pane, Qt.MouseButton.LeftButton, pos=pane.place_of(10, 50).toPoint())
    index = scanned.view.scene.layers.slices.planes.index
    assert abs(index["x"] - 10) <= 1
    assert abs(index["y"] - 50) <= 1
    assert index["z"] == 32


def test_the_slider_of_the_panel_moves_the_panes(scanned, panes):
    before = panes["x"].grab().toImage()
    scanned.stations.scan.panel.sliders["x"].slider.setValue(5)
    assert panes["z"]._cross[0] == 5
    assert panes["x"].grab().toImage() != before


def test_a_slice_dragged_in_space_moves_the_pane(scanned, panes, idle):
    window, viewport = scanned, scanned.viewport
    window.view.look_from("front")
    viewport.render_now()
    slices = window.view.scene.layers.slices.planes
    corner = slices.corners("z")[0]
    above = corner + np.array([0, 0, 10 * slices.spacing("z")])
    places = to_display(viewport.plotter.renderer, np.array([corner, above]))
    places[:, 0] += 12
    ratio = viewport.devicePixelRatioF()
    start, end = (QPointF(x / ratio, viewport.height() - y / ratio) for x, y in places)
    camera = viewport.plotter.renderer.GetActiveCamera().GetPosition()
    hover(viewport, start)
    assert viewport.cursor().shape() == Qt.CursorShape.SizeAllCursor
    drag(viewport, Qt.MouseButton.LeftButton, start, end)
    assert abs(slices.index["z"] - 42) <= 1
    assert panes["x"]._cross[1] == slices.index["z"]
    assert window.stations.scan.panel.sliders["z"].number.value() == slices.index["z"]
    assert viewport.plotter.renderer.GetActiveCamera().GetPosition() == camera, "the view was not turned"


def test_dragging_with_the_right_button_changes_the_grey_window(scanned, panes):
    slices = scanned.view.scene.layers.slices.planes
    low, high = slices.window
    start = QPointF(panes["z"].rect().center())
    drag(panes["z"], Qt.MouseButton.RightButton, start, start + QPointF(40, 0))
    # 40 of 200 pixels to the right: a fifth wider, the middle where it was.
    assert slices.window[1] - slices.window[0] == pytest.approx(1.2 * (high - low))
    assert sum(slices.window) == pytest.approx(low + high)
    assert f"Black {slices.window[0]:,.0f}" in scanned.stations.scan.panel._range_text.text()
    dark = panes["x"].grab().toImage()
    low, high = slices.window
    drag(panes["z"], Qt.MouseButton.RightButton, start, start + QPointF(0, -40))
    assert sum(slices.window) == pytest.approx(low + high - 2 * 0.2 * (high - low)), "brighter"
    assert panes["x"].grab().toImage() != dark


def test_the_status_bar_tells_place_grey_value_and_grain(segmented, idle):
    window = segmented
    idle()
    pane, scan = window.slice_views.panes.panes["z"], window.workspace.scan
    labels = window.workspace.state.grains.labels
    column, row = 40, 42
    z = 42
    window.view.move_slice("z", z)
    hover(pane, pane.place_of(column, row))
    words = window.slice_views.readout.text()
    # Voxels of 14 µm from the origin.
    assert words.startswith("x 560 µm   y 588 µm   z 588 µm")
    assert f"grey {int(scan.voxels[z, row, column])}" in words
    assert labels[z, row, column] > 0
    assert words.endswith(f"grain {labels[z, row, column]}")
    hover(pane, pane.place_of(2, 60))
    assert window.slice_views.readout.text().endswith("no grain")
    hover(pane, QPointF(0, 0))
    assert window.slice_views.readout.text() == ""


def test_the_mouse_over_a_slice_in_space_tells_the_same(scanned, idle):
    window, viewport = scanned, scanned.viewport
    window.view.look_from("top")
    viewport.render_now()
    slices, scan = window.view.scene.layers.slices.planes, window.workspace.scan
    for axis in ("x", "y"):
        window.view.switch_slice(axis, False)
    x, y = to_display(
        viewport.plotter.renderer, np.array([[14.0 * 20, 14.0 * 22, 14.0 * slices.index["z"]]])
    )[0]
    ratio = viewport.devicePixelRatioF()
    hover(viewport, QPointF(x / ratio, viewport.height() - y / ratio))
    words = window.slice_views.readout.text()
    assert words.startswith("x 280 µm   y 308 µm   z 448 µm   voxel 20, 22, 32")
    assert f"grey {int(scan.voxels[32, 22, 20])}" in words


def test_the_panes_can_be_put_away_and_stay_away(scanned, panes):
    window = scanned
    assert window.commands.run("panel.slices")
    assert window.docks["slices"].isHidden()
    window.enter("fit")
    window.enter("scan")
    assert window.docks["slices"].isHidden()
    assert window.commands.run("panel.slices")
    assert window.docks["slices"].isVisible()
    window.enter("fit")
    assert window.docks["slices"].isVisible()
    window.enter("populations")
    assert window.docks["slices"].isHidden()


def test_zoom_keeps_the_voxel_under_the_mouse(scanned, panes):
    pane = panes["z"]
    middle = QPointF(pane.rect().center())
    before, width = pane.voxel_at(middle), pane.picture_rect().width()
    wheel(pane, 2, Qt.KeyboardModifier.ControlModifier)
    assert pane.picture_rect().width() == pytest.approx(1.25**2 * width)
    assert pane.voxel_at(middle) == pytest.approx(before, abs=0.6)
    QTest.keyClick(scanned, Qt.Key.Key_Home)
    assert pane.picture_rect().width() == pytest.approx(width)


def test_the_volume_is_no_larger_than_the_graphics_takes(scanned, idle, monkeypatch):
    window = scanned
    monkeypatch.setattr("mbstudio.ui.view.view_surfaces.largest_texture", lambda _: 20)
    assert window.commands.run("layer.volume")
    idle()
    mapper = window.view.scene.layers.volume.cloud.actor.GetMapper()
    # 64 voxels a side, every fourth: 16.
    assert mapper.GetInput().GetDimensions() == (16, 16, 16)


def test_turning_shows_the_coarse_volume(scanned, idle):
    window = scanned
    assert window.commands.run("layer.volume")
    idle()
    cloud, viewport = window.view.scene.layers.volume.cloud, window.viewport
    QTest.mousePress(viewport, Qt.MouseButton.LeftButton, pos=QPoint(30, 40))
    assert cloud.coarse.GetVisibility()
    QTest.mouseRelease(viewport, Qt.MouseButton.LeftButton, pos=QPoint(30, 40))
    assert cloud.actor.GetVisibility()
    assert not cloud.coarse.GetVisibility()


def test_in_a_narrow_window_the_view_comes_first(scanned, panes, qtbot):
    window = scanned
    window.resize(900, 600)
    qtbot.waitUntil(window.docks["slices"].isHidden)
    window.resize(1280, 800)
    qtbot.waitUntil(lambda: not window.docks["slices"].isHidden())
