"""A sweep over n in the window: drawn as it goes, its advice taken, cancelled, refused."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.sweep import SweepRow
from mbstudio.ui.stations.fit.sweep_dock import read_numbers
from tests.ui.conftest import PATIENCE


@pytest.fixture
def sweeping(with_grains, idle):
    """The window with its sweep open and one grain chosen."""
    window = with_grains
    window.workspace.select(window.workspace.state.grains.interior_labels[0])
    assert window.commands.run("fit.sweep")
    idle()
    return window


def made_rows(errors):
    """Rows of one grain whose volume and area have these errors by n."""
    return [
        SweepRow(1, "made", n, "fast", 0, loss=1 / n, rms=0.01, iou=0.9, hausdorff=0.02,
                 errors={"volume": volume, "area": area})
        for n, (volume, area) in errors.items()
    ]  # fmt: skip


def choose(dock, *names):
    dock.table.clearSelection()
    for row in range(dock.table.rowCount()):
        if dock.table.item(row, 0).data(Qt.ItemDataRole.UserRole) in names:
            for column in range(3):
                dock.table.item(row, column).setSelected(True)


def test_rows_are_drawn_as_fits_finish_and_the_advice_is_used(sweeping, idle, qtbot):
    window = sweeping
    dock = window.stations.fit.sweep_dock
    assert window.docks["sweep"].isVisible()
    assert not window.docks["curve"].isVisible()
    seen = []
    window.stations.fit.sweep_work.rows_changed.connect(
        lambda: seen.append(len(window.stations.fit.sweep_work.rows))
    )
    dock.numbers.setText("3, 12, 6")
    QTest.mouseClick(dock.start_button, Qt.MouseButton.LeftButton)
    assert window.stations.fit.sweep_work.run.is_running
    assert not dock.start_button.isEnabled()
    idle()
    assert {1, 2, 3} <= set(seen), "rows came only at the end"
    rows = window.stations.fit.sweep_work.rows
    assert [row.n for row in rows] == [3, 6, 12]
    assert len(dock.loss.listDataItems()) > 0
    assert dock.table.rowCount() == 22  # three distances and nineteen factors
    choose(dock, "volume")
    dock.limit.setValue(5.0)
    smallest = [row.n for row in rows if row.error_of("volume") <= 0.05]
    assert dock.advice == smallest[0]
    window.workspace.change_fit_settings(n=77, target="volume 1 %")
    QTest.mouseClick(dock.use_button, Qt.MouseButton.LeftButton)
    assert window.workspace.state.fit_settings.n == smallest[0]
    assert window.workspace.state.fit_settings.target == ""
    # Only the number that is new is fitted.
    dock.numbers.setText("3 6 9 12")
    window.stations.fit.sweep_work.start(dock.labels(), read_numbers(dock.numbers.text()))
    idle()
    again = window.stations.fit.sweep_work.rows
    assert sorted(row.n for row in again) == [3, 6, 9, 12]
    assert sum(row in rows for row in again) == 3


def test_the_advice_suits_all_chosen_rows(sweeping):
    window = sweeping
    dock, work = window.stations.fit.sweep_dock, window.stations.fit.sweep_work
    work.rows = made_rows({10: (0.005, 0.09), 20: (0.004, 0.03), 40: (0.004, 0.008), 80: (0.003, 0.006)})
    work.rows_changed.emit()
    choose(dock, "volume")
    assert dock.advice == 10
    assert dock.use_button.text() == "Use n = 10"
    choose(dock, "volume", "area")
    assert dock.advice == 40
    dock.limit.setValue(5.0)
    assert dock.advice == 20
    dock.limit.setValue(0.1)
    assert dock.advice is None
    assert not dock.use_button.isEnabled()
    assert "Surface area A" in dock._advice_note.text()
    # The chosen lines are bold, the limit lies where it was set.
    lines = [item for item in dock.errors.listDataItems() if item.opts["symbol"] is not None]
    drawn = {tuple(np.round(item.getOriginalDataset()[1], 6)) for item in lines}
    assert drawn == {(0.5, 0.4, 0.4, 0.3), (9.0, 3.0, 0.8, 0.6)}


def test_a_sweep_is_cancelled_within_a_fit(sweeping, idle, qtbot):
    window = sweeping
    window.workspace.change_fit_settings(method="paper", options={"generations": 100_000})
    window.stations.fit.sweep_dock.numbers.setText("10")
    window.stations.fit.sweep_dock.start()
    qtbot.waitUntil(lambda: window.stations.fit.sweep_work.run.task.state == "running", timeout=PATIENCE)
    qtbot.wait(300)
    QTest.mouseClick(window.stations.fit.sweep_dock.cancel_button, Qt.MouseButton.LeftButton)
    idle()
    assert not window.stations.fit.sweep_work.run.is_running
    assert window.stations.fit.sweep_work.rows == []
    assert window.stations.fit.sweep_dock.start_button.isEnabled()


def test_what_cannot_be_swept_is_said_beside_it(sweeping, idle):
    window = sweeping
    dock = window.stations.fit.sweep_dock
    dock.numbers.setText("10, twenty")
    dock.start()
    assert "'twenty'" in dock.refusal.text()
    assert dock.refusal.isVisible()
    assert window.queue.is_idle
    dock.numbers.setText("10")
    window.workspace.select(None)
    dock.start()
    assert "No grain is selected" in dock.refusal.text()
    dock.grains.setCurrentIndex(dock.grains.findData("inside"))
    assert dock.labels() == window.workspace.state.grains.interior_labels
    dock.numbers.setText("1000000")
    dock.start()
    idle()
    assert "fits failed" in dock.refusal.text()
    assert dock.advice is None


@pytest.mark.parametrize("text", ["", "0", "-3", "4.5", "ten"])
def test_numbers_that_are_none(text):
    with pytest.raises(FitError):
        read_numbers(text)


def test_numbers_are_read_sorted():
    assert read_numbers(" 40, 10;20  10") == (10, 20, 40)
