"""The window driven as a person would: from a scan to DEM files, and what the picture shows."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QFileDialog, QToolButton
from scipy.ndimage import distance_transform_edt

import mbstudio
from mbstudio.core.dem import targets
from mbstudio.core.dem.target import complete_options
from tests.scene.conftest import flatten
from tests.ui.conftest import PATIENCE


def choose_in_table(window, label):
    """Click the row of a grain."""
    table = window.stations.grains.table
    row = table.labels_in_order().index(label)
    place = table.visualRect(table.model().index(row, 0)).center()
    QTest.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=place)


def silhouette(window, layer):
    """Return the mask of pixels that a layer covers, seen from the present camera."""
    flatten(window.view.scene, layer)
    return window.viewport.picture().mean(axis=2) > 127


def test_from_scan_to_dem_files(window, scanned, idle, qtbot, tmp_path):
    state = lambda: window.workspace.state  # noqa: E731
    assert window.workspace.scan.shape == (64, 64, 64)
    assert window.stations.scan.panel._values["Voxel size"].text() == "14 µm"
    seen = window.viewport.picture()
    assert seen.std() > 10, "the slices are not to be seen"

    QTest.mouseClick(window.stations.grains.panel.find_button, Qt.MouseButton.LeftButton)
    idle()
    assert len(state().grains) == 3
    assert sorted(state().grains.table["touches_border"]) == [False, False, True]
    assert window.stations.grains.table.model().rowCount() == 3

    label = state().grains.interior_labels[0]
    window.enter("fit")
    idle()
    choose_in_table(window, label)
    idle()
    assert window.workspace.selected == label

    window.stations.fit.panel.n.setValue(20)
    arrived = []
    window.stations.fit.work.losses_arrived.connect(lambda fitted, losses: arrived.extend(losses))
    QTest.mouseClick(window.stations.fit.panel.fit_button, Qt.MouseButton.LeftButton)
    assert window.stations.fit.work.run.is_running
    idle()
    fit = state().fits[label]
    # Every generation reached the window, in order, and stands in the curve.
    np.testing.assert_allclose(arrived, fit.history)
    np.testing.assert_allclose(window.stations.fit.curve.losses, fit.history)
    assert fit.avatar.n <= 20
    assert fit.verdict.valid
    # The factors of both stand beside each other.
    shown = window.stations.fit.panel.factors
    assert float(shown.item(2, 1).text()) == pytest.approx(1.0, abs=0.08)
    assert float(shown.item(2, 1).text()) == pytest.approx(float(shown.item(2, 2).text()), abs=0.03)

    # The avatar covers the grain in the picture: their outlines are a few pixels apart.
    grain, avatar = silhouette(window, "grain"), silhouette(window, "avatar")
    assert 0.05 < grain.mean() < 0.9
    edge = avatar ^ np.roll(avatar, 1, 0) | avatar ^ np.roll(avatar, 1, 1)
    grain_edge = grain ^ np.roll(grain, 1, 0) | grain ^ np.roll(grain, 1, 1)
    across = np.ptp(np.argwhere(grain), axis=0).min()
    distance = distance_transform_edt(~grain_edge)[edge]
    assert distance.mean() < 0.01 * across + 1
    assert distance.max() < 0.05 * across + 2

    window.undo.undo()
    assert label not in state().fits
    assert window.stations.fit.curve.losses == []
    window.undo.redo()
    assert label in state().fits

    path = tmp_path / "sand.mbs"
    window.project_work.save(path)
    idle()
    assert not window.workspace.is_modified
    with mbstudio.Project.open(path) as project:
        np.testing.assert_array_equal(project.fits[label].avatar.centers, fit.avatar.centers)

    window.enter("export")
    panel = window.stations.export.panel
    panel.target.setCurrentIndex(panel.target.findData("stl"))
    panel.folder.setText(str(tmp_path / "stl"))
    QTest.mouseClick(panel.export_button, Qt.MouseButton.LeftButton)
    idle()
    assert window.messages.level == "success", window.messages.text
    (file,) = (tmp_path / "stl").glob("*.stl")
    mesh = trimesh.load_mesh(file)
    assert mesh.is_watertight
    grain_volume = state().grains.grain(label).volume * 1e-18  # µm³ in m³
    assert mesh.volume == pytest.approx(grain_volume, rel=0.05)

    panel.target.setCurrentIndex(panel.target.findData("liggghts"))
    panel.folder.setText(str(tmp_path / "liggghts"))
    assert window.commands.run("export.run")
    idle()
    assert window.messages.level == "success", window.messages.text
    manifest = json.loads((tmp_path / "liggghts" / "manifest.json").read_text())
    assert manifest


def test_the_export_panel_offers_every_target_with_options_it_takes(window):
    panel = window.stations.export.panel
    assert [panel.target.itemData(row) for row in range(panel.target.count())] == list(targets())
    for row, target in enumerate(targets().values()):
        panel.target.setCurrentIndex(row)
        given = panel.given()
        assert complete_options(target, given["options"]) == {
            name: option.default for name, option in target.options.items()
        }
        assert (given["density"] is not None) == target.needs_density
        units = {panel.unit.itemData(place) for place in range(panel.unit.count())} - {None}
        assert not target.units or units == set(target.units)


def test_the_grain_under_the_mouse_is_chosen(segmented, idle):
    window = segmented
    window.view.look_from("top")
    idle()
    label = window.workspace.state.grains.interior_labels[1]
    # Where does the centre of that grain stand in the picture?
    centre = window.workspace.state.grains.grain(label).centroid
    renderer = window.viewport.plotter.renderer
    window.viewport.render_now()
    renderer.SetWorldPoint(*centre, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    ratio = window.viewport.devicePixelRatioF()
    place = window.viewport.rect().topLeft()
    place.setX(round(x / ratio))
    place.setY(round(window.viewport.height() - y / ratio))
    QTest.mouseClick(window.viewport, Qt.MouseButton.LeftButton, pos=place)
    assert window.workspace.selected == label
    assert window.stations.grains.table.currentIndex().isValid()


def test_a_fit_pauses_and_goes_on_and_stops(segmented, idle, qtbot):
    window = segmented
    label = window.workspace.state.grains.interior_labels[0]
    window.workspace.select(label)
    window.stations.fit.panel.method.setCurrentIndex(window.stations.fit.panel.method.findData("paper"))
    idle()
    assert window.commands.run("fit.grain")
    qtbot.waitUntil(lambda: len(window.stations.fit.curve.losses) > 3, timeout=PATIENCE)
    window.stations.fit.work.run.pause_or_resume()
    assert window.stations.fit.panel.pause_button.text() == "Resume"
    qtbot.wait(300)  # the step that was under way may still arrive
    count = len(window.stations.fit.curve.losses)
    qtbot.wait(300)
    assert len(window.stations.fit.curve.losses) == count
    assert label not in window.workspace.state.fits
    window.stations.fit.work.run.pause_or_resume()
    qtbot.waitUntil(lambda: len(window.stations.fit.curve.losses) > count, timeout=PATIENCE)
    window.stations.fit.work.run.stop()
    idle()
    stopped = window.workspace.state.fits[label]
    assert len(stopped.history) < 1500
    # And on from there, with more control points.
    window.stations.fit.panel.n.setValue(45)
    window.stations.fit.panel.more.setValue(5)
    assert window.commands.run("fit.more")
    idle()
    assert window.workspace.state.fits[label] is not stopped
    assert window.workspace.state.fits[label].avatar.n > stopped.avatar.n


def test_fitting_all_is_one_step_of_undo(segmented, idle):
    window = segmented
    assert window.commands.run("fit.all")
    idle()
    assert sorted(window.workspace.state.fits) == window.workspace.state.grains.interior_labels
    window.undo.undo()
    assert not window.workspace.state.fits


def test_spinning_a_setting_is_one_step_of_undo(segmented):
    window = segmented
    for n in (41, 42, 43):
        window.stations.fit.panel.n.setValue(n)
    assert window.workspace.state.fit_settings.n == 43
    window.undo.undo()
    assert window.workspace.state.fit_settings.n == 40
    assert window.stations.fit.panel.n.value() == 40


def test_the_project_comes_back_with_its_scan(segmented, idle, tmp_path, qtbot):
    window = segmented
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    window.project_files.new_project()
    assert window.workspace.state.grains is None
    assert window._pages.currentIndex() == 0
    window.project_files.open_path(tmp_path / "sand.mbs")
    qtbot.waitUntil(lambda: window.workspace.scan is not None, timeout=PATIENCE)
    idle()
    assert len(window.workspace.state.grains) == 3
    assert window.workspace.recent[0].name == "sand.mbs"
    assert not window.isWindowModified()


def test_every_command_runs_or_is_disabled(segmented, idle, monkeypatch, tmp_path, qtbot):
    window = segmented
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    small = SimpleNamespace(scan=replace(window.workspace.scan, path=None))
    monkeypatch.setattr("mbstudio.ui.stations.scan.work.sample_scan", lambda: small)
    nothing = lambda *args, **kwargs: ("", "")  # noqa: E731
    for name in ("getOpenFileName", "getSaveFileName"):
        monkeypatch.setattr(QFileDialog, name, nothing)
    monkeypatch.setattr(QFileDialog, "getOpenFileNames", lambda *args: ([], ""))
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *args: "")
    with qtbot.captureExceptions() as exceptions:
        for command in window.commands:
            if command.id in ("window.quit", "project.new"):
                continue
            ran = window.commands.run(command.id)
            assert ran == window.commands.action(command.id).isEnabled() or not command.enabled()
            idle()
    assert not exceptions
    assert window.messages.level != "error", window.messages.text


def test_commands_without_anything_to_work_on_are_disabled(window):
    window.commands.refresh()
    for name in (
        "grains.find",
        "fit.grain",
        "fit.all",
        "project.save",
        "export.run",
        "edit.undo",
        "view.fit",
    ):
        assert not window.commands.run(name), name
    assert window._pages.currentWidget() is window.welcome


def test_the_palette_finds_and_runs_a_command(segmented, qtbot):
    window = segmented
    window.command_palette.open()
    window.command_palette.type("dark")
    assert window.command_palette.titles() == ["View: Theme: dark"]
    QTest.keyClick(window.command_palette._search, Qt.Key.Key_Return)
    assert window.theme.is_dark
    assert not window.command_palette.isVisible()


def test_both_themes_paint_window_and_view(scanned, idle):
    window = scanned
    brightness = {}
    for choice in ("light", "dark"):
        window.commands.run(f"theme.{choice}")
        idle()
        image = window.stations.scan.panel.grab().toImage()
        brightness[choice] = (
            image.pixelColor(image.width() // 2, image.height() - 4).lightness(),
            int(window.viewport.picture()[5, 5].mean()),
        )
    assert min(brightness["light"]) > 180
    assert max(brightness["dark"]) < 80


@pytest.mark.parametrize("width", [1024, 1400, 1800])
def test_all_of_the_bar_above_the_view_has_room(with_grains, idle, width):
    """Its layers have words only where all has room beside them; else Qt's button has the rest."""
    window, words = with_grains, with_grains.view_bar._worded
    window.resize(width, 700)
    for station in ("scan", "grains", "fit", "populations"):
        window.enter(station)
        idle()
        shown = [action for action in window.view_bar.actions() if action.isVisible()]
        hidden = [action for action in shown if not window.view_bar.widgetForAction(action).isVisible()]
        if hidden:
            more = window.view_bar.findChild(QToolButton, "qt_toolbar_ext_button")
            assert more.isVisible(), station
            assert not more.icon().isNull()
            assert window.view_bar.width() < 500
    assert width < 1800 or all(
        b.toolButtonStyle() == Qt.ToolButtonStyle.ToolButtonTextBesideIcon for b in words
    )


def test_no_two_lines_of_the_bar_above_the_view_stand_side_by_side(with_grains, idle):
    window = with_grains
    for station in ("scan", "grains", "fit", "style", "latent", "export"):
        window.enter(station)
        idle()
        shown = [action for action in window.view_bar.actions() if action.isVisible()]
        lines = [action.isSeparator() for action in shown]
        assert not any(a and b for a, b in pairwise(lines)), station
