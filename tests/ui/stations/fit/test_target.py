"""The target field: what it takes, what it refuses, and fits that end by it."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from tests.ui.conftest import PATIENCE


@pytest.fixture
def ready(with_grains, idle):
    """The window at station Fit with a grain chosen."""
    with_grains.enter("fit")
    with_grains.workspace.select(with_grains.workspace.state.grains.interior_labels[0])
    idle()
    return with_grains


def write(window, text):
    field = window.stations.fit.panel.target
    field.setFocus()
    field.clear()
    QTest.keyClicks(field, text)
    QTest.keyClick(field, Qt.Key.Key_Return)


def test_a_target_ends_the_fit_with_few_control_points(ready, idle):
    window = ready
    write(window, "volume 1 % and iou 80 %")
    assert window.workspace.state.fit_settings.target == "volume 1 % and iou 0.8"
    assert not window.stations.fit.panel.n.isEnabled()
    assert window.commands.run("fit.grain")
    idle()
    fit = window.workspace.state.fits[window.workspace.selected]
    assert fit.target == "volume 1 % and iou 0.8"
    assert fit.n < 40
    assert fit.reached["iou"] >= 0.8
    assert "reaches the goal" in window.messages.text
    assert "Goal reached" in window.stations.fit.panel._reasons.text()
    # The curve is that of the fit that was kept.
    assert window.stations.fit.curve.losses == pytest.approx(list(fit.history))
    # And on from there, whatever n says: the number was found.
    window.stations.fit.panel.more.setValue(2)
    assert window.commands.run("fit.more")
    idle()
    assert window.workspace.state.fits[window.workspace.selected].n == fit.n


def test_all_grains_take_the_target(ready, idle):
    window = ready
    window.workspace.change_fit_settings(target="volume 2 %")
    assert window.stations.fit.panel.target.text() == "volume 2 %"
    assert window.commands.run("fit.all")
    idle()
    fits = window.workspace.state.fits
    assert {fit.target for fit in fits.values()} == {"volume 2 %"}
    assert f"{len(fits)} of {len(fits)} reach the goal" in window.messages.text


def test_a_bad_target_is_told_beside_the_field_and_nothing_is_fitted(ready, idle):
    window = ready
    write(window, "volume 1 %")
    write(window, "beauty 3 %")
    panel = window.stations.fit.panel
    assert panel.refusal.isVisible()
    assert "beauty" in panel.refusal.text()
    assert panel.target.text() == "beauty 3 %"
    assert window.workspace.state.fit_settings.target == "volume 1 %"
    window.commands.run("fit.grain")
    window.commands.run("fit.all")
    idle()
    assert not window.workspace.state.fits
    write(window, "")
    assert not panel.refusal.isVisible()
    assert window.workspace.state.fit_settings.target == ""
    assert panel.n.isEnabled()


def test_another_n_gives_a_running_target_up(ready, idle, qtbot):
    window = ready
    window.workspace.change_fit_settings(
        method="paper", options={"generations": 50_000}, target="hausdorff 0.01 %"
    )
    assert window.commands.run("fit.grain")
    qtbot.waitUntil(lambda: len(window.stations.fit.curve.losses) > 3, timeout=PATIENCE)
    assert window.stations.fit.panel.n.isEnabled()
    window.stations.fit.panel.n.setValue(7)
    count = len(window.stations.fit.curve.losses)
    qtbot.waitUntil(lambda: len(window.stations.fit.curve.losses) != count, timeout=PATIENCE)
    qtbot.wait(300)
    window.stations.fit.work.run.stop()
    idle()
    fit = window.workspace.state.fits[window.workspace.selected]
    assert (fit.n, fit.target) == (7, "")


def test_undo_brings_the_target_back(ready):
    window = ready
    write(window, "rms 1 %")
    window.undo.undo()
    assert window.stations.fit.panel.target.text() == ""
    window.undo.redo()
    assert window.stations.fit.panel.target.text() == "rms 1 %"
