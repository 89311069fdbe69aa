"""Whatever ends a program, and at whatever step: what it had reported as done is there."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest


@pytest.mark.skipif(not hasattr(os, "fork"), reason="copies of a process")
def test_a_kill_or_a_full_disk_at_each_step_of_journal_and_save_loses_nothing(tmp_path):
    ran = subprocess.run(
        [sys.executable, "-m", "tests.core.project.interrupted_program", str(tmp_path)],
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    told = json.loads(ran.stdout.splitlines()[-1])
    print(told["steps"], "steps")
    assert told["wrong"] == []
    assert told["ended"] == 0
    assert told["steps"] > 60
