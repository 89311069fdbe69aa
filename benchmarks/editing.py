"""How soon a brush stroke is seen, and how long the window pauses, while a large scan is corrected.

Usage: python benchmarks/editing.py [--side 512] [--out FILE]

The scan has 512 cubed voxels of one byte, with a ball in each of 16 cubed cells; the window is drawn in
software off screen. Each act is made by mouse or key; a timer of 5 ms beats in the event loop until all that
follows from the act is done, for half a second at least and five at most. The pauses are the times between
two beats. Beside them stands the main thread's own work in a pause (CPU time): what a machine adds that does
other things meanwhile is not in it. A stroke counts as seen once the pane has been painted after the move.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import responsiveness  # sets the environment before any import of Qt or VTK
from PySide6.QtCore import QCoreApplication, QPointF, QSettings, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.project import Project
from mbstudio.core.scan import Scan
from mbstudio.core.scan.field_of_view import find_field_of_view
from mbstudio.core.units import VoxelSize
from mbstudio.ui.shell.collection import pause_collection, resume_collection
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.slice_pane import SlicePane

CELL = 32  # voxels from one grain to the next
RADIUS = 14.5
SIZE = VoxelSize(10.0, 10.0, 10.0, "um")
LEFT = Qt.MouseButton.LeftButton
SHORTEST, LONGEST = 0.5, 5.0  # seconds that an act is watched


def a_project(side: int) -> tuple[Project, Scan]:
    """Return a project of balls on a lattice, and its scan."""
    offsets = np.arange(CELL) - CELL / 2 + 0.5
    ball = sum(np.square(offsets).reshape(np.roll((-1, 1, 1), axis)) for axis in range(3)) <= RADIUS**2
    count = side // CELL
    numbers = 1 + np.arange(count**3, dtype=np.int32).reshape(count, count, count)
    labels = np.kron(numbers, ball.astype(np.int32))
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 40, labels.shape, dtype=np.uint8)
    scan = Scan(np.where(labels > 0, noise + 150, noise + 40).astype(np.uint8), SIZE)
    project = Project.new(scan)
    # As the window finds grains: with the field of view.
    grains = replace(build_grain_set(labels, SIZE), view=find_field_of_view(scan.voxels))
    project.change("Find grains", grains=grains)
    return project, scan


def move(pane: SlicePane, place: QPointF) -> None:
    """Move the mouse over a pane with the left button held."""
    pane.mouseMoveEvent(
        QMouseEvent(
            QMouseEvent.Type.MouseMove,
            place,
            pane.mapToGlobal(place),
            Qt.MouseButton.NoButton,
            LEFT,
            Qt.KeyboardModifier.NoModifier,
        )
    )


def paint(pane: SlicePane, seen: list[tuple[float, float]], row: float) -> None:
    """Paint a stroke of 20 moves and note when each was seen: wall time and own work in milliseconds."""
    QTest.mousePress(pane, LEFT, pos=pane.place_of(100, row).toPoint())
    for step in range(20):
        start = time.perf_counter(), time.thread_time()
        move(pane, pane.place_of(100 + 3 * step, row + step % 5))
        QCoreApplication.sendPostedEvents()
        pane.repaint()
        seen.append((1e3 * (time.perf_counter() - start[0]), 1e3 * (time.thread_time() - start[1])))
        QCoreApplication.processEvents()
    QTest.mouseRelease(pane, LEFT, pos=pane.place_of(157, row).toPoint())


class Acts:
    """Corrections of grains in a window."""

    def __init__(self, window: MainWindow) -> None:
        self._window, self._heart = window, responsiveness.Heartbeat()
        self._lines: list[str] = []

    def do(self, name: str, act: Callable[[], object]) -> None:
        """Make an act and note the pauses until all that follows is done."""
        begun = time.perf_counter()

        def over() -> bool:
            spent = time.perf_counter() - begun
            return (self._window.queue.is_idle and spent > SHORTEST) or spent > LONGEST

        self._lines.append(responsiveness.row(name, self._heart.during(lambda: act() and None, over)))

    def table(self) -> list[str]:
        """Return the lines of the table."""
        return [
            "| While | median pause (ms) | 95 % below | longest | own work, median (ms) | 95 % below "
            "| longest |",
            "|---|---|---|---|---|---|---|",
            *(line.removesuffix(" |  |") + " |" for line in self._lines),
        ]


def correct(window: MainWindow, side: int) -> list[str]:
    """Correct grains and return the table."""
    acts, space, view = Acts(window), window.workspace, window.view
    pane = window.slice_views.panes.panes["z"]
    for axis in "xyz":
        view.move_slice(axis, side // 2 + CELL // 2)
    row = side // 2 + CELL / 2
    seen: list[tuple[float, float]] = []
    column = 100 - 100 % CELL + CELL // 2
    middle = int(
        space.state.grains.label_volume[side // 2 + CELL // 2, int(row), 100 - 100 % CELL + CELL // 2]
    )
    acts.do("selecting a grain", lambda: space.select(middle))
    acts.do("moving a slice 20 times", lambda: [view.move_slice("z", side // 2 + k) for k in range(20)])
    view.move_slice("z", side // 2 + CELL // 2)
    window.commands.run("grains.paint")
    for number in range(3):
        acts.do(f"painting, stroke {number + 1}", lambda: paint(pane, seen, row))
    window.stations.grains.tools.set_in_space(True)
    acts.do("painting in space", lambda: paint(pane, seen, row + 4))
    acts.do("undo", space.undo)
    window.commands.run("grains.erase")
    acts.do("erasing", lambda: paint(pane, seen, row))
    window.commands.run("grains.put_down")
    space.choose([middle + 1, middle + 2])
    acts.do("merging two, a gap closed", lambda: window.stations.grains.editing.merge(apart=True))
    window.messages.dismiss()
    window.commands.run("grains.split")

    def seed(cells: int) -> None:
        QTest.mouseClick(pane, LEFT, pos=pane.place_of(column + cells * CELL, row).toPoint())

    acts.do("splitting, the first seed", lambda: seed(1))
    acts.do("the second, the split shown", lambda: seed(2))
    acts.do("taking the split", window.stations.grains.tools.accept)
    space.select(middle + 5)
    acts.do("deleting a grain", window.stations.grains.editing.delete)
    acts.do("selecting another", lambda: space.select(middle + 6))
    acts.do("growing it", window.stations.grains.editing.grow)
    acts.do("undo", space.undo)
    told = np.array(seen)
    wall, own = (np.percentile(column, (50, 95, 100)) for column in told.T)
    return [
        *acts.table(),
        "",
        f"{len(told)} moves of the brush were seen after {wall[0]:.0f} ms (median), 95 % within "
        f"{wall[1]:.0f}, all within {wall[2]:.0f}; own work {own[0]:.1f}, {own[1]:.1f}, {own[2]:.1f} ms.",
        f"Load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors.",
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=512)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    pause_collection()  # as the program does while it starts
    application = QApplication([])
    project, scan = a_project(given.side)
    with tempfile.TemporaryDirectory() as folder:
        settings = QSettings(str(Path(folder) / "settings.ini"), QSettings.Format.IniFormat)
        window = MainWindow(settings, Theme(settings))
        window.project_files.asks = False
        window.resize(1400, 900)
        window.show()
        window.workspace.replace_project(project)
        window.workspace.give_scan(scan)
        window.enter("grains")
        resume_collection()
        responsiveness.Heartbeat().during(lambda: None, lambda: window.queue.is_idle)
        lines = correct(window, given.side)
        window.close()
        application.processEvents()
    print("\n".join(lines))
    if given.out:
        given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
