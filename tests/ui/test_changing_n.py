"""Another number of control points while the window fits, and a fit that is given up."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from tests.ui.conftest import PATIENCE


@pytest.fixture
def fitting(segmented, idle, qtbot):
    """The window while it fits its first grain by the paper's method, for minutes if left alone."""
    window = segmented
    label = window.workspace.state.grains.interior_labels[0]
    window.workspace.select(label)
    window.workspace.change_fit_settings(n=10, method="paper", options={"generations": 50_000})
    idle()
    assert window.commands.run("fit.grain")
    qtbot.waitUntil(lambda: len(window.curve.losses) > 3, timeout=PATIENCE)
    return window


def stopped(window, idle):
    window.fits.stop()
    idle()
    return window.workspace.state.fits[window.workspace.selected]


def wait_for_more(window, qtbot) -> int:
    count = len(window.curve.losses)
    qtbot.waitUntil(lambda: len(window.curve.losses) > count + 3, timeout=PATIENCE)
    return count


def test_another_n_while_a_fit_is_paused_and_while_it_runs(fitting, idle, qtbot):
    window = fitting
    window.fits.pause()
    window.panels_fit.n.setValue(15)
    window.panels_fit.n.setValue(14)
    qtbot.wait(300)  # the step that was under way may still arrive
    window.fits.pause()
    wait_for_more(window, qtbot)
    # An impossible number does not end the fit.
    window.fits.change_n(10**6)
    qtbot.waitUntil(lambda: "or fewer" in window.messages.text, timeout=PATIENCE)
    assert window.messages.level == "warning"
    assert "goes on with n = 14" in window.messages.text
    count = wait_for_more(window, qtbot)
    fit = stopped(window, idle)
    assert (fit.n, fit.avatar.n) == (14, 14)
    # The curve is the whole history, the generations before the change included.
    np.testing.assert_allclose(window.curve.losses, fit.history)
    assert count + 3 < len(fit.history) < 50_000


def test_a_cancelled_fit_is_let_go(fitting, idle):
    window = fitting
    run = weakref.ref(window.fits._fitting.run)
    assert run() is not None
    window.fits._task.cancel()
    idle()
    gc.collect()
    assert run() is None
    assert not window.workspace.state.fits
    assert not window.fits.can_go_on(window.workspace.selected)
    assert window.commands.run("fit.grain")  # and anew
    assert stopped(window, idle).avatar.n == 10
