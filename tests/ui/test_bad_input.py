"""What the window says of bad input: one message that names the file, nothing lost."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import tifffile
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from PySide6.QtWidgets import QDialog, QFileDialog, QPushButton

from mbstudio.core.project import Project, ProjectState
from mbstudio.ui.stations.scan.dialog import ScanDialog
from tests.ui.conftest import PATIENCE


def drop(window, *paths):
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    event = QDropEvent(
        QPointF(400, 300),
        Qt.DropAction.CopyAction,
        data,
        Qt.MouseButton.LeftButton,
        Qt.KeyboardModifier.NoModifier,
    )
    window.dropEvent(event)


@pytest.fixture
def bad_files(tmp_path, scan_path):
    whole = scan_path.read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty.tif").write_bytes(b"")
    (tmp_path / "text.mbs").write_text("no project")
    (tmp_path / "holiday.docx").write_bytes(b"PK\x03\x04")
    np.save(tmp_path / "constant.npy", np.full((20, 20, 20), 7, dtype=np.uint8))
    slices = tmp_path / "slices"
    slices.mkdir()
    for number, side in enumerate((20, 20, 24)):
        tifffile.imwrite(slices / f"slice_{number}.tif", np.zeros((side, side), np.uint8))
    return tmp_path


@pytest.mark.parametrize(
    "name", ["cut.tif", "empty.tif", "text.mbs", "holiday.docx", "slices", "missing.tif"]
)
def test_a_bad_file_is_one_message_and_the_project_stays(segmented, idle, bad_files, name, qtbot):
    window = segmented
    before = window.workspace.state
    with qtbot.captureExceptions() as exceptions:
        if name.endswith(".mbs"):
            drop(window, bad_files / name)
        else:
            window.stations.scan.work.open(bad_files / name, "14 um")
        idle()
    assert not exceptions
    assert window.messages.level == "error"
    assert name in window.messages.text
    assert "Traceback" not in window.messages.text
    assert "bug in mbstudio" not in window.messages.text
    assert window.workspace.state is before


def test_voxels_that_are_all_equal_hold_no_grains(window, idle, bad_files):
    window.stations.scan.work.open(bad_files / "constant.npy", "14 um")
    idle()
    assert window.commands.run("grains.find")
    idle()
    assert window.messages.level == "error"
    assert window.workspace.state.grains is None


def test_voxels_that_are_no_numbers_are_refused(window, idle, tmp_path):
    voxels = np.random.default_rng(0).random((12, 12, 12)).astype(np.float32)
    voxels[5, 4, 3] = np.nan
    np.save(tmp_path / "broken.npy", voxels)
    window.stations.scan.work.open(tmp_path / "broken.npy", "14 um")
    idle()
    window.commands.run("grains.find")
    idle()
    assert window.messages.level == "error"
    assert "broken.npy" in window.messages.text
    assert window.workspace.state.grains is None


def test_half_a_project_file_is_refused(segmented, idle, tmp_path):
    window = segmented
    window.project_work.save(tmp_path / "whole.mbs")
    idle()
    before = window.workspace.state
    content = (tmp_path / "whole.mbs").read_bytes()
    (tmp_path / "half.mbs").write_bytes(content[: len(content) // 2])
    drop(window, tmp_path / "half.mbs")
    idle()
    assert window.messages.level == "error"
    assert "half.mbs" in window.messages.text
    assert window.workspace.state is before


def test_a_mesh_is_no_scan(window, idle, tmp_path):
    (tmp_path / "stone.ply").write_text("ply")
    drop(window, tmp_path / "stone.ply")
    idle()
    assert window.messages.level == "error"
    assert "stone.ply" in window.messages.text


def test_more_control_points_than_a_grain_can_hold(segmented, idle, qtbot):
    window = segmented
    labels = window.workspace.state.grains.interior_labels
    window.workspace.select(labels[0])
    window.workspace.change_fit_settings(n=100_000)
    with qtbot.captureExceptions() as exceptions:
        window.commands.run("fit.grain")
        idle()
    assert not exceptions
    assert window.messages.level == "error"
    assert "or fewer" in window.messages.text
    assert not window.workspace.state.fits


def test_a_scan_without_voxel_size_is_asked_about(window, idle, tmp_path):
    path = tmp_path / "plain.npy"
    np.save(path, np.random.default_rng(0).integers(0, 255, (12, 12, 12)).astype(np.uint8))
    drop(window, path)
    idle()
    (dialog,) = window.findChildren(ScanDialog)
    assert not dialog.open_button.isEnabled()
    for wrong in ("-3", "0", "fourteen", "1 x 2"):
        dialog.size_field.setText(wrong)
        assert not dialog.open_button.isEnabled(), wrong
    dialog.size_field.setText("20 x 14 x 14")
    dialog.unit_field.setCurrentIndex(dialog.unit_field.findData("um"))
    dialog.open_button.click()
    idle()
    assert window.workspace.scan.voxel_size.zyx == (20, 14, 14)


def test_a_raw_file_shorter_than_its_shape_cannot_be_opened(window, idle, tmp_path):
    path = tmp_path / "short.raw"
    path.write_bytes(bytes(1000))
    window.project_files.open_path(path)
    (dialog,) = window.findChildren(ScanDialog)
    dialog.size_field.setText("14")
    for field in dialog.shape_fields:
        field.setValue(11)
    dialog.type_field.setCurrentText("uint8")
    assert not dialog.open_button.isEnabled()
    assert "1,331 bytes" in dialog._problem.text()
    for field in dialog.shape_fields:
        field.setValue(10)
    assert dialog.open_button.isEnabled()
    dialog.open_button.click()
    idle()
    assert window.workspace.scan.shape == (10, 10, 10)
    assert not [box for box in window.findChildren(QDialog) if box.isVisible()]


def test_labels_of_another_shape_are_refused(segmented, idle, tmp_path):
    window = segmented
    before = window.workspace.state.grains
    np.save(tmp_path / "labels.npy", np.ones((5, 5, 5), dtype=np.int32))
    window.stations.grains.work.load(tmp_path / "labels.npy")
    idle()
    assert window.messages.level == "error"
    assert window.workspace.state.grains is before


def test_a_folder_that_cannot_be_written_loses_nothing(segmented, idle, tmp_path):
    window = segmented
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    window.project_work.save(blocked / "sand.mbs")
    idle()
    assert window.messages.level == "error"
    assert str(blocked) in window.messages.text
    assert window.workspace.is_modified
    assert blocked.read_text() == "in the way"


def test_an_unexpected_error_is_a_message_too(window, idle, caplog):
    from mbstudio.ui.workers import Task

    def fail(control):
        raise ZeroDivisionError("division by zero")

    window.queue.submit(Task("Counting", fail))
    idle()
    assert window.messages.level == "error"
    assert "ZeroDivisionError" in window.messages.text
    assert "Counting failed" in caplog.text


def test_two_files_at_once_are_too_many(window, scan_path):
    drop(window, scan_path, scan_path)
    assert window.messages.level == "warning"
    assert window.queue.is_idle


@pytest.fixture
def messages(window):
    """Every message that is shown, with its level."""
    said = []
    window.messages.shown.connect(lambda level, text: said.append((level, text)))
    return said


def test_a_project_of_a_newer_version_is_refused_and_says_what_to_do(
    segmented, idle, tmp_path, messages, edit_project
):
    window = segmented
    before = window.workspace.state
    Project(ProjectState(fit_settings=before.fit_settings)).save(tmp_path / "tomorrow.mbs")
    with edit_project(tmp_path / "tomorrow.mbs") as file:
        file.attrs["schema"] = 99
        file.attrs["written_by"] = "mbstudio 9.0"
    drop(window, tmp_path / "tomorrow.mbs")
    idle()
    ((level, text),) = messages
    assert level == "error"
    assert "tomorrow.mbs was written by mbstudio 9.0" in text
    assert "update mbstudio" in text
    assert window.workspace.state is before


@pytest.fixture
def moved_scan(window, idle, tmp_path, scan_path):
    """A project file whose scan lies elsewhere now, and that place."""
    scan = shutil.copy(scan_path, tmp_path / "scan.tif")
    window.stations.scan.work.open(scan, "14 um")
    idle()
    assert window.commands.run("grains.find")
    idle()
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    window.project_files.new_project()
    (tmp_path / "elsewhere").mkdir()
    return tmp_path / "sand.mbs", shutil.move(scan, tmp_path / "elsewhere" / "scan.tif")


def test_a_missing_scan_is_asked_for_and_work_goes_on_without(
    window, idle, moved_scan, messages, monkeypatch, tmp_path
):
    project, scan = moved_scan
    messages.clear()
    window.project_files.open_path(project)
    idle()
    (warning,) = [text for level, text in messages if level == "warning"]
    assert "scan.tif does not exist" in warning
    assert "command line" not in warning
    assert window.workspace.scan is None
    assert len(window.workspace.state.grains) == 3, "grains are there without the scan"
    (locate,) = [button for button in window.messages.findChildren(QPushButton) if button.text() == "Locate…"]
    # Another scan in its place is refused, and asked for again.
    np.save(tmp_path / "other.npy", np.zeros((8, 8, 8), np.uint8))
    answers = [str(tmp_path / "other.npy"), str(scan)]
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *args: (answers.pop(0), ""))
    locate.click()
    idle()
    assert "other.npy is not the scan" in window.messages.text
    assert window.workspace.scan is None
    locate.click()
    idle()
    assert window.workspace.scan.shape == (64, 64, 64)
    assert window.workspace.state.scan.path == scan
    assert window.messages.level == "success"
    assert len(window.workspace.state.grains) == 3


def test_closing_while_a_fit_runs_keeps_what_it_has_reached(segmented, idle, tmp_path, qtbot):
    window = segmented
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    label = window.workspace.state.grains.interior_labels[0]
    window.workspace.select(label)
    window.stations.fit.panel.method.setCurrentIndex(window.stations.fit.panel.method.findData("paper"))
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    assert window.commands.run("fit.grain")
    qtbot.waitUntil(lambda: len(window.stations.fit.curve.losses) > 3, timeout=PATIENCE)
    assert not window.workspace.is_modified
    window.project_files.asks = True
    window.close()
    window.project_files.leaving.cancel.click()
    assert window.isVisible()
    assert window.stations.fit.work.run.is_running, "called off: it goes on"
    window.close()
    assert f"“Fitting grain {label}” is still running" in window.project_files.leaving.text
    window.project_files.leaving.save.click()
    qtbot.waitUntil(lambda: not window.isVisible(), timeout=PATIENCE)
    with Project.open(tmp_path / "sand.mbs") as saved:
        assert list(saved.fits) == [label]


def test_closing_while_tasks_queue_ends_them_all(window, idle, qtbot):
    from mbstudio.ui.workers import Task

    begun = []

    def endless(control):
        begun.append(control)
        while True:
            control.progress(0.5)

    for _ in range(3):
        window.queue.submit(Task("Counting", endless))
    qtbot.waitUntil(lambda: bool(begun), timeout=PATIENCE)
    window.close()
    assert not window.isVisible()
    assert len(begun) == 1, "what waited never began"


def test_an_unplugged_drive_loses_nothing(segmented, idle, tmp_path, messages):
    window = segmented
    drive = tmp_path / "drive"
    drive.mkdir()
    window.project_work.save(drive / "sand.mbs")
    idle()
    shutil.rmtree(drive)
    window.workspace.change_fit_settings(n=77)
    messages.clear()
    window.project_files.save()
    idle()
    ((level, text),) = messages
    assert level == "error"
    assert "sand.mbs cannot be saved" in text
    assert window.workspace.is_modified
    assert window.workspace.state.fit_settings.n == 77
    # Elsewhere it can be saved.
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    with Project.open(tmp_path / "sand.mbs") as saved:
        assert saved.state.fit_settings.n == 77
        assert len(saved.grains) == 3
