"""One writer at a time, whoever it is and however it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
from dataclasses import replace

import pytest

from mbstudio.core.errors import ProjectChangedError, ProjectError, ProjectLockedError
from mbstudio.core.project import FitSettings, Project, ProjectState, lock
from mbstudio.core.project.file import write_project
from mbstudio.core.project.lock import ProjectLock
from tests.core.project.conftest import make_fit

HOLD = """
import sys, time
from pathlib import Path
from mbstudio.core.project.lock import ProjectLock
lock = ProjectLock.take(Path(sys.argv[1]), "mbstudio fit")
print("held", flush=True)
time.sleep(600)
"""


@pytest.fixture
def path(tmp_path, state):
    write_project(tmp_path / "sand.mbs", state)
    return tmp_path / "sand.mbs"


def test_a_second_writer_is_told_who_is_first(path):
    with ProjectLock.take(path, "the window"):
        with pytest.raises(
            ProjectLockedError, match=rf"sand\.mbs is in use: the window of .*process {os.getpid()}"
        ):
            ProjectLock.take(path, "mbstudio fit")
        assert json.loads((path.parent / "sand.mbs.lock").read_text())["program"] == "the window"
    assert not (path.parent / "sand.mbs.lock").exists()
    ProjectLock.take(path, "mbstudio fit").release()


def test_a_link_is_the_file_that_it_leads_to(path, tmp_path):
    link = tmp_path / "link.mbs"
    link.symlink_to(path)
    with ProjectLock.take(link, "the window"), pytest.raises(ProjectLockedError):
        ProjectLock.take(path, "mbstudio fit")


def test_a_lock_goes_with_its_process(path):
    holding = subprocess.Popen([sys.executable, "-c", HOLD, path], stdout=subprocess.PIPE)
    assert holding.stdout.readline() == b"held\n"
    with pytest.raises(ProjectLockedError, match=f"mbstudio fit of .*process {holding.pid}"):
        ProjectLock.take(path, "the window")
    holding.send_signal(signal.SIGTERM if os.name == "nt" else signal.SIGKILL)
    holding.wait()
    holding.stdout.close()
    ProjectLock.take(path, "the window").release()


def leave(path, **holder):
    told = {"program": "the window", "user": "eva", "host": lock.HOST, "process": 1, "since": "2026-11-30"}
    (path.parent / "sand.mbs.lock").write_text(json.dumps(told | holder))


def ended_process() -> int:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return ended.pid


def test_on_a_drive_without_locks_the_process_is_looked_for(path, monkeypatch):
    monkeypatch.setattr(lock, "try_lock", lambda stream: None)
    leave(path, process=os.getpid())
    with pytest.raises(ProjectLockedError, match="the window of eva"):
        ProjectLock.take(path, "mbstudio fit")
    leave(path, process=ended_process())
    with ProjectLock.take(path, "mbstudio fit"), pytest.raises(ProjectLockedError, match="mbstudio fit"):
        ProjectLock.take(path, "mbstudio fit")


def test_a_holder_on_another_machine_counts_until_its_file_is_removed(path):
    leave(path, host="lab-7", process=ended_process())
    with pytest.raises(ProjectLockedError, match=r"eva on lab-7 .*remove sand\.mbs\.lock"):
        ProjectLock.take(path, "mbstudio fit")
    (path.parent / "sand.mbs.lock").unlink()
    ProjectLock.take(path, "mbstudio fit").release()


@pytest.mark.parametrize("content", ["", "{", "[]", '{"program": 1}', '{"process": "x"}', "[" * 4000])
def test_a_lock_file_that_says_nothing_holds_nothing(path, content):
    (path.parent / "sand.mbs.lock").write_text(content)
    ProjectLock.take(path, "mbstudio fit").release()


def test_a_lock_that_was_removed_and_made_anew_is_seen(path, monkeypatch):
    """Between opening the file and locking it, its holder has removed it and another has made one."""
    take, held = lock.try_lock, []

    def others_first(stream):
        if not held:
            held.append(None)
            (path.parent / "sand.mbs.lock").unlink()
            held.append(ProjectLock.take(path, "another"))
        return take(stream)

    monkeypatch.setattr(lock, "try_lock", others_first)
    with pytest.raises(ProjectLockedError, match="another of"):
        ProjectLock.take(path, "mbstudio fit")
    held[1].release()


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(ProjectError, match=r"sand\.mbs cannot be saved"):
        ProjectLock.take(tmp_path / "missing" / "sand.mbs", "mbstudio fit")


# ------------------------------------------------------------------ projects


def test_a_held_project_keeps_others_from_saving(path):
    with Project.open(path) as ours, Project.open(path) as theirs:
        ours.hold("the window")
        theirs.change("Settings", fit_settings=FitSettings(n=9))
        with pytest.raises(ProjectLockedError, match="the window"):
            theirs.save()
        assert theirs.is_modified
        theirs.save(path.with_name("copy.mbs"))
        ours.save()
    assert sorted(entry.name for entry in path.parent.iterdir()) == ["copy.mbs", "sand.mbs"]


def test_a_held_project_holds_the_file_that_it_was_saved_as(path):
    with Project.open(path) as project:
        project.hold("the window")
        project.save(path.with_name("other.mbs"))
        with pytest.raises(ProjectLockedError):
            ProjectLock.take(path.with_name("other.mbs"), "mbstudio fit")
        ProjectLock.take(path, "mbstudio fit").release()


def test_a_failed_save_as_leaves_the_lock_where_it_was(path, monkeypatch):
    def full(*_):
        raise ProjectError("disk full")

    with Project.open(path) as project:
        project.hold("the window")
        monkeypatch.setattr("mbstudio.core.project.project.write_project", full)
        with pytest.raises(ProjectError, match="disk full"):
            project.save(path.with_name("other.mbs"))
        with pytest.raises(ProjectLockedError):
            ProjectLock.take(path, "mbstudio fit")
    assert [entry.name for entry in path.parent.iterdir()] == ["sand.mbs"]


def test_a_file_that_others_have_written_is_not_replaced(path, rng):
    ours, theirs = Project.open(path), Project.open(path)
    theirs.add_fits({11: make_fit(11, 4, rng)})
    theirs.save()
    ours.add_fits({12: make_fit(12, 4, rng)})
    with pytest.raises(ProjectChangedError, match=r"sand\.mbs was written by another program"):
        ours.save()
    assert sorted(Project.open(path).fits) == [2, 7, 11]
    merge = ours.merge_with_file()
    assert (merge.added, merge.in_both) == (1, ())
    ours.save()
    ours.save()
    assert sorted(Project.open(path).fits) == [2, 7, 11, 12]
    ours.undo()
    assert sorted(ours.fits) == [2, 7, 12]


def test_a_file_without_a_seal_that_has_changed_is_not_replaced(path, state):
    content = path.read_bytes()[512:]
    path.write_bytes(content)
    with pytest.warns(UserWarning, match="did not seal"):
        project = Project.open(path)
    path.write_bytes(content + b"\0")
    with pytest.raises(ProjectChangedError):
        project.save()


def test_a_file_that_was_removed_is_written_again(path):
    project = Project.open(path)
    path.unlink()
    project.save()
    assert path.exists()


# ------------------------------------------------------------------ many at once

ADD = textwrap.dedent("""
    import sys, time
    from pathlib import Path
    import numpy as np
    from mbstudio.core.errors import ProjectChangedError, ProjectLockedError
    from mbstudio.core.project import Project
    from tests.core.project.conftest import make_fit

    path, first, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    rng = np.random.default_rng(first)
    told = 0
    for label in range(first, first + count):
        project = Project.open(path)
        project.add_fits({label: make_fit(label, 3, rng)})
        while True:
            try:
                project.save()
                break
            except ProjectChangedError:
                told += 1
                project.merge_with_file()
            except ProjectLockedError:
                told += 1
                time.sleep(rng.uniform(0.01, 0.05))
    print(told)
""")


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("rounds", [5, pytest.param(50, marks=pytest.mark.full)])
def test_two_programs_that_write_one_project_lose_no_grain(path, rounds, repository):
    first, second = 100, 1000
    writers = [
        subprocess.Popen(
            [sys.executable, "-c", ADD, path, str(begin), str(rounds)],
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": str(repository)},
        )
        for begin in (first, second)
    ]
    told = [int(writer.communicate()[0]) for writer in writers]
    print("told", told)
    wanted = {2, 7, *range(first, first + rounds), *range(second, second + rounds)}
    assert set(Project.open(path).fits) == wanted
    assert [entry.name for entry in path.parent.iterdir()] == ["sand.mbs"]


def test_an_untitled_project_is_saved_and_held(tmp_path, state):
    project = Project(replace(state, fit_settings=FitSettings(n=5)))
    project.save(tmp_path / "new.mbs")
    project.hold("the window")
    assert project.is_held
    project.close()
    assert not project.is_held
    assert Project.open(tmp_path / "new.mbs").state.fit_settings.n == 5
    assert isinstance(project.state, ProjectState)
