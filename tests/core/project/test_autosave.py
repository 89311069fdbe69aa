"""Work that outlives a crash: what is written comes back, and nobody takes what another one uses."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import fields as fields_of
from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import ProjectError
from mbstudio.core.project import Autosave, FitSettings, Project, ProjectState, autosave
from mbstudio.core.scan import Scan
from mbstudio.core.sealing import seal_json
from mbstudio.core.units import VoxelSize
from tests.core.project.test_file import assert_same
from tests.core.project.test_kept_table import grain


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A folder for autosaves; locks that a test still holds end with it."""
    held = []

    def locked(folder):
        held.append(take(folder))
        return held[-1]

    take = autosave._locked
    monkeypatch.setattr(autosave, "_locked", locked)
    yield tmp_path / "autosave"
    for lock in held:
        if lock is not None:
            lock.close()


def test_what_was_written_comes_back_unsaved_with_the_path_of_its_file(root, state, tmp_path):
    written = Autosave.begin(root)
    written.write(state, tmp_path / "sand.mbs")
    written.release()
    (found,) = Autosave.find_abandoned(root)
    assert (found.note.title, found.note.grains, found.note.fits) == ("sand.mbs", 2, len(state.fits))
    project = found.restore()
    assert_same(state, project.state)
    assert project.path == tmp_path / "sand.mbs"
    assert project.is_modified


def test_every_part_of_a_project_is_saved_once():
    parts = [field for fields in autosave.PARTS.values() for field in fields]
    assert sorted(parts) == sorted(field.name for field in fields_of(ProjectState))


def test_kept_grains_come_back(root, state):
    kept = (grain("flat", (0.1, -3.0)), grain("kept 2", (1.0,)))
    written = Autosave.begin(root)
    written.write(replace(state, kept=kept))
    assert written.restore().state.kept == kept


def test_only_what_changed_is_written_again(root, state):
    saved = Autosave.begin(root)
    saved.write(state)
    before = {entry.name for entry in saved.folder.iterdir()}
    changed = replace(state, fit_settings=FitSettings(n=77))
    saved.write(changed)
    after = {entry.name for entry in saved.folder.iterdir()}
    assert {name.partition("-")[0] for name in after - before} == {"work"}
    assert len(after) == len(autosave.PARTS) + 1, "what was replaced is gone"
    assert_same(changed, saved.restore().state)


def test_an_embedded_scan_comes_back_though_no_file_holds_it(root):
    voxels = np.arange(60, dtype=np.uint8).reshape(3, 4, 5)
    project = Project.new(Scan(voxels, VoxelSize(14.0, 14.0, 14.0, "um")))
    saved = Autosave.begin(root)
    saved.write(project.state, None, voxels)
    restored = saved.restore()
    np.testing.assert_array_equal(restored.scan.voxels, voxels)
    assert restored.path is None


def test_after_a_restore_the_writing_goes_on_where_it_was(root, state):
    first = Autosave.begin(root)
    first.write(state)
    first.release()
    (second,) = Autosave.find_abandoned(root)
    restored = second.restore().state
    later = replace(restored, fit_settings=FitSettings(n=55))
    second.write(later)
    assert_same(later, second.restore().state)


def test_what_another_window_uses_is_not_found(root):
    used = Autosave.begin(root)
    used.write(ProjectState())
    assert not list(Autosave.find_abandoned(root))
    used.release()
    first = list(Autosave.find_abandoned(root))
    assert len(first) == 1
    # Offered by one window, it is not offered by a second one.
    assert not list(Autosave.find_abandoned(root))
    first[0].release()
    assert len(list(Autosave.find_abandoned(root))) == 1


def test_nothing_is_left_after_a_clean_end_or_before_the_first_write(root):
    saved = Autosave.begin(root)
    saved.write(ProjectState())
    saved.discard()
    assert not list(root.iterdir())
    Autosave.begin(root).release()
    assert not list(Autosave.find_abandoned(root))
    assert not list(root.iterdir())


def test_cleared_work_is_not_offered(root):
    saved = Autosave.begin(root)
    saved.write(ProjectState())
    saved.clear()
    saved.release()
    assert not list(Autosave.find_abandoned(root))


def test_damage_is_told(root):
    saved = Autosave.begin(root)
    saved.write(ProjectState())
    (part,) = saved.folder.glob("work-*.mbs")
    part.write_bytes(part.read_bytes()[:100])
    with pytest.raises(ProjectError, match="damaged"):
        saved.restore()


