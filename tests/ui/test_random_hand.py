"""A hand does random things at every station of the real window; nothing goes wrong, nothing is left."""

from __future__ import annotations

import sys
import threading
import warnings

import numpy as np
import pytest
from PySide6.QtCore import QtMsgType, qDebug, qInstallMessageHandler, qWarning

from mbstudio.core.grains import load_labels
from mbstudio.core.project import ProjectState
from tests.ui.random_hand.driver import RandomHand
from tests.ui.random_hand.records import digest
from tests.ui.random_hand.watch import Watch


@pytest.mark.parametrize(
    ("seed", "actions"),
    [(7, 100), pytest.param(8, 1000, marks=[pytest.mark.full, pytest.mark.timeout(3600)])],
)
def test_random_actions_do_no_harm(qapp, theme, tmp_path, seed, actions):
    undone = 0
    for turn in range(4):  # so few actions may change nothing, depending on how long the machine takes
        told = []
        outcome = RandomHand(tmp_path / f"files-{turn}", seed + 100 * turn, theme, told.append).run(actions)
        assert outcome.faults == [], "\n".join(told[-40:])
        assert outcome.actions == actions
        assert len(outcome.counts) > 15
        undone += outcome.undone
        if undone:
            break
    assert undone > 0


def test_each_kind_of_fault_is_noted(qapp):
    with Watch() as watch:
        watch.doing = "pressing a button"
        try:
            raise ValueError("in a slot")
        except ValueError as error:
            sys.excepthook(type(error), error, error.__traceback__)
        thread = threading.Thread(target=lambda: 1 / 0)
        thread.start()
        thread.join()
        qWarning("a layout without a widget")
        qDebug("nothing to see")
        warnings.warn("old", DeprecationWarning, stacklevel=1)
    told = list(watch.faults)
    assert len(told) == 4, told
    for fault, words in zip(
        told, ("in a slot", "in a thread: ZeroDivisionError", "without a widget", "old"), strict=True
    ):
        assert words in fault
    assert set(watch.first.values()) == {"pressing a button"}
    assert watch.faults.total() == 4


def test_a_record_that_was_changed_has_another_digest():
    labels = np.zeros((6, 6, 6), np.int32)
    labels[1:4, 1:4, 1:4] = 1
    state = ProjectState(grains=load_labels(labels, voxel_size="1 um"))
    before = digest(state)
    assert digest(state) == before
    state.grains.table.loc[0, "volume"] *= 1.0001
    assert digest(state) != before


def test_qt_is_left_as_it_was(qapp):
    seen = []
    before = qInstallMessageHandler(lambda kind, _context, text: seen.append((kind, text)))
    try:
        with Watch():
            pass
        qWarning("heard")
    finally:
        qInstallMessageHandler(before)
    assert seen == [(QtMsgType.QtWarningMsg, "heard")]
