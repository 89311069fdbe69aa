"""How long the table of grains takes with many rows: to be shown, sorted, chosen from; a Markdown table.

Usage: python benchmarks/table.py [--rows 100000]

The table is 1280 x 400 pixels, off screen; two grains of three have a fit. Each time ends when the table is
painted. Choosing is done with labels that lie apart from each other, the slowest kind, after others of the
kind were chosen. The time of the whole program's selection is that of the workspace with the table.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from types import SimpleNamespace

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
import pandas as pd
from PySide6.QtCore import QCoreApplication, QSettings, Qt
from PySide6.QtWidgets import QApplication

from mbstudio.core.grains import GrainSet
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.units import VoxelSize
from mbstudio.ui.stations.grains.table import GrainTable
from mbstudio.ui.stations.grains.table_model import COLUMNS
from mbstudio.ui.workspace import Workspace


def many_grains(count: int) -> tuple[GrainSet, dict[int, SimpleNamespace]]:
    """Return a set of so many grains, whose voxels nobody asks for, and fits of two in three."""
    rng = np.random.default_rng(1)
    labels = np.arange(1, count + 1)
    table = pd.DataFrame(
        {"label": labels, "volume": rng.lognormal(14, 1, count), "touches_border": rng.random(count) < 0.3}
    )
    fits = {
        label: SimpleNamespace(
            avatar=SimpleNamespace(n=int(rng.integers(8, 80))),
            verdict=SimpleNamespace(rms=float(rng.lognormal()), valid=True, reasons=(), warnings=()),
        )
        for label in labels[rng.random(count) < 2 / 3].tolist()
    }
    return GrainSet(np.zeros((1, 1, 1), np.int32), table, VoxelSize.parse("10 um")), fits


def timed(work: Callable[[], object], times: int = 5) -> tuple[float, float]:
    """Return the median and the longest of some times, in milliseconds, the first of them left out."""
    spent = []
    for _ in range(times + 1):
        begun = time.perf_counter()
        work()
        QCoreApplication.processEvents()
        spent.append(1e3 * (time.perf_counter() - begun))
    return float(np.median(spent[1:])), max(spent[1:])


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rows", type=int, default=100_000)
    asked = options.parse_args()
    application = QApplication.instance() or QApplication([])
    grains, fits = many_grains(asked.rows)
    table = GrainTable()
    table.resize(1280, 400)
    table.show()
    space = Workspace(QSettings("", QSettings.Format.IniFormat))
    space.replace_project(Project(ProjectState(grains=grains)))
    space.selection_changed.connect(lambda: table.select_labels(space.chosen, space.selected))
    table.chosen.connect(space.choose)
    rng = np.random.default_rng(2)
    half = [rng.permutation(asked.rows)[: asked.rows // 2] + 1 for _ in range(2)]
    turns = iter(range(10**6))

    def show() -> None:
        table.content.set_grains(grains)
        table.content.set_fits(fits)

    def sort(column: int) -> None:
        order = Qt.SortOrder.AscendingOrder if next(turns) % 2 else Qt.SortOrder.DescendingOrder
        table.sortByColumn(column, order)

    rows = [("shown, with fits", timed(show))]
    for name in ("label", "volume", "rms", "verdict"):
        place = next(place for place, column in enumerate(COLUMNS) if column.name == name)
        rows.append((f"sorted by {name}, nothing chosen", timed(lambda place=place: sort(place))))
    rows.append(("one row chosen", timed(lambda: space.select(1 + next(turns) % asked.rows))))
    rows.append(
        ("half of the rows, scattered, chosen", timed(lambda: space.choose(half[next(turns) % 2].tolist())))
    )
    rows.append(("sorted by volume, half of the rows chosen", timed(lambda: sort(1))))
    rows.append(("all rows chosen by Ctrl+A", timed(lambda: (table.clearSelection(), table.selectAll()))))
    print(f"### The table of grains with {asked.rows:,} rows\n\n| what | median | longest |\n|---|---|---|")
    for what, (median, longest) in rows:
        print(f"| {what} | {median:.0f} ms | {longest:.0f} ms |")
    table.close()
    del application


if __name__ == "__main__":
    main()
