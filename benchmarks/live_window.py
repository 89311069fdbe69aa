"""How fast the window follows a hand: a slider dragged for some seconds in the real window, headless.

Usage: python benchmarks/live_window.py --cache FOLDER [--population sand290] [--preset pca] [--seconds 20]

The mouse moves every 16 ms; a frame is late by the time from the mouse event that asked for it to the end of
its painting. A timer of 5 ms tells whether the event loop ever falls behind. Walls are walls: on a busy
machine look at the last rows. A small process beside the window works 2 ms four times a second; its wall
over its CPU time says how much longer everything took than it would have alone. FOLDER holds the
populations of benchmarks/parents.py.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")

import numpy as np
from parents import load_parents
from PySide6.QtCore import QCoreApplication, QEvent, QEventLoop, QPointF, QSettings, Qt, QTimer
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication

from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import learn
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.theme import Theme

MOUSE, BEAT = 16, 5
"""Milliseconds between two moves of the mouse, and of the timer that watches the event loop."""
VIEW = (900, 600)
Spent = tuple[float, float]
"""Wall and CPU seconds."""


class Hand:
    """Drags a slider to and fro and notes when frames come, and when the event loop was late.

    Parameters
    ----------
    window : MainWindow
        At station Latent, at rest.
    name : str
        Meaning whose slider is dragged.
    """

    def __init__(self, window: MainWindow, name: str) -> None:
        self._window, self._slider = window, window.stations.latent.panel.meanings[name].slider
        self._asked: dict[float, float] = {}
        self._shown: float | None = None
        self.late: list[float] = []
        self.frames: list[float] = []
        self.beats: list[float] = []
        window.stations.latent.work.live.done.connect(self._arrived)
        window.stations.latent.panel.meanings[name].moved.connect(
            lambda to: self._asked.update({to: time.perf_counter()})
        )
        paint = window.viewport.paintEvent

        def painted(event: QEvent) -> None:
            paint(event)
            if self._shown is not None:
                self.frames.append(time.perf_counter())
                self.late.append(self.frames[-1] - self._shown)
                self._shown = None

        window.viewport.paintEvent = painted

    def _arrived(self, _token: object, found: tuple) -> None:
        asked = self._asked.get(found[1].operations[-1].given.get("to"))
        if asked is not None:
            self._shown = asked

    def forget(self) -> None:
        """Begin anew; a value that is met again counts from then."""
        self._asked.clear()
        for notes in (self.late, self.frames, self.beats):
            notes.clear()

    def _mouse(self, kind: QEvent.Type, share: float, held: Qt.MouseButton) -> None:
        place = QPointF(7 + share * (self._slider.width() - 14), self._slider.height() / 2)
        button = Qt.MouseButton.NoButton if kind == QEvent.Type.MouseMove else Qt.MouseButton.LeftButton
        event = QMouseEvent(
            kind, place, self._slider.mapToGlobal(place), button, held, Qt.KeyboardModifier.NoModifier
        )
        QApplication.sendEvent(self._slider, event)

    def drag(self, seconds: float) -> float:
        """Drag for so long; return the CPU seconds of all threads."""
        left = Qt.MouseButton.LeftButton
        self._mouse(QEvent.Type.MouseButtonPress, 0.5, left)
        begin, spent = time.perf_counter(), time.process_time()
        mouse, beat = QTimer(), QTimer()
        for timer, period in ((mouse, MOUSE), (beat, BEAT)):
            timer.setTimerType(Qt.TimerType.PreciseTimer)
            timer.setInterval(period)

        def move() -> None:
            turn = (time.perf_counter() - begin) / 3.0
            self._mouse(QEvent.Type.MouseMove, 0.5 + 0.35 * np.sin(2 * np.pi * turn), left)

        mouse.timeout.connect(move)
        beat.timeout.connect(lambda: self.beats.append(time.perf_counter()))
        mouse.start()
        beat.start()
        loop = QEventLoop()
        QTimer.singleShot(round(1000 * seconds), loop.quit)
        loop.exec()
        spent = time.process_time() - spent
        mouse.stop()
        beat.stop()
        self._mouse(QEvent.Type.MouseButtonRelease, 0.5, Qt.MouseButton.NoButton)
        return spent


def wait(until: Callable[[], bool]) -> None:
    """Let the event loop run until something holds."""
    while not until():
        QCoreApplication.processEvents()
        time.sleep(0.0002)


class Watch:
    """A small process beside the window that works 2 ms every quarter of a second, and how long that took."""

    CODE = (
        "import sys, time, threading\n"
        "ended = threading.Event()\n"
        "threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()\n"
        "while not ended.wait(0.25):\n"
        "    wall, spent = time.perf_counter(), time.thread_time()\n"
        "    while time.thread_time() - spent < 0.002: sum(range(500))\n"
        "    print((time.perf_counter() - wall) / (time.thread_time() - spent), flush=True)\n"
    )

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", self.CODE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def stop(self) -> float:
        """Return the mean wall time over CPU time: 1 on a machine that has nothing else to do."""
        told, _ = self._process.communicate()
        return float(np.mean([float(line) for line in told.split()]))


def renders(window: MainWindow, count: int = 30) -> list[Spent]:
    """Return wall and CPU seconds of renderings of the same scene, without any other work."""
    found = []
    for _ in range(count):
        wall, spent = time.perf_counter(), time.process_time()
        window.viewport.render_now()
        found.append((time.perf_counter() - wall, time.process_time() - spent))
    return found


def measure(learner: StyleLearner, seconds: float, name: str) -> list[tuple[str, str]]:
    """Return the rows of the table."""
    application = QApplication.instance() or QApplication([])
    with tempfile.TemporaryDirectory() as folder:
        settings = QSettings(str(Path(folder) / "settings.ini"), QSettings.Format.IniFormat)
        window = MainWindow(settings, Theme(settings))
        window.project_files.asks = False
        window.resize(VIEW[0] + 820, VIEW[1] + 300)
        window.show()
        window.enter("latent")
        window.workspace.use_style(learner, "Open style")
        wait(lambda: window.queue.is_idle and window.stations.latent.work.meanings is not None)
        for _ in range(3):  # the view becomes 900 x 600, whatever the docks take
            size = window.viewport.size()
            window.resize(window.width() + VIEW[0] - size.width(), window.height() + VIEW[1] - size.height())
            QCoreApplication.processEvents()
        wait(lambda: window.stations.latent.work.live.is_idle and window.queue.is_idle)
        empty = renders(window)
        hand = Hand(window, name)
        hand.drag(1.0)  # what is compiled and loaded at the first time
        hand.forget()
        wait(lambda: window.stations.latent.work.live.is_idle and window.queue.is_idle)
        watch = Watch()
        spent = hand.drag(seconds)
        busy = watch.stop()
        wait(lambda: window.stations.latent.work.live.is_idle and window.queue.is_idle)
        size, triangles = window.viewport.size(), len(window.stations.latent.work.grain.triangles)
        rows = _rows(hand, spent, seconds, empty, busy)
        window.close()
        del application
    return [("view", f"{size.width()} x {size.height()}, {triangles} triangles at rest"), *rows]


def _rows(hand: Hand, spent: float, seconds: float, empty: list[Spent], busy: float) -> list[tuple[str, str]]:
    late, apart = 1e3 * np.array(hand.late), 1e3 * np.diff(hand.frames)
    beats = 1e3 * np.diff(hand.beats)
    alone = 1e3 * np.median(empty, axis=0)
    return [
        ("frames", f"{len(late)} in {seconds:g} s"),
        (
            "mouse to painted frame",
            f"median {np.median(late):.0f} ms, 95 % {np.percentile(late, 95):.0f} ms, "
            f"worst {late.max():.0f} ms",
        ),
        ("between two frames", f"median {np.median(apart):.0f} ms, longest {apart.max():.0f} ms"),
        ("event loop, timer of 5 ms", f"median {np.median(beats):.1f} ms, longest gap {beats.max():.0f} ms"),
        ("CPU of all threads", f"{spent / seconds:.2f} cores, {1e3 * spent / len(late):.0f} ms a frame"),
        ("rendering the resting grain alone", f"median {alone[0]:.1f} ms, {alone[1]:.1f} ms of CPU"),
        (
            "2 ms of work beside it, wall over CPU",
            f"{busy:.2f}; so much shorter: median {np.median(late) / busy:.0f} ms, "
            f"worst {late.max() / busy:.0f} ms",
        ),
        ("load of the machine", f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"),
    ]


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--cache", required=True)
    options.add_argument("--population", default="sand290")
    options.add_argument("--preset", default="pca")
    options.add_argument("--seconds", type=float, default=20.0)
    options.add_argument("--meaning", default="csf")
    asked = options.parse_args()
    learner = learn(load_parents(asked.cache, asked.population).serialization, preset=asked.preset)
    print(
        f"### A hand on the slider “{asked.meaning}”: {asked.population}, preset {asked.preset}\n\n"
        "| what | figure |\n|---|---|"
    )
    for what, figure in measure(learner, asked.seconds, asked.meaning):
        print(f"| {what} | {figure} |")


if __name__ == "__main__":
    main()
