"""Avatars that the window finishes are on the disk at once, and go with what is given up."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import warnings

import pytest

from mbstudio.core.project import Autosave, Project, ProjectState
from mbstudio.core.project.fit_journal import find_fits, journal_path
from mbstudio.core.project.merging import same_fit
from mbstudio.ui.shell.autosave_work import autosave_folder
from tests.ui.conftest import PATIENCE

# Fits all grains and is killed by its own hand when the first has arrived; then nothing was autosaved since.
PROGRAM = """
import os, signal, sys, json
from PySide6.QtCore import QTimer
from mbstudio.core.project.project import Project
from mbstudio.ui.shell import app
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.stations.fit import work

application = app.make_application()
project, is_saved = sys.argv[1], sys.argv[2] == "saved"
done = set()
keep = Project.keep_finished

def keep_and_die(self, fits, grains=None):
    trouble = keep(self, fits, grains)
    (label,) = fits
    if is_saved or list(autosaves()._own.folder.glob("note.json")):
        print(json.dumps({"done": label, "trouble": trouble}), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    return trouble

def window():
    return next((w for w in application.topLevelWidgets() if isinstance(w, MainWindow)), None)

def autosaves():
    return window().shell.autosaves

def work():
    if window() is None or window().workspace.state.grains is None or done:
        return
    done.add("begun")
    Project.keep_finished = keep_and_die
    if not is_saved:  # as if it had never been saved
        space = window().workspace
        space.replace_project(Project(space.state))
        space.project._saved_state = None
    window().workspace.change_fit_settings(n=5)
    window().stations.fit.work.fit_all()

timer = QTimer()
timer.timeout.connect(work)
timer.start(50)
sys.exit(app.run(project_path=project))
"""


@pytest.fixture
def path(tmp_path, two_grains):
    path = tmp_path / "sand.mbs"
    Project(ProjectState(grains=two_grains)).save(path)
    return path


@pytest.fixture
def opened(window, idle, path):
    """The window with a project of two grains that it holds."""
    window.project_files.open_path(path)
    idle()
    assert window.workspace.project.is_held
    window.workspace.change_fit_settings(n=5)
    return window


def killed(tmp_path, path, kind):
    """Run the program until it is killed; return the label that it had told to be done."""
    home = tmp_path / "config"
    (home / "mbstudio").mkdir(parents=True)
    (home / "mbstudio" / "mbstudio.ini").write_text("[autosave]\nseconds=30\n[tour]\nseen=1\n")
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path), kind],
        env=os.environ | {"XDG_CONFIG_HOME": str(home)}, capture_output=True, text=True,
        timeout=PATIENCE / 1000,
    )  # fmt: skip
    assert ran.returncode == -signal.SIGKILL, ran.stderr
    told = json.loads(ran.stdout.splitlines()[-1])
    assert told["trouble"] == ""
    return told["done"]


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL")
def test_a_killed_window_leaves_what_was_finished_beside_the_project(tmp_path, path, window, idle, messages):
    label = killed(tmp_path, path, "saved")
    window.project_files.open_path(path)
    idle()
    assert list(window.workspace.state.fits) == [label]
    assert window.workspace.is_modified
    assert "1 avatar that had not been saved came back from sand.mbs.journal" in messages()
    window.project_files.save()
    idle()
    assert not journal_path(path).exists()
    assert list(Project.open(path).fits) == [label]


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL")
def test_a_killed_window_leaves_what_was_finished_with_the_autosave_where_there_is_no_file(
    tmp_path, path, window, idle, qtbot, messages
):
    label = killed(tmp_path, path, "untitled")
    assert not journal_path(path).exists()
    window.shell.autosaves.look()
    idle()
    (left,) = window.shell.autosaves.leftovers
    assert find_fits(left.journal).fits
    window.shell.restore(left)
    idle()
    assert label in window.workspace.state.fits
    assert "1 avatar. Save it" in messages()
    window.shell.autosaves.write_now()
    idle()


@pytest.fixture
def messages(window):
    """Return what the window has said."""
    said = []
    window.shell.autosaves.said.connect(lambda _, text: said.append(text))
    window.shell._project_work.said.connect(lambda _, text: said.append(text))
    window.stations.fit.work.said.connect(lambda _, text: said.append(text))
    return lambda: " ".join(said)


def test_a_run_over_all_grains_and_a_single_fit_go_to_the_journal(opened, idle, path):
    opened.stations.fit.work.fit_all()
    idle()
    assert sorted(find_fits(journal_path(path)).fits) == [1, 2]
    opened.workspace.undo()
    assert not find_fits(journal_path(path)).fits
    opened.stations.fit.work.fit(2)
    idle()
    assert list(find_fits(journal_path(path)).fits) == [2]
    opened.project_files.save()
    idle()
    assert not journal_path(path).exists()


def test_discarded_work_does_not_come_back(opened, idle, path, qtbot):
    opened.stations.fit.work.fit(2)
    idle()
    assert journal_path(path).exists()
    opened.project_files.asks = True
    opened.project_files.new_project()
    opened.project_files.leaving.answered.emit("discard")
    idle()
    assert opened.workspace.state.grains is None
    assert not journal_path(path).exists()
    opened.project_files.asks = False


def test_a_project_that_others_use_keeps_its_journal_to_them(window, idle, path):
    window.shell.autosaves.set_seconds(3600)
    theirs = Project.open(path)
    theirs.hold("a test")
    window.project_files.open_path(path)
    idle()
    window.workspace.change_fit_settings(n=5)
    window.stations.fit.work.fit(2)
    idle()
    assert not journal_path(path).exists()
    (folder,) = (entry for entry in autosave_folder().iterdir() if entry.is_dir())
    assert 2 in window.workspace.state.fits
    journal = find_fits(folder / "avatars.journal")
    if journal is None:  # the autosave that begins with the journal came after the avatar, and holds it
        kept = json.loads((folder / "note.json").read_text(encoding="utf-8"))
        assert kept["fits"] == len(window.workspace.state.fits)
    else:
        assert list(journal.fits) == [2]
    theirs.close()


def test_the_first_grains_are_written_at_once(scanned, idle):
    scanned.shell.autosaves.write_now()
    idle()
    scanned.shell.autosaves.set_seconds(30)
    assert scanned.commands.run("grains.find")
    idle()
    (note,) = autosave_folder().glob("*/note.json")
    assert json.loads(note.read_text())["grains"] == 3


def test_restored_work_is_in_the_journal_until_it_is_written_again(window, idle, two_grains, path):
    """A window that is killed twice loses nothing of the first time."""
    left = Autosave.begin(autosave_folder())
    state = ProjectState(grains=two_grains)
    left.write(state)
    window.workspace.replace_project(Project(state))
    window.workspace.change_fit_settings(n=5)
    window.stations.fit.work.fit(2)
    idle()
    fit = window.workspace.state.fits[2]
    crashed = Project(state)
    assert crashed.begin_journal(left.journal)
    crashed.keep_finished({2: fit})
    crashed.close()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        restored = left.restore()
    assert same_fit(fit, restored.fits[2])
    assert restored.begin_journal(left.journal)
    assert list(find_fits(left.journal).fits) == [2]
    restored.save(path)
    assert not left.journal.exists()
    restored.close()
    left.discard()
