"""Avatars that were finished and not saved come back where they belong, and nowhere else."""

from __future__ import annotations

import errno
import json
import shutil
import warnings
from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import JournalError, ProjectWarning
from mbstudio.core.journal_file import JournalWriter
from mbstudio.core.project import FitSettings, Project, fit_journal
from mbstudio.core.project.file import write_project
from mbstudio.core.project.fit_journal import find_fits, grains_digest, journal_path
from mbstudio.core.project.fit_table import pack_fit, unpack_fit
from mbstudio.core.project.stored import ContentError
from tests.core.project.conftest import make_fit
from tests.core.project.test_file import assert_same


@pytest.fixture
def path(tmp_path, state):
    """A project with grains and no avatars."""
    write_project(tmp_path / "sand.mbs", replace(state, fits={}))
    return tmp_path / "sand.mbs"


def killed(path, fits):
    """Leave what a program leaves that was killed after it had finished these fits."""
    project = Project.open(path)
    project.hold("a test")
    assert project.begin_journal()
    for label, fit in fits.items():
        assert project.keep_finished({label: fit}) == ""
    project.close()


def opened(path):
    """Open a project; return it and what was told."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        project = Project.open(path)
    return project, " ".join(str(one.message) for one in told)


def names(path):
    return sorted(entry.name for entry in path.parent.iterdir())


def test_every_field_of_a_fit_comes_back(rng):
    for label in (1, 2):
        fit = make_fit(label, 4, rng)
        fit = replace(fit, history=np.append(fit.history, [np.nan, np.inf]))
        came, back = unpack_fit(pack_fit(label, fit))
        assert came == label
        assert_same(fit, back)


def test_what_was_finished_comes_back_as_one_change_that_is_not_saved(path, rng):
    fits = {7: make_fit(7, 3, rng), 2: make_fit(2, 5, rng)}
    killed(path, fits)
    with pytest.warns(
        ProjectWarning, match="2 avatars that had not been saved came back from sand.mbs.journal"
    ):
        project = Project.open(path)
    for label, fit in fits.items():
        assert_same(fit, project.fits[label])
    assert project.brought_back.keys() == {2, 7}
    assert project.is_modified
    project.undo()
    assert not project.fits


def test_of_two_fits_of_a_grain_the_later_one_counts(path, rng):
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    later = make_fit(2, 6, rng)
    project.keep_finished({2: make_fit(2, 5, rng)})
    project.keep_finished({2: later})
    project.close()
    project, told = opened(path)
    assert "1 avatar that" in told
    assert_same(later, project.fits[2])


def test_looking_at_a_project_leaves_its_journal(path, rng):
    killed(path, {2: make_fit(2, 5, rng)})
    before = journal_path(path).read_bytes()
    for _ in range(2):
        with opened(path)[0] as project:
            assert 2 in project.fits
    assert journal_path(path).read_bytes() == before


@pytest.mark.parametrize("holds", [True, False])
def test_a_save_takes_the_journal_away(path, rng, holds):
    killed(path, {2: make_fit(2, 5, rng)})
    project, _ = opened(path)
    if holds:
        project.hold("a test")
        project.begin_journal()
    project.save()
    project.close()
    assert names(path) == ["sand.mbs"]
    assert 2 in Project.open(path).fits


def test_a_program_that_was_killed_again_loses_nothing_of_the_first(path, rng):
    first, second = make_fit(2, 5, rng), make_fit(7, 4, rng)
    killed(path, {2: first})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        killed(path, {7: second})
    project, told = opened(path)
    assert "2 avatars" in told
    assert_same(first, project.fits[2])
    assert_same(second, project.fits[7])


def test_what_is_under_way_while_it_is_saved_stays_in_the_journal(path, rng):
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    project.add_fits({2: make_fit(2, 5, rng)})
    project.keep_finished({7: make_fit(7, 3, rng)})  # finished by a run over many, which adds them at its end
    project.save()
    assert list(find_fits(journal_path(path)).fits) == [7]
    project.close()
    project, told = opened(path)
    assert sorted(project.fits) == [2, 7]
    assert "1 avatar that had not been saved" in told


def test_what_was_undone_before_a_save_does_not_come_back(path, rng):
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    project.add_fits({2: make_fit(2, 5, rng)})
    project.undo()
    project.change("Settings", fit_settings=FitSettings(n=9))
    project.save()
    project.close()
    assert names(path) == ["sand.mbs"]
    assert not Project.open(path).fits


def test_a_copy_takes_what_is_under_way_with_it(path, rng, tmp_path):
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    project.add_fits({2: make_fit(2, 5, rng)})
    project.keep_finished({7: make_fit(7, 3, rng)})
    project.save(tmp_path / "copy.mbs")
    project.close()
    assert names(path) == ["copy.mbs", "copy.mbs.journal", "sand.mbs"]
    assert sorted(opened(tmp_path / "copy.mbs")[0].fits) == [2, 7]


def test_what_is_given_up_does_not_come_back(path, rng):
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    project.add_fits({2: make_fit(2, 5, rng)})
    project.give_up_journal()
    project.close()
    assert names(path) == ["sand.mbs"]
    killed(path, {2: make_fit(2, 5, rng)})
    project, _ = opened(path)
    project.hold("a test")
    project.give_up_journal()
    project.close()
    assert names(path) == ["sand.mbs"]


# ---- what belongs to something else --------------------------------------------------------------


def test_a_project_with_other_grains_takes_nothing(path, rng, state):
    killed(path, {2: make_fit(2, 5, rng)})
    labels = state.grains.labels.copy()
    labels[0, 0, 0] = 2
    write_project(path, replace(state, fits={}, grains=replace(state.grains, label_volume=labels)))
    project, told = opened(path)
    assert "holds 1 avatar of other grains than the project's" in told
    assert not project.fits
    # It is in nobody's way, and not lost.
    project.hold("a test")
    with pytest.warns(ProjectWarning, match="lies in .*sand.mbs.journal.1 now"):
        project.begin_journal()
    project.add_fits({7: make_fit(7, 3, rng)})
    project.save()
    project.close()
    assert names(path) == ["sand.mbs", "sand.mbs.journal.1"]
    assert sorted(Project.open(path).fits) == [7]


def test_a_file_that_was_written_since_keeps_its_avatars(path, rng):
    killed(path, {2: make_fit(2, 5, rng), 7: make_fit(7, 3, rng)})
    theirs = Project.open(path, journal=False)
    saved = make_fit(2, 6, rng)
    theirs.add_fits({2: saved})
    theirs.save()
    project, told = opened(path)
    assert "was written since" in told
    assert "1 came in for grains without one" in told
    assert_same(saved, project.fits[2])
    assert 7 in project.fits
    # Going on and being killed again does not bring back what was left behind.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        project.hold("a test")
        project.begin_journal()
        project.close()
        project = Project.open(path)
    assert_same(saved, project.fits[2])
    assert 7 in project.fits


def test_a_program_that_was_killed_between_its_save_and_the_end_has_nothing_to_bring_back(path, rng):
    killed(path, {2: make_fit(2, 5, rng)})
    left = journal_path(path).read_bytes()
    opened(path)[0].save()
    journal_path(path).write_bytes(left)
    project, told = opened(path)
    assert told == ""
    assert not project.is_modified
    project.hold("a test")
    project.begin_journal()
    project.save()
    project.close()
    assert names(path) == ["sand.mbs"]


def test_damage_is_told_and_the_rest_comes_back(path, rng):
    killed(path, {2: make_fit(2, 5, rng), 7: make_fit(7, 3, rng)})
    changed = bytearray(journal_path(path).read_bytes())
    changed[-10] ^= 1
    journal_path(path).write_bytes(changed)
    project, told = opened(path)
    assert sorted(project.fits) == [2]
    assert "1 avatar that" in told
    assert "is damaged at 1 place" in told
    journal_path(path).write_bytes(b"damaged from the start")
    project, told = opened(path)
    assert not project.fits
    assert "its beginning is damaged" in told
    project.hold("a test")
    with pytest.warns(ProjectWarning, match="sand.mbs.journal.1"):
        project.begin_journal()
    project.close()


def test_no_flipped_bit_brings_another_avatar(path, rng):
    fits = {2: make_fit(2, 5, rng), 7: make_fit(7, 3, rng)}
    killed(path, fits)
    whole = journal_path(path).read_bytes()
    for bit in rng.integers(8 * len(whole), size=300).tolist():
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        journal_path(path).write_bytes(changed)
        project, told = opened(path)
        assert "damaged" in told
        for label, fit in project.fits.items():
            assert_same(fits[label], fit)


def foreign(path, packed, state):
    """Write a journal of this project by hand, as a stranger could."""
    origin = fit_journal.Origin(Project.open(path, journal=False).opened_as, grains_digest(state.grains))
    JournalWriter.create(journal_path(path), origin.pack(), packed).close()


def test_a_grain_that_there_is_not_gets_no_avatar(path, rng, state):
    foreign(path, [pack_fit(99, make_fit(99, 3, rng))], state)
    project, told = opened(path)
    assert not project.fits
    assert "other grains" in told


@pytest.mark.parametrize(
    "change",
    [
        {"n": 0}, {"n": True}, {"n": 2.0}, {"n": 2**70}, {"method": "guess"}, {"unit": "m!"}, {"valid": 1},
        {"reached": "[]"}, {"reached": '{"iou": "x"}'}, {"options": "{"}, {"pieces": -1}, {"label": "2"},
        {"label": None}, {"name": 5}, {"rms": "x"},
    ],
    ids=str,
)  # fmt: skip
def test_a_record_that_holds_what_no_fit_can_have_is_told(path, rng, state, change):
    good = pack_fit(7, make_fit(7, 3, rng))
    packed = pack_fit(2, make_fit(2, 5, rng))
    size = int.from_bytes(packed[:4], "little")
    told = json.loads(packed[4 : 4 + size])
    told["cells"] |= change
    text = json.dumps(told).encode()
    bad = len(text).to_bytes(4, "little") + text + packed[4 + size :]
    foreign(path, [good, bad], state)
    project, told = opened(path)
    assert sorted(project.fits) == [7]
    assert "is damaged at 1 place" in told


def test_what_is_no_fit_at_all_is_told(rng):
    packed = pack_fit(2, make_fit(2, 5, rng))
    size = int.from_bytes(packed[:4], "little")
    bad = [b"", packed[:3], packed[:50], packed[:-8], packed + b"\0" * 8, b"\xff" * 40]
    bad.append(packed[: 4 + size] + np.full((len(packed) - size - 4) // 8, np.nan).tobytes())
    for content in bad:
        with pytest.raises(ContentError):
            unpack_fit(content)
    lengths = json.loads(packed[4 : 4 + size])
    for wrong in ({"centers": -1}, {"centers": 10**12}, {"weights": 4}, {"history": None}):
        text = json.dumps(lengths | {"lengths": lengths["lengths"] | wrong}).encode()
        with pytest.raises(ContentError):
            unpack_fit(len(text).to_bytes(4, "little") + text + packed[4 + size :])
    for text in (b"[" * 100_000, b"{}", b'{"cells": 3, "lengths": 4}'):
        with pytest.raises(ContentError):
            unpack_fit(len(text).to_bytes(4, "little") + text)


def test_a_header_of_another_kind_is_told(path):
    for header in (
        b"{}",
        b"[",
        b'{"kind": "clones", "file": "", "grains": ""}',
        b'{"kind": "finished avatars"}',
    ):
        JournalWriter.create(journal_path(path), header).close()
        with pytest.raises(JournalError, match="no journal of avatars"):
            find_fits(journal_path(path))


# ---- where it lies, and disks that are full ------------------------------------------------------


def test_without_a_lock_or_a_file_there_is_no_journal_beside_it(path, rng, state, tmp_path):
    project = Project.open(path)
    assert not project.begin_journal()
    project = Project(replace(state, fits={}))
    assert not project.begin_journal()
    assert project.keep_finished({2: make_fit(2, 5, rng)}) == ""
    place = tmp_path / "elsewhere"
    assert project.begin_journal(place)
    project.keep_finished({2: make_fit(2, 5, rng)})
    assert list(find_fits(place).fits) == [2]
    project.close()


def test_grains_that_are_not_in_the_file_do_not_come_into_its_journal(path, rng, state, tmp_path):
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    project.add_fits({2: make_fit(2, 5, rng)})
    labels = state.grains.labels.copy()
    labels[0, 0, 0] = 2
    project.change("Find grains", grains=replace(state.grains, label_volume=labels), fits={})
    assert not project.begin_journal()
    assert project.begin_journal(tmp_path / "elsewhere")
    project.add_fits({7: make_fit(7, 3, rng)})
    assert list(find_fits(journal_path(path)).fits) == [2]
    assert list(find_fits(tmp_path / "elsewhere").fits) == [7]
    project.save()
    project.close()
    assert names(path) == ["sand.mbs"]
    assert sorted(Project.open(path).fits) == [7]


def test_what_does_not_fit_on_the_disk_waits_for_room(path, rng, monkeypatch):
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    project.keep_finished({2: make_fit(2, 5, rng)})

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    append = JournalWriter.append
    monkeypatch.setattr(JournalWriter, "append", full)
    assert "cannot be written (No space left on device)" in project.keep_finished({7: make_fit(7, 3, rng)})
    assert list(find_fits(journal_path(path)).fits) == [2]
    monkeypatch.setattr(JournalWriter, "append", append)
    assert project.keep_finished({7: make_fit(7, 4, rng)}) == ""
    project.close()
    assert len(find_fits(journal_path(path)).contents.records) == 3


def test_what_is_kept_is_flushed_to_the_disk_without_being_asked(path, rng, monkeypatch):
    monkeypatch.setattr(fit_journal, "SYNC_AFTER", 0.01)
    flushed = []
    monkeypatch.setattr(JournalWriter, "sync", lambda self: flushed.append(self.path))
    project = Project.open(path)
    project.hold("a test")
    project.begin_journal()
    project.keep_finished({2: make_fit(2, 5, rng)})
    timer = project._journals.of(project.grains)._timer
    if timer is not None:
        timer.join()
    assert flushed == [journal_path(path)]
    project.close()


def test_a_journal_moves_with_its_project(path, rng, tmp_path):
    killed(path, {2: make_fit(2, 5, rng)})
    (tmp_path / "there").mkdir()
    for entry in (path, journal_path(path)):
        shutil.move(entry, tmp_path / "there" / entry.name)
    assert sorted(opened(tmp_path / "there" / "sand.mbs")[0].fits) == [2]


# ---- undo ----------------------------------------------------------------------------------------


def test_what_was_undone_does_not_come_back_after_a_kill(path, rng):
    first, second = make_fit(2, 5, rng), make_fit(2, 6, rng)

    def left_by(*steps):
        journal_path(path).unlink(missing_ok=True)
        project = Project.open(path)
        project.hold("a test")
        project.begin_journal()
        for step in steps:
            step(project)
        project.close()
        return opened(path)[0].fits

    def add(fit):
        return lambda project: project.add_fits({2: fit})

    assert 2 not in left_by(add(first), Project.undo)
    assert_same(first, left_by(add(first), add(second), Project.undo)[2])
    assert_same(second, left_by(add(first), add(second), Project.undo, Project.redo)[2])
    assert 2 not in left_by(add(first), lambda project: project.change("Remove", fits={}))
    assert_same(second, left_by(add(first), Project.undo, add(second))[2])
    # What is under way is no part of what was undone.
    fits = left_by(add(first), lambda project: project.keep_finished({7: make_fit(7, 3, rng)}), Project.undo)
    assert sorted(fits) == [7]


def test_what_came_back_and_was_undone_is_not_brought_back_again(path, rng):
    killed(path, {2: make_fit(2, 5, rng), 7: make_fit(7, 3, rng)})
    project, _ = opened(path)
    project.undo()
    project.hold("a test")
    project.begin_journal()
    project.add_fits({7: make_fit(7, 4, rng)})
    project.close()
    assert sorted(opened(path)[0].fits) == [7]


def test_what_others_wrote_between_opening_and_holding_stays_for_the_next_opening(path, rng):
    project = Project.open(path)
    killed(path, {2: make_fit(2, 5, rng)})
    project.hold("a test")
    project.begin_journal()
    project.add_fits({7: make_fit(7, 3, rng)})
    project.save()
    project.close()
    assert sorted(opened(path)[0].fits) == [2, 7]
