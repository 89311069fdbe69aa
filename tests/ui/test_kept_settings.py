"""Whatever stands in the file of the settings, the window opens and works."""

from __future__ import annotations

import json
from random import Random

import numpy as np
import pytest
from PySide6.QtCore import QByteArray, QSettings

import mbstudio
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project, ProjectState
from mbstudio.ui.kept_settings import places, record, see_from, stored_bytes, whole_number, words
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.theme import Theme
from tests.ui.conftest import PATIENCE, delete_later_now

NAMES = (
    "theme", "geometry", f"layout/{mbstudio.__version__}", "layout/sized", "layout/hidden", "layout/kept",
    "layout/cameras", "recent", "table/hidden", "work/processes", "autosave/seconds", "picture_scale",
    "slice_views", "meshes/unit", "meshes/resolution", "tour/seen",
)  # fmt: skip
VALUES = (
    "", "0", "-1", "1.5", "inf", "nan", "9" * 5000, "9" * 12, "²", "\0", "x" * 5000, "../..", "/root/none",
    QByteArray(b"\xff" * 300), ["a", "b"], ["\0", "x" * 300], {"a": 1}, "[" * 100_000, "{" * 3000,
    '{"home": 5, "grains": {"a": []}, "scan": [[1], {}]}', '{"grains": true}', "[1, 2]", "null", '{"a": NaN}',
    -7, 10**15, 2.5, True,
)  # fmt: skip
CAMERAS = (
    5, [], [1, 2, 3], [[0, 0, 0]] * 3, [[1, 2, 3], [1, 2, 3], [0, 0, 1]], [[0, 0, 5], [0, 0, 0], [0, 0, 1]],
    [[1e308] * 3, [0, 0, 0], [0, 0, 1]], [[float("nan")] * 3, [0, 0, 0], [0, 0, 1]], ["abc", "def", "ghi"],
    [[True, 0, 0], [0, 0, 0], [0, 0, 1]], [[1, 2], [0, 0], [0, 1]], [[10**400, 0, 0], [0, 0, 0], [0, 0, 1]],
)  # fmt: skip


def a_project(folder):
    labels = np.zeros((9, 10, 11), np.int32)
    labels[2:6, 2:6, 2:6] = 1
    project = Project(ProjectState(grains=load_labels(labels, voxel_size="1 um")))
    path = project.save(folder / "grains.mbs")
    project.close()
    return path


def open_and_close(qtbot, qapp, settings, path):
    theme = Theme(settings)
    window = MainWindow(settings, theme)
    window.project_files.asks = False
    window.show()
    window.project_files.open_path(path)
    qtbot.waitUntil(lambda: window.queue.is_idle and window.workspace.project.path == path, timeout=PATIENCE)
    for station in [station.id for station in window.stations]:
        window.enter(station)
    for _ in range(3):
        qapp.processEvents()
    assert window.workspace.state.grains is not None
    camera = window.viewport.plotter.camera
    assert np.isfinite([camera.position, camera.focal_point, camera.up]).all()
    assert path.resolve() in window.workspace.recent
    window.close()
    assert window.queue.is_idle or window.queue.shut_down()
    window.deleteLater()
    theme.deleteLater()
    delete_later_now()


@pytest.mark.parametrize("seed", range(4))
def test_the_window_opens_whatever_the_settings_say(qtbot, qapp, tmp_path, seed):
    path, random = a_project(tmp_path), Random(seed)
    settings = QSettings(str(tmp_path / "settings.ini"), QSettings.Format.IniFormat)
    for name in NAMES:
        settings.setValue(name, random.choice(VALUES))
    camera = CAMERAS[seed * 3 : seed * 3 + 3]
    settings.setValue("layout/kept", 1)
    settings.setValue("layout/cameras", json.dumps({str(path.resolve()): camera[seed % 3]}))
    settings.setValue("tour/seen", 1)
    open_and_close(qtbot, qapp, settings, path)


def test_the_window_opens_with_a_damaged_file_of_settings(qtbot, qapp, tmp_path):
    path, random = a_project(tmp_path), Random(5)
    file = tmp_path / "settings.ini"
    settings = QSettings(str(file), QSettings.Format.IniFormat)
    settings.setValue("tour/seen", 1)
    open_and_close(qtbot, qapp, settings, path)
    settings.sync()
    content = bytearray(file.read_bytes())
    for _ in range(300):
        content[random.randrange(len(content))] = random.randrange(256)
    file.write_bytes(content)
    damaged = QSettings(str(file), QSettings.Format.IniFormat)
    damaged.setValue("tour/seen", 1)
    open_and_close(qtbot, qapp, damaged, path)


@pytest.mark.parametrize("value", VALUES, ids=lambda value: repr(value)[:20])
def test_every_value_is_read_as_what_it_must_be(tmp_path, value):
    settings = QSettings(str(tmp_path / "settings.ini"), QSettings.Format.IniFormat)
    settings.setValue("a", value)
    assert 3 <= whole_number(settings, "a", 5, 3, 9) <= 9
    assert isinstance(record(settings, "a"), dict)
    assert all(isinstance(word, str) for word in words(settings.value("a")))
    found = stored_bytes(settings, "a")
    assert found is None or isinstance(found, QByteArray)


def test_sound_values_are_kept(tmp_path):
    settings = QSettings(str(tmp_path / "settings.ini"), QSettings.Format.IniFormat)
    for given, wanted in (("7", 7), (8, 8), ("6.0", 6), ("100", 9), ("1", 3), ("-4", 5)):
        settings.setValue("a", given)
        assert whole_number(settings, "a", 5, 3, 9) == wanted
    settings.setValue("a", json.dumps({"home": ["tasks"]}))
    assert record(settings, "a") == {"home": ["tasks"]}
    assert words(["tasks"]) == ["tasks"]
    assert words(["tasks", 1]) == words("tasks") == words({"a": 1}) == []


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda value: repr(value)[:30])
def test_a_camera_that_sees_nothing_is_not_taken(camera):
    assert see_from(camera) is None


def test_a_sound_camera_is_taken():
    camera = [[10, -20.5, 3e5], [0, 0, 0], [0, 1, 0.5]]
    assert see_from(camera) == places(camera) == [[10.0, -20.5, 3e5], [0.0, 0.0, 0.0], [0.0, 1.0, 0.5]]
