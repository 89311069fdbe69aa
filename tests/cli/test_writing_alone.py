"""Commands that write a project: one at a time, and nothing of others is replaced."""

from __future__ import annotations

import shutil

import pytest

from mbstudio.core.project import FitSettings, Project
from mbstudio.core.project.lock import ProjectLock


@pytest.fixture
def path(fitted_project, tmp_path):
    return shutil.copy(fitted_project, tmp_path / "sand.mbs")


def names(path):
    return sorted(entry.name for entry in path.parent.iterdir())


@pytest.mark.parametrize("command", [("fit",), ("segment", "-o")])
def test_a_project_in_use_is_refused_before_the_work_begins(mbstudio, path, command):
    before = path.read_bytes()
    output = (path,) if "-o" in command else ()
    with ProjectLock.take(path, "the window"):
        ran = mbstudio(command[0], path, *command[1:], *output)
    assert ran.code == 1
    assert "sand.mbs is in use: the window of" in ran.err
    assert path.read_bytes() == before
    assert names(path) == ["sand.mbs"]


def test_nothing_of_the_lock_stays(mbstudio, path):
    assert mbstudio("fit", path, "-n", 12, "--workers", 0).code == 0
    assert names(path) == ["sand.mbs"]
    assert mbstudio("fit", path, "--grains", 999).code == 1
    ProjectLock.take(path, "the window").release()
    assert names(path) == ["sand.mbs"]


def test_a_file_that_others_wrote_meanwhile_stays_and_the_work_is_saved_beside_it(
    mbstudio, path, monkeypatch
):
    from mbstudio.cli import fit

    work = fit.fit_into

    def and_others_write(project, *more):
        outcome = work(project, *more)
        theirs = Project.open(path, journal=False)
        theirs.change("Settings", fit_settings=FitSettings(n=77))
        monkeypatch.setattr(theirs, "_lock", project._lock)  # a program that knows neither locks nor journals
        theirs.save()
        monkeypatch.setattr(theirs, "_lock", None)
        return outcome

    monkeypatch.setattr(fit, "fit_into", and_others_write)
    ran = mbstudio("fit", path, "-n", 8, "--workers", 0)
    assert ran.code == 1
    assert "was written by another program" in ran.err
    assert "sand (2).mbs" in ran.err
    assert Project.open(path).state.fit_settings.n == 77
    assert {fit.n for fit in Project.open(path.with_name("sand (2).mbs")).fits.values()} == {8}
    assert names(path) == ["sand (2).mbs", "sand.mbs"]
