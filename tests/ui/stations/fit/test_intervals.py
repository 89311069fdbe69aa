"""Intervals of a grain's factors beside its avatar, at station Fit."""

from __future__ import annotations

import pytest

from mbstudio.core.metrics import factor_intervals


def cell(table, row: int, column: int) -> str:
    return table.item(row, column).text()


def test_intervals_come_and_go(window, idle, with_grains):
    panel = window.stations.fit.panel
    assert not panel.intervals_button.isEnabled()
    window.enter("fit")
    window.workspace.select(1)
    idle()
    assert panel.intervals_button.isEnabled()
    # Volume, area, sphericity and D_n follow from what the search fits; CSF does not.
    assert [cell(panel.factors, row, 0).endswith("*") for row in (0, 1, 2, 4, 5)] == [True] * 3 + [
        False,
        True,
    ]
    assert "fits volume and area" in panel.factors.item(0, 3).toolTip()
    value = float(cell(panel.factors, 2, 1))
    panel.intervals_button.click()
    idle()
    known = factor_intervals(window.workspace.state.grains.grain(1)).intervals["sphericity"]
    low, high = (float(part) for part in cell(panel.factors, 2, 1).split("–"))
    assert (low, high) == pytest.approx(known, rel=5e-3)
    assert low <= value <= high
    assert "From" in panel.factors.horizontalHeaderItem(1).text()
    panel.intervals_button.click()
    assert float(cell(panel.factors, 2, 1)) == value
    panel.intervals_button.click()
    idle()
    window.workspace.select(2)
    idle()
    assert "–" not in cell(panel.factors, 2, 1)
    assert panel.intervals_button.text() == "Intervals of the grain"
