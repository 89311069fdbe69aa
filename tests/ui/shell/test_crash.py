"""The real program, killed in the middle of work and started again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from mbstudio.core.project import Autosave, Project, ProjectState
from tests.ui.conftest import PATIENCE

# Runs the program as `mbstudio gui` does; a timer of its own does what a person would.
PROGRAM = """
import sys, json
from pathlib import Path
from PySide6.QtCore import QTimer
from mbstudio.ui.shell import app

application = app.make_application()
project, does = sys.argv[1:]
done = set()

def window():
    from mbstudio.ui.shell.main_window import MainWindow
    return next((w for w in application.topLevelWidgets() if isinstance(w, MainWindow)), None)

def tell(**words):
    print(json.dumps(words), flush=True)

def work(main):
    if main.workspace.state.grains is not None:
        n = main.workspace.state.fit_settings.n + 1
        main.workspace.change_fit_settings(n=n)
        tell(n=n)

def restore(main):
    if main.shell.autosaves.leftovers and "asked" not in done:
        done.add("asked")
        tell(offered=main.shell.autosaves.leftovers[0].note.title)
        assert main.commands.run("project.restore")
    elif main.workspace.state.grains is not None and "told" not in done:
        done.add("told")
        space = main.workspace
        tell(n=space.state.fit_settings.n, grains=len(space.state.grains), path=str(space.project.path),
             modified=main.isWindowModified())
        main.project_files.asks = False
        main.close()

timer = QTimer()
timer.timeout.connect(lambda: window() is not None and globals()[does](window()))
timer.start(100)
sys.exit(app.run(project_path=project or None))
"""


def start(settings_home, *arguments):
    environment = os.environ | {"XDG_CONFIG_HOME": str(settings_home)}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)],
        stdout=subprocess.PIPE, env=environment, text=True,
    )  # fmt: skip


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL")
def test_a_killed_program_loses_no_more_than_the_interval(tmp_path, state_folder, two_grains):
    home, interval = tmp_path / "config", 1
    (home / "mbstudio").mkdir(parents=True)
    (home / "mbstudio" / "mbstudio.ini").write_text(f"[autosave]\nseconds={interval}\n[tour]\nseen=1\n")
    path = tmp_path / "sand.mbs"
    Project(ProjectState(grains=two_grains)).save(path)

    program = start(home, path, "work")
    done: dict[int, float] = {}  # n, and when it was set
    try:
        end = time.monotonic() + PATIENCE / 1000
        begun = None
        for line in program.stdout:
            done[json.loads(line)["n"]] = time.monotonic()
            begun = begun or time.monotonic()
            if time.monotonic() - begun > 3 * interval + 1 or time.monotonic() > end:
                break
    finally:
        killed = time.monotonic()
        os.kill(program.pid, signal.SIGKILL)
        program.wait()
        program.stdout.close()
    assert len(done) > 10
    # The file itself was not touched.
    with Project.open(path) as untouched:
        assert untouched.state.fit_settings.n == 40

    program = start(home, "", "restore")
    told, _ = program.communicate(timeout=PATIENCE / 1000)
    assert program.returncode == 0
    offered, restored = map(json.loads, told.splitlines())
    assert offered == {"offered": "sand.mbs"}
    assert restored["grains"] == 2
    assert restored["path"] == str(path)
    assert restored["modified"] is True
    # What was done before the last interval (and the second that a slow disk may take) is there.
    old_enough = [n for n, moment in done.items() if moment < killed - interval - 1]
    assert restored["n"] >= max(old_enough)
    assert not list(Autosave.find_abandoned(state_folder / "mbstudio" / "autosave"))