@pytest.mark.parametrize(
    "change",
    [
        {"parts": None},
        {"parts": {}},
        {"parts": {"grains": "../../elsewhere.mbs"}},
        {"saved": "yesterday"},
        {"grains": None},
        {"path": 5},
        {"digests": "none"},
        {"opened_as": ["?"]},
    ],
    ids=str,
)
def test_a_damaged_note_is_told(root, change):
    saved = Autosave.begin(root)
    saved.write(ProjectState())
    note = saved.folder / "note.json"
    told = json.loads(note.read_text())
    cut = json.dumps({**told, **change})[:-30].encode()
    for damage in (seal_json(told | change), json.dumps(told | change).encode(), cut, b"[]", b"{"):
        note.write_bytes(damage)
        for read in (lambda: saved.note, saved.restore):
            with pytest.raises(ProjectError, match="cannot be read"):
                read()


@pytest.mark.parametrize("key", ["path", "saved", "grains", "parts"])
def test_a_note_that_lacks_something_is_told(root, key):
    saved = Autosave.begin(root)
    saved.write(ProjectState())
    note = saved.folder / "note.json"
    told = json.loads(note.read_text())
    del told[key]
    note.write_bytes(seal_json(told))
    with pytest.raises(ProjectError, match=f"'{key}' is missing"):
        saved.note


def test_a_part_of_other_work_is_told(root, state):
    saved, other = Autosave.begin(root), Autosave.begin(root)
    saved.write(state)
    other.write(ProjectState())
    (part,), (another,) = saved.folder.glob("work-*.mbs"), other.folder.glob("work-*.mbs")
    part.write_bytes(another.read_bytes())
    with pytest.raises(ProjectError, match="is not the file that the autosaved work was written with"):
        saved.restore()


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("flips", [300, pytest.param(5_000, marks=pytest.mark.full)])
def test_no_flipped_bit_changes_autosaved_work_unseen(root, state, rng, flips):
    """Each is told, or changes nothing: only the name of the seal itself may lose a letter."""
    saved = Autosave.begin(root)
    saved.write(state)
    files = sorted(saved.folder.iterdir())
    unsealed = 0
    before = saved.note
    for _ in range(flips):
        path = files[rng.integers(len(files))]
        whole = path.read_bytes()
        changed = bytearray(whole)
        bit = int(rng.integers(8 * len(whole)))
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        try:
            saved.restore()
        except ProjectError:
            pass
        else:
            assert path.name == "note.json"
            assert saved.note == before
            unsealed += 1
        path.write_bytes(whole)
    print(f"{flips} flips, {unsealed} of them changed nothing")
    assert unsealed <= flips / 20
    assert_same(state, saved.restore().state)


def test_work_of_a_version_that_wrote_fewer_parts_comes_back_and_is_completed(root, state):
    saved = Autosave.begin(root)
    saved.write(state)
    note = saved.folder / "note.json"
    told = json.loads(note.read_text())
    (saved.folder / told["parts"].pop("kept")).unlink()
    note.write_bytes(seal_json(told))
    assert_same(replace(state, kept=()), saved.restore().state)
    saved.write(replace(state, fit_settings=FitSettings(n=9)))
    assert json.loads(note.read_text())["parts"].keys() == autosave.PARTS.keys()
    assert saved.restore().state.fit_settings.n == 9


def test_a_failed_write_leaves_the_one_before(root, state, monkeypatch):
    saved = Autosave.begin(root)
    saved.write(state)

    def full(*args):
        raise ProjectError("disk full")

    monkeypatch.setattr("mbstudio.core.project.autosave.write_project", full)
    with pytest.raises(ProjectError, match="disk full"):
        saved.write(replace(state, fit_settings=FitSettings(n=9)))
    monkeypatch.undo()
    assert_same(state, saved.restore().state)


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL")
def test_a_killed_program_lets_go_of_its_lock(root):
    script = (
        "import sys, time; from pathlib import Path\n"
        "from mbstudio.core.project import Autosave, ProjectState\n"
        "a = Autosave.begin(Path(sys.argv[1])); a.write(ProjectState()); print('written', flush=True)\n"
        "time.sleep(60)"
    )
    program = subprocess.Popen([sys.executable, "-c", script, str(root)], stdout=subprocess.PIPE, text=True)
    assert program.stdout.readline() == "written\n"
    assert not list(Autosave.find_abandoned(root))
    os.kill(program.pid, signal.SIGKILL)
    program.wait()
    program.stdout.close()
    deadline = time.monotonic() + 5
    while not (found := list(Autosave.find_abandoned(root))) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(found) == 1
