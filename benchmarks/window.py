"""How the window behaves on this machine: cold start, opening a scan, memory over many projects.

Usage: python benchmarks/window.py [--folder FOLDER] [--cycles 200]

Every start is a new process, timed from before it is made until its event loop answers with the window
painted; files lie in the system's cache, as after a first start. The scan of 100 MB (a TIFF of
400 x 358 x 358 voxels of 16 bits) is written to FOLDER.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

SHAPE = (400, 358, 358)

START = """
import json, resource, sys, time
from mbstudio.ui.shell.collection import pause_collection
pause_collection()  # as the command line does
from pathlib import Path
from PySide6.QtCore import QTimer
from mbstudio.ui.shell import app
from mbstudio.ui.shell.memory import memory_used

application = app.make_application()
told = {}

def window():
    from mbstudio.ui.shell.main_window import MainWindow
    return next(w for w in application.topLevelWidgets() if isinstance(w, MainWindow))

def usable():
    told["start"] = time.time() - float(sys.argv[2])
    told["processor"] = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    told["memory"] = memory_used() / 2**20
    if sys.argv[1]:
        told["opening"] = time.monotonic()
        window().stations.scan.work.open(Path(sys.argv[1]), "14 um")
        timer.start(5)
    else:
        end()

def look():
    main = window()
    if main.workspace.scan is not None and main.queue.is_idle:
        timer.stop()
        main.viewport.render_now()
        told["opening"] = time.monotonic() - told["opening"]
        told["memory with scan"] = memory_used() / 2**20
        end()

def end():
    print(json.dumps(told), flush=True)
    window().project_files.asks = False
    window().close()

timer = QTimer()
timer.timeout.connect(look)
# Runs once the event loop answers and the window is painted.
QTimer.singleShot(0, lambda: QTimer.singleShot(0, usable))
app.run()
"""

CYCLES = """
import gc, json, sys
from pathlib import Path
from PySide6.QtCore import QCoreApplication
from mbstudio.ui.shell import app
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.shell.memory import memory_used
from mbstudio.ui.theme import Theme

application = app.make_application()
settings = app.make_settings()
window = MainWindow(settings, Theme(settings))
window.project_files.asks = False
window.resize(1280, 800)
window.show()

def idle():
    for _ in range(3):
        QCoreApplication.processEvents()
        while not window.queue.is_idle:
            QCoreApplication.processEvents()

used = []
for cycle in range(int(sys.argv[2])):
    window.project_files.open_path(Path(sys.argv[1]))
    idle()
    window.enter("fit")
    window.workspace.select(1 + cycle % 3)
    idle()
    window.project_files.new_project()
    idle()
    if cycle % 10 == 9:
        gc.collect()
        used.append(memory_used() / 2**20)
print(json.dumps(used), flush=True)
window.close()
"""


def environment(folder: Path) -> dict[str, str]:
    """Return an environment whose settings and autosaves are the benchmark's own."""
    home = {f"XDG_{name}_HOME": str(folder / name.lower()) for name in ("CONFIG", "STATE", "DATA")}
    settings = folder / "config" / "mbstudio" / "mbstudio.ini"
    settings.parent.mkdir(parents=True, exist_ok=True)
    settings.write_text("[tour]\nseen=1\n")
    # An installed program finds its bytecode; where none may be written, every start would compile all of it.
    given = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {"QT_QPA_PLATFORM": "offscreen", **given, **home}


def start(folder: Path, scan: Path | None = None) -> dict[str, float]:
    """Start the program, let it open a scan, and return seconds and MB."""
    command = [sys.executable, "-c", START, str(scan or ""), str(time.time())]
    run = subprocess.run(command, capture_output=True, text=True, env=environment(folder), check=True)
    return json.loads(run.stdout.splitlines()[-1])


def make_scan(path: Path) -> Path:
    """Write a scan of 100 MB: balls of two radii on a grid, with noise."""
    import tifffile

    z, y, x = np.ogrid[: SHAPE[0], : SHAPE[1], : SHAPE[2]]
    inside = sum(((axis % 40) - 20.0) ** 2 for axis in (z, y, x)) < 17**2
    noise = np.random.default_rng(3).normal(0, 600, SHAPE).astype(np.float32)
    grey = np.where(inside, 30_000, 9_000).astype(np.float32) + noise
    tifffile.imwrite(path, grey.clip(0, 65535).astype(np.uint16), photometric="minisblack")
    return path


def make_project(path: Path) -> Path:
    """Write a project with a scan of 8 MB, 27 grains and avatars of three."""
    from mbstudio.core.grains import load_labels
    from mbstudio.core.imaging import fit
    from mbstudio.core.project import Project
    from mbstudio.core.scan import Scan
    from mbstudio.core.units import VoxelSize

    z, y, x = np.ogrid[:160, :160, :160]
    cells = ((z // 52).clip(0, 2) * 3 + (y // 52).clip(0, 2)) * 3 + (x // 52).clip(0, 2) + 1
    inside = sum(((axis % 52) - 26.0) ** 2 / weight for axis, weight in ((z, 1.0), (y, 0.8), (x, 0.6))) < 400
    labels = np.where(inside, cells, 0).astype(np.int32)
    grains = load_labels(labels, voxel_size="14 um")
    noise = np.random.default_rng(3).normal(0, 600, labels.shape)
    grey = (np.where(inside, 30_000, 9_000) + noise).astype(np.uint16)
    project = Project.new(Scan(grey, VoxelSize.parse("14 um")))
    project.change("Load labels", grains=grains)
    project.add_fits({label: fit(grains.grain(label), 20, seed=0) for label in (1, 2, 3)})
    return project.save(path)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--folder", type=Path)
    options.add_argument("--cycles", type=int, default=200)
    options.add_argument("--starts", type=int, default=5)
    asked = options.parse_args()
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="mbstudio-window-"))
    folder.mkdir(parents=True, exist_ok=True)
    scan = make_scan(folder / "scan.tif")
    runs = [start(folder) for _ in range(asked.starts)]
    opened = [start(folder, scan) for _ in range(asked.starts)]
    print("| What | Median | Least | Most |\n|---|---|---|---|")
    for title, name, unit, given in (
        ("start to a usable window", "start", "s", runs),
        ("of it, CPU time", "processor", "s", runs),
        ("memory then", "memory", "MB", runs),
        (f"opening a scan of {scan.stat().st_size / 1e6:.0f} MB until it is drawn", "opening", "s", opened),
        ("memory then", "memory with scan", "MB", opened),
    ):
        values = np.array([run[name] for run in given])
        form = "{:.2f} {}" if unit == "s" else "{:.0f} {}"
        shown = [form.format(value, unit) for value in (np.median(values), values.min(), values.max())]
        print(f"| {title} | {' | '.join(shown)} |", flush=True)
    project = make_project(folder / "balls.mbs")
    command = [sys.executable, "-c", CYCLES, str(project), str(asked.cycles)]
    run = subprocess.run(command, capture_output=True, text=True, env=environment(folder), check=True)
    used = json.loads(run.stdout.splitlines()[-1])
    print(f"\nMemory over {asked.cycles} times opening and closing a project (MB, every 10th):")
    print(", ".join(f"{value:.0f}" for value in used))
    print(f"\nGrowth from the 20th to the last: {used[-1] - used[1]:+.0f} MB")


if __name__ == "__main__":
    main()
