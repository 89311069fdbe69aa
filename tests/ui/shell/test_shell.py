"""What belongs to no station: history, log, preferences, cheat sheet, guide, tour, layout, autosave."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from dataclasses import replace

import pytest
from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton

import mbstudio
from mbstudio.core.batch.processes import limit_processes, process_limit, processors, usable_cores
from mbstudio.core.errors import ProjectError
from mbstudio.core.project import Autosave, Project, ProjectState
from mbstudio.ui.shell.autosave_work import autosave_folder
from mbstudio.ui.shell.dialogs.about import AboutBox
from mbstudio.ui.shell.dialogs.cheat_sheet import shortcuts
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.workers import Task
from tests.ui.conftest import PATIENCE, delete_later_now


@pytest.fixture
def another_window(settings, theme, qtbot):
    """Make a further window, as a program that was started beside or afterwards."""
    made = []

    def make():
        window = MainWindow(settings, theme)
        window.project_files.asks = False
        window.show()
        made.append(window)
        return window

    yield make
    for window in made:
        window.close()
        window.deleteLater()
    delete_later_now()


# ---- history ---------------------------------------------------------------------------------------


def test_a_click_in_the_history_goes_back_and_forth(with_grains, idle):
    window = with_grains
    for n in (50, 60, 70):
        window.workspace.change(f"Take {n}", fit_settings=replace(window.workspace.state.fit_settings, n=n))
    assert window.commands.run("panel.history")
    history = window.shell.history
    assert [history.item(row).text() for row in range(4)] == ["Beginning", "Take 50", "Take 60", "Take 70"]
    for row, n in ((1, 50), (0, 40), (3, 70)):
        QTest.mouseClick(
            history.viewport(),
            Qt.MouseButton.LeftButton,
            pos=history.visualItemRect(history.item(row)).center(),
        )
        assert window.workspace.state.fit_settings.n == n
        assert history.currentRow() == row
        assert history.count() == 4, "what was undone can still be made again"
    window.undo.undo()
    assert history.currentRow() == 2
    with pytest.raises(ProjectError, match="3 changes, not 4"):
        window.workspace.go_to(4)


def test_the_history_goes_on_where_the_file_was_saved(with_grains, idle, tmp_path):
    window = with_grains
    settings = window.workspace.state.fit_settings
    window.workspace.change("Take 50", fit_settings=replace(settings, n=50))
    window.workspace.project.save(tmp_path / "sand.mbs")
    window.project_files.open_path(tmp_path / "sand.mbs")
    idle()
    window.workspace.change("Take 60", fit_settings=replace(settings, n=60))
    assert window.commands.run("panel.history")
    history = window.shell.history
    told = [history.item(row).text() for row in range(history.count())]
    assert told[-3:] == ["Take 50", "Project as it was opened", "Take 60"]
    assert history.currentRow() == len(told) - 1
    for row, n in ((len(told) - 3, 60), (len(told) - 2, 50)):
        history.scrollToItem(history.item(row))
        place = history.visualItemRect(history.item(row)).center()
        QTest.mouseClick(history.viewport(), Qt.MouseButton.LeftButton, pos=place)
        assert window.workspace.state.fit_settings.n == n, "what came before the file cannot be gone back to"


# ---- log -------------------------------------------------------------------------------------------


def test_the_log_keeps_what_was_said_by_level(window):
    window.messages.say("info", "a hint")
    window.messages.say("error", "a mishap")
    logging.getLogger("mbstudio.core").warning("from the depth")
    QCoreApplication.processEvents()
    panel = window.shell.log
    assert [line.split(": ")[1] for line in panel.text().splitlines()] == [
        "a hint",
        "a mishap",
        "from the depth",
    ]
    panel.level.setCurrentIndex(panel.level.findData(logging.WARNING))
    assert "a hint" not in panel.text()
    assert panel.list.count() == 2
    panel.level.setCurrentIndex(panel.level.findData(logging.ERROR))
    assert panel.list.count() == 1
    panel.clear()
    assert panel.text() == ""


# ---- preferences -----------------------------------------------------------------------------------


def test_preferences_take_effect_at_once_and_stay(window, settings, qtbot):
    before = process_limit()
    try:
        assert window.commands.run("window.preferences")
        preferences = window.shell._preferences
        assert not preferences.isModal()
        preferences.theme.setCurrentIndex(preferences.theme.findData("dark"))
        assert window.theme.is_dark
        preferences.processes.setValue(1)
        assert usable_cores() == 1
        preferences.processes.setValue(0)
        assert usable_cores() == processors()
        preferences.seconds.setValue(2)
        assert preferences.seconds.value() == preferences.seconds.minimum() == 5
        preferences.seconds.setValue(12)
        assert window.shell.autosaves.seconds == 12
        assert window.commands.run("window.preferences")
        assert window.shell._preferences is preferences, "opened once, not twice"
        preferences.close()
        delete_later_now()
        assert window.shell._preferences is None
    finally:
        limit_processes(before)


def test_a_spoilt_setting_does_not_stop_the_start(settings, another_window):
    settings.setValue("autosave/seconds", "often")
    settings.setValue("work/processes", "many")
    settings.setValue("layout/hidden", "{")
    settings.setValue("layout/cameras", "[]")
    window = another_window()
    assert window.shell.autosaves.seconds == 20
    assert process_limit() is None


# ---- help ------------------------------------------------------------------------------------------


def test_no_two_commands_have_the_same_keys(window):
    keys = Counter(
        keys.toString()
        for command in window.commands
        for keys in window.commands.action(command.id).shortcuts()
    )
    # Esc closes the message above the view, and means the measurements where there is none.
    assert [name for name, count in keys.items() if count > 1 and name != "Esc"] == []


def test_the_cheat_sheet_shows_every_shortcut(window, qtbot):
    listed = {title for group in shortcuts(window.commands).values() for title, _ in group}
    wanted = {command.title.rstrip(".…") for command in window.commands if command.shortcut}
    assert listed == wanted
    qtbot.keyClick(window, "?")
    sheet = window.shell._sheet
    assert sheet is not None
    assert sheet.isVisible()
    assert window.rect().contains(sheet.geometry())
    qtbot.keyClick(sheet, Qt.Key.Key_A)
    assert not sheet.isVisible()


def test_the_question_mark_of_a_panel_opens_the_guide_there(window, idle):
    for station in window.stations:
        window.enter(station.id)
        QTest.mouseClick(station.panel.help, Qt.MouseButton.LeftButton)
        idle()
        assert window.shell._guide.heading() == station.guide


def test_the_tour_has_five_steps_and_comes_once(window, settings):
    window.shell.begin()
    tour = window.shell._tour
    titles = []
    while tour.isVisible():
        titles.append(tour._title.text())
        assert window.rect().contains(tour.geometry()), titles[-1]
        QTest.mouseClick(tour.next, Qt.MouseButton.LeftButton)
    assert len(set(titles)) == 5
    assert settings.value("tour/seen")
    window.shell.begin()
    assert not tour.isVisible()


# ---- layout ----------------------------------------------------------------------------------------


def test_what_was_hidden_at_a_station_stays_hidden_there(with_grains, idle, another_window, two_grains):
    window = with_grains
    window.enter("fit")
    assert window.commands.run("panel.curve")
    assert window.docks["curve"].isHidden()
    window.enter("grains")
    window.enter("fit")
    assert window.docks["curve"].isHidden()
    assert not window.docks["table"].isHidden()
    window.close()
    later = another_window()
    later.workspace.replace_project(Project(ProjectState(grains=two_grains)))
    later.enter("fit")
    assert later.docks["curve"].isHidden()
    assert later.commands.run("panel.reset")
    assert not later.docks["curve"].isHidden()


def test_the_camera_of_a_project_comes_back(segmented, idle, tmp_path):
    window = segmented
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    window.view.look_from("left")
    window.viewport.plotter.camera.zoom(1.7)
    seen = [tuple(place) for place in window.viewport.plotter.camera_position]
    window.shell.memory.save_camera()
    window.project_files.new_project()
    window.view.look_from("top")
    window.project_files.open_path(tmp_path / "sand.mbs")
    idle()
    idle()
    for place, expected in zip(window.viewport.plotter.camera_position, seen, strict=True):
        assert tuple(place) == pytest.approx(expected, abs=1e-6)


# ---- autosave --------------------------------------------------------------------------------------


def cards(window):
    return [
        button
        for button in window.welcome.findChildren(QPushButton)
        if button.accessibleName().startswith("Rest")
    ]


def test_work_is_offered_after_a_crash_and_restored_unsaved(
    with_grains, idle, another_window, tmp_path, qtbot
):
    crashed = with_grains
    crashed.workspace.project.path = tmp_path / "sand.mbs"
    crashed.workspace.change("Work", fit_settings=replace(crashed.workspace.state.fit_settings, n=77))
    assert crashed.shell.autosaves.write_now() is not None
    idle()
    assert crashed.shell.autosaves.write_now() is None, "nothing new to write"
    beside = another_window()
    beside.shell.begin()
    qtbot.waitUntil(lambda: beside.queue.is_idle)
    assert not beside.shell.autosaves.leftovers, "the other window still runs"
    # As the system does when the program is killed.
    crashed.shell.autosaves._own.release()
    later = another_window()
    later.shell.begin()
    qtbot.waitUntil(lambda: bool(later.shell.autosaves.leftovers))
    later.shell._tour.end()
    (button,) = cards(later)
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: later.workspace.state.fit_settings.n == 77)
    assert len(later.workspace.state.grains) == 2
    assert later.workspace.project.path == tmp_path / "sand.mbs"
    assert later.isWindowModified()
    qtbot.waitUntil(lambda: not cards(later))
    qtbot.waitUntil(lambda: later.queue.is_idle)
    # It stays on the disk until it is saved.
    later.shell.autosaves._own.release()
    (found,) = Autosave.find_abandoned(autosave_folder())
    found.release()


def test_work_that_is_not_wanted_is_removed(window, idle, two_grains):
    left = Autosave.begin(autosave_folder())
    left.write(ProjectState(grains=two_grains))
    left.release()
    window.shell.begin()
    idle()
    (autosave,) = window.shell.autosaves.leftovers
    assert window.commands.action("project.restore").isEnabled()
    (remove,) = [b for b in window.welcome.findChildren(QPushButton) if b.text() == "Remove"]
    QTest.mouseClick(remove, Qt.MouseButton.LeftButton)
    assert not autosave.folder.exists()
    assert not window.commands.action("project.restore").isEnabled()


def test_work_that_cannot_be_read_is_not_offered_but_stays(window, idle, two_grains):
    left = Autosave.begin(autosave_folder())
    left.write(ProjectState(grains=two_grains))
    left.release()
    (left.folder / "note.json").write_text("{}")
    window.shell.begin()
    idle()
    assert not window.shell.autosaves.leftovers
    assert list(left.folder.glob("grains-*.mbs"))
    (found,) = Autosave.find_abandoned(autosave_folder())
    found.release()


def test_a_saved_project_and_a_clean_end_leave_nothing(with_grains, idle, tmp_path, another_window):
    window = with_grains
    window.workspace.change("Work", fit_settings=replace(window.workspace.state.fit_settings, n=77))
    window.shell.autosaves.write_now()
    idle()
    assert len(list(autosave_folder().glob("*/note.json"))) == 1
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    window.shell.autosaves.write_now()
    idle()
    assert not list(autosave_folder().glob("*/note.json"))
    window.workspace.change("More", fit_settings=replace(window.workspace.state.fit_settings, n=78))
    window.shell.autosaves.write_now()
    window.close()
    assert not list(autosave_folder().iterdir())


def test_avatars_that_arrive_one_by_one_are_kept_before_the_last_is_there(with_grains, idle):
    window = with_grains
    fits = window.stations.fit.work
    grains = window.workspace.state.grains
    item = type("Item", (), {"label": 1, "result": object()})()
    fits._arrived = (grains, [item])
    assert window.shell.autosaves.state_to_keep().fits[1] is item.result
    fits._arrived = (grains.without([1]), [item])  # of a grain that is not there as it was
    kept = window.shell.autosaves.state_to_keep()
    assert kept is None or 1 not in kept.fits


def test_an_autosave_that_fails_is_said_once(with_grains, idle, monkeypatch):
    window = with_grains

    def full(root):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Autosave, "begin", full)
    said = []
    window.messages.shown.connect(lambda level, text: said.append((level, text)))
    for n in (50, 60):
        window.workspace.change("Work", fit_settings=replace(window.workspace.state.fit_settings, n=n))
        window.shell.autosaves.write_now()
        idle()
    assert [level for level, _ in said] == ["warning"]
    assert "No space left" in said[0][1]
    assert window.workspace.state.fit_settings.n == 60


# ---- tasks -----------------------------------------------------------------------------------------


def test_a_project_is_saved_at_once_whatever_runs(with_grains, idle, qtbot, tmp_path):
    window, let_go = with_grains, threading.Event()

    def work(control):
        while not let_go.is_set():
            control.progress(0.5)
            time.sleep(0.01)

    task = window.queue.submit(Task("A long one", work))
    window.workspace.change_fit_settings(n=23)
    window.project_work.save(tmp_path / "sand.mbs")
    qtbot.waitUntil(lambda: window.project_work.saving is None, timeout=PATIENCE)
    assert task.state == "running"
    assert "Saved sand.mbs" in window.messages.text
    assert Project.open(tmp_path / "sand.mbs").state.fit_settings.n == 23
    assert not window.workspace.is_modified
    let_go.set()
    idle()


def test_what_leaves_the_project_waits_for_a_save_that_runs(with_grains, idle, qtbot, tmp_path, monkeypatch):
    window, let_go = with_grains, threading.Event()
    project, save = window.workspace.project, Project.save

    def slow(self, *given, **named):
        assert let_go.wait(60)
        return save(self, *given, **named)

    monkeypatch.setattr(Project, "save", slow)
    window.workspace.change_fit_settings(n=24)
    window.project_files.asks = True
    window.project_work.save(tmp_path / "sand.mbs")
    window.commands.run("project.new")
    assert window.workspace.project is project
    let_go.set()
    # All is saved by then, so that nothing is asked.
    qtbot.waitUntil(lambda: window.workspace.project is not project, timeout=PATIENCE)
    idle()
    assert window.project_files.leaving.text == ""
    assert Project.open(tmp_path / "sand.mbs").state.fit_settings.n == 24


def test_progress_never_goes_back(window, idle):
    seen = []

    def work(control):
        for fraction in (0.1, 0.6, 0.3, -1.0, 0.8):
            control.report(fraction, "a phase")

    task = Task("In phases", work)
    task.reported.connect(lambda report: seen.append(report.fraction))
    window.queue.submit(task)
    idle()
    assert seen == [0.1, 0.6, 0.6, 0.6, 0.8]


def test_a_waiting_task_is_taken_out_of_the_queue(window, idle, qtbot):
    let_go, done = threading.Event(), []

    def work(name):
        def run(control):
            while not let_go.is_set():
                control.progress(0.5, name)
                time.sleep(0.01)
            done.append(name)

        return run

    for name in ("first", "second", "third"):
        window.queue.submit(Task(f"The {name}", work(name)))
    strip = window.task_strip
    assert strip._title.text() == "The first"
    assert strip._queued.text() == "+ 2 waiting"
    strip._queued.click()
    rows = strip.tasks.rows
    assert [row.title.text() for row in rows] == ["The first", "The second", "The third"]
    assert [row._told.text() for row in rows[1:]] == ["Waiting", "Waiting"]
    qtbot.waitUntil(lambda: rows[0].bar.value() == 500, timeout=PATIENCE)
    rows[1].cancel.click()
    assert [row.title.text() for row in strip.tasks.rows] == ["The first", "The third"]
    assert strip._queued.text() == "+ 1 waiting"
    strip.tasks.close()
    let_go.set()
    idle()
    assert done == ["first", "third"]
    assert not strip.isVisible()


def test_system_information_is_copied(window, idle):
    window.about()
    (about,) = window.findChildren(AboutBox)
    (copy,) = [button for button in about.findChildren(QPushButton) if "system information" in button.text()]
    copy.click()
    told = QGuiApplication.clipboard().text()
    for words in (mbstudio.__version__, "Python", "vtk", "processors", "3-D view: software"):
        assert words in told
    about.close()
