from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from mbstudio.core.processes import is_running
from mbstudio.core.replacement import (
    name_beside,
    remove_leftovers,
    replacing,
    replacing_folder,
    restore_folder,
)

SAVE_AND_WAIT = """
import sys, time
from pathlib import Path
from mbstudio.core.replacement import replacing
with replacing(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    print("writing", flush=True)
    time.sleep(600)
"""


def others(folder):
    return [path.name for path in folder.iterdir() if path.name.endswith(".part")]


def start_saving(path):
    saving = subprocess.Popen([sys.executable, "-c", SAVE_AND_WAIT, path], stdout=subprocess.PIPE)
    assert saving.stdout.readline() == b"writing\n"
    return saving


def test_the_next_save_removes_what_a_killed_one_has_left(tmp_path):
    saving = start_saving(tmp_path / "sand.mbs")
    with replacing(tmp_path / "other.csv") as temporary:
        temporary.write_text("whole")
        assert len(others(tmp_path)) == 2  # it still runs: its file stays
    saving.send_signal(signal.SIGTERM if os.name == "nt" else signal.SIGKILL)
    saving.wait()
    saving.stdout.close()
    assert len(others(tmp_path)) == 1
    with replacing(tmp_path / "sand.mbs") as temporary:
        temporary.write_text("whole")
    assert others(tmp_path) == []
    assert sorted(path.read_text() for path in tmp_path.iterdir()) == ["whole", "whole"]


def test_another_name_stays(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    own = name_beside(tmp_path / "sand.mbs").name.replace(f"-{os.getpid()}-", f"-{ended.pid}-")
    for name in (own, "sand.mbs.part", ".sand.mbs.part", ".sand.mbs.tmp", "notes.txt"):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        ["sand.mbs.part", ".sand.mbs.part", ".sand.mbs.tmp", "notes.txt"]
    )


@pytest.mark.parametrize("name", [".sand.mbs.00000000-1-0123abcd.part", ".sand.mbs.0123abcd.part"])
def test_what_nobody_knows_goes_after_a_day(tmp_path, name):
    (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert others(tmp_path) == [name]
    long_ago = time.time() - 2 * 24 * 3600
    os.utime(tmp_path / name, (long_ago, long_ago))
    remove_leftovers(tmp_path)
    assert others(tmp_path) == []


def test_folders_of_killed_exports_go_too(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left = name_beside(tmp_path / "mbstudio").name.replace(f"-{os.getpid()}-", f"-{ended.pid}-")
    (tmp_path / left).mkdir()
    (tmp_path / left / "grain.stl").touch()
    remove_leftovers(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_process_runs_or_has_ended():
    assert is_running(os.getpid())
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert not is_running(ended.pid)
    assert not is_running(0)
    assert not is_running(-1)


def test_a_folder_is_replaced_as_a_whole(tmp_path):
    place = tmp_path / "labels.zarr"
    for text in ("first", "second"):
        with replacing_folder(place) as temporary:
            (temporary / "deeper").mkdir()
            (temporary / "deeper" / "file").write_text(text)
            (temporary / text).touch()
        assert (place / "deeper" / "file").read_text() == text
        assert sorted(path.name for path in place.iterdir()) == ["deeper", text]
        assert [path.name for path in tmp_path.iterdir()] == ["labels.zarr"]


def test_a_folder_stays_when_the_new_one_fails(tmp_path):
    place = tmp_path / "labels.zarr"
    place.mkdir()
    (place / "file").write_text("whole")
    with pytest.raises(IsADirectoryError), replacing_folder(place) as temporary:
        temporary.write_text("half")
    assert (place / "file").read_text() == "whole"
    assert [path.name for path in tmp_path.iterdir()] == ["labels.zarr"]


def test_a_folder_that_a_killed_program_had_moved_aside_comes_back(tmp_path):
    place = tmp_path / "labels.zarr"
    aside = tmp_path / ".labels.zarr.00000000-1-abcdef01.old"
    aside.mkdir()
    (aside / "0").write_text("old")
    os.utime(aside, (0, 0))
    other = tmp_path / ".other.zarr.00000000-1-abcdef01.old"
    other.mkdir()
    os.utime(other, (0, 0))
    restore_folder(place)
    assert (place / "0").read_text() == "old"
    # With the new one in its place, the old one is not needed.
    place.rename(aside)
    os.utime(aside, (0, 0))
    place.mkdir()
    with replacing_folder(place) as temporary:
        (temporary / "0").write_text("new")
    assert (place / "0").read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == [other.name, place.name]
