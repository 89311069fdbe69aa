"""An export that is killed leaves the earlier one or the new one, at whatever step that was."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from mbstudio.core.dem import folder as export_folder
from mbstudio.core.dem.folder import check_replaceable, roll_back
from mbstudio.core.dem.manifest import FILE_NAME
from mbstudio.core.sealing import seal_json


@pytest.mark.skipif(not hasattr(os, "fork"), reason="copies of a process")
def test_a_kill_at_each_step_leaves_the_earlier_export_or_the_new_one(tmp_path):
    ran = subprocess.run(
        [sys.executable, "-m", "tests.core.dem.interrupted_export", str(tmp_path)],
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    told = json.loads(ran.stdout.splitlines()[-1])
    assert told["wrong"] == []
    assert told["ended"] == 0
    assert told["steps"] > 30


def left(folder, plan):
    aside = folder / ".mbstudio.00000000-1-abcdef01.old"
    (aside / "earlier").mkdir(parents=True)
    (aside / "earlier" / "a.txt").write_text("a")
    (aside / "plan.json").write_bytes(plan)
    os.utime(aside, (0, 0))
    return aside


def test_what_a_stranger_planned_is_not_done(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    names = {"earlier": ["a.txt"], "new": ["notes.txt", "../../elsewhere"]}
    plans = [seal_json({**names, "mark": "0" * 64}), seal_json({**names, "mark": "ab" * 32}), b"[]", b"{"]
    for plan in plans:
        aside = left(tmp_path, plan)
        roll_back(tmp_path)
        assert (tmp_path / "notes.txt").read_text() == "mine"
        assert aside.exists()
        (aside / "plan.json").unlink()
        os.utime(aside, (0, 0))
        roll_back(tmp_path)
        assert not aside.exists(), "without a plan nothing was moved"


def test_a_plan_of_ones_own_is_taken_back(tmp_path):
    names = {"earlier": ["a.txt"], "new": ["c.txt"]}
    aside = left(tmp_path, seal_json({**names, "mark": export_folder._mark_of(names)}))
    (tmp_path / "c.txt").write_text("half an export")
    roll_back(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert not aside.exists()


def test_what_versions_before_plans_left_goes_once_there_is_a_whole_export(tmp_path):
    (tmp_path / ".mbstudio-abc123.old").mkdir()
    (tmp_path / ".mbstudio-abc123.old" / "a.txt").write_text("the only copy?")
    roll_back(tmp_path)
    assert (tmp_path / ".mbstudio-abc123.old").exists()
    (tmp_path / FILE_NAME).write_text("{}")
    check_replaceable(tmp_path, lambda _: [], overwrite=False)
    assert [path.name for path in tmp_path.iterdir()] == [FILE_NAME]
