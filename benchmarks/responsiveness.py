"""How long the window's event loop pauses, and how often a live avatar's surface moves; a Markdown table.

Usage: python benchmarks/responsiveness.py [--clones 100] [--out FILE]

A timer of 5 ms beats in the window's event loop, drawn in software off screen, while a grain is fitted by
both methods, clones are laid out and the view is turned; the pauses are the times between two beats. Beside
them stands how much of a pause was the main thread's own work (CPU time; OpenGL draws in it): what a machine
adds that does other things meanwhile is not in it. The grain is an ellipsoid of 56 cubed voxels with a bite
out of it, the clones are bodies of 40 control points.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
os.environ.setdefault("MBSTUDIO_VIEWPORT", "software")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("LP_NUM_THREADS", "0")  # OSMesa draws in the thread that asks

os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")

import numpy as np
from PySide6.QtCore import QCoreApplication, QSettings, QTimer
from PySide6.QtWidgets import QApplication

from mbstudio.core.grains import load_labels
from mbstudio.core.metaball import Avatar
from mbstudio.core.project import Project, ProjectState
from mbstudio.scene.layers.tray import tray_surface
from mbstudio.ui.shell.collection import pause_collection, resume_collection
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.theme import Theme
from mbstudio.ui.workers import Task

SIDE = 56


class Heartbeat:
    """Counts the pauses of the event loop."""

    def __init__(self) -> None:
        self._timer = QTimer()
        self._timer.setInterval(5)
        self._timer.timeout.connect(self._beat)
        self._last = (0.0, 0.0)
        self.pauses: list[tuple[float, float]] = []

    def during(self, work: Callable[[], None], until: Callable[[], bool]) -> np.ndarray:
        """Return pauses, and the main thread's work in each, in milliseconds, until `until` holds."""
        self.pauses, self._last = [], (time.perf_counter(), time.thread_time())
        self._timer.start()
        work()
        while not until():
            QCoreApplication.processEvents()
            time.sleep(0.0005)
        self._timer.stop()
        return 1e3 * np.array(self.pauses)

    def _beat(self) -> None:
        now = (time.perf_counter(), time.thread_time())
        self.pauses.append((now[0] - self._last[0], now[1] - self._last[1]))
        self._last = now


def a_grain() -> ProjectState:
    """Return the state of a project with one grain."""
    z, y, x = np.ogrid[:SIDE, :SIDE, :SIDE]
    labels = (((z - 28) / 17) ** 2 + ((y - 28) / 21) ** 2 + ((x - 28) / 24) ** 2 <= 1).astype(np.int32)
    labels[(z - 28) ** 2 + (y - 10) ** 2 + (x - 40) ** 2 < 64] = 0
    return ProjectState(grains=load_labels(labels, voxel_size="10 um"))


def row(name: str, pauses: np.ndarray, rate: float | None = None) -> str:
    """Return a line of the table."""
    told = "" if rate is None else f"{rate:.1f}"
    numbers = [f(column) for column in pauses.T for f in (np.median, lambda p: np.percentile(p, 95), np.max)]
    return f"| {name} | " + " | ".join(f"{number:.0f}" for number in numbers) + f" | {told} |"


def fit(window: MainWindow, heart: Heartbeat, method: str, n: int) -> str:
    """Fit the grain and return its line."""
    arrived: list[float] = []
    take = window.stations.fit.work.avatar_moved.connect(lambda *_: arrived.append(time.perf_counter()))
    panel = window.stations.fit.panel
    panel.method.setCurrentIndex(panel.method.findData(method))
    panel.n.setValue(n)
    pauses = heart.during(lambda: window.commands.run("fit.grain"), lambda: window.queue.is_idle)
    window.stations.fit.work.avatar_moved.disconnect(take)
    rate = (len(arrived) - 1) / (arrived[-1] - arrived[0]) if len(arrived) > 2 else None
    return row(f"fit, {method}, n = {n}", pauses, rate)


def lay_out(window: MainWindow, heart: Heartbeat, count: int) -> str:
    """Lay bodies out as clones and return the line."""
    rng = np.random.default_rng(5)
    bodies = [Avatar(rng.normal(0, 60, (40, 3)), rng.uniform(100, 900, 40), "um") for _ in range(count)]
    link = window.view

    def work() -> None:
        task = Task("Laying out", lambda control: tray_surface(bodies, aspect=1.5, cells=20))
        task.succeeded.connect(lambda surface: (link.scene.layers.tray.set(surface, "um"), link.arrange()))
        window.queue.submit(task, lane="view")

    window.enter("style")
    end: list[float] = []

    def over() -> bool:
        if window.queue.is_idle and not end:
            end.append(time.perf_counter() + 1.0)
        return bool(end) and time.perf_counter() > end[0]

    return row(f"arranging {count} clones", heart.during(work, over))


def turn(window: MainWindow, heart: Heartbeat) -> str:
    """Turn the view for two seconds and return the line."""
    timer, end = QTimer(), time.perf_counter() + 2
    timer.setInterval(16)
    timer.timeout.connect(lambda: window.viewport.rotate(4, 1))
    pauses = heart.during(timer.start, lambda: time.perf_counter() > end)
    timer.stop()
    return row("rotating them", pauses)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clones", type=int, default=100)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    pause_collection()  # as the program does while it starts
    application = QApplication([])
    with tempfile.TemporaryDirectory() as folder:
        settings = QSettings(str(Path(folder) / "settings.ini"), QSettings.Format.IniFormat)
        window = MainWindow(settings, Theme(settings))
        window.project_files.asks = False
        window.resize(1280, 800)
        window.show()
        window.workspace.replace_project(Project(a_grain()))
        window.workspace.select(1)
        window.enter("fit")
        resume_collection()
        heart = Heartbeat()
        heart.during(lambda: None, lambda: window.queue.is_idle)
        for method in ("fast", "paper"):
            fit(window, heart, method, 10)  # compiles
        end = time.perf_counter() + 2
        lines = [
            "| While | median pause (ms) | 95 % below | longest | own work, median (ms) | 95 % below "
            "| longest | surfaces a second |",
            "|---|---|---|---|---|---|---|---|",
            row("idle", heart.during(lambda: None, lambda: time.perf_counter() > end)),
            fit(window, heart, "fast", 40),
            fit(window, heart, "paper", 40),
            lay_out(window, heart, given.clones),
            turn(window, heart),
            f"\nLoad of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors.",
        ]
        window.close()
        application.processEvents()
    print("\n".join(lines))
    if given.out:
        given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
