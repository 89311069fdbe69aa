"""A hand that corrects grains at random in the window: each edit is what Python gives, and all are undone."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from tests.ui.stations.grains.test_editing import click, pane_across
from tests.ui.stations.grains.test_slice_tools import draw

AXES = "zyx"
CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
KEYS = (Qt.Key.Key_M, Qt.Key.Key_Delete, Qt.Key.Key_X)
OUTLINES = ("grow", "shrink", "smooth", "fill_holes")
FEWEST = 3  # grains that are left: with none there is nothing to correct


class Hand:
    """Chooses grains and places at random, and presses keys and buttons of the mouse."""

    def __init__(self, window, idle, rng):
        self.window, self.idle, self.rng = window, idle, rng
        self.space, self.tools = window.workspace, window.stations.grains.tools

    def key(self, key, modifier=Qt.KeyboardModifier.NoModifier):
        QTest.keyClick(self.window, key, modifier)
        self.idle()

    def grain(self):
        return int(self.rng.choice(self.space.state.grains.table["label"].to_numpy()))

    def pane(self, label):
        """Cut a grain across a random axis; return the pane, and places (column, row) of it and about it."""
        axis = int(self.rng.integers(3))
        voxels = np.argwhere(self.space.state.grains.labels == label)
        index = int(self.rng.choice(voxels[:, axis]))
        self.window.view.move_slice(AXES[axis], index)
        rest = [other for other in (2, 1, 0) if other != axis]
        inside = voxels[voxels[:, axis] == index][:, rest]
        low, high = inside.min(axis=0) - 3, inside.max(axis=0) + 4
        return pane_across(self.window, AXES[axis]), inside, (low, high)

    def choose(self):
        """Do one thing that may correct something."""
        label = self.grain()
        self.space.choose([label, self.grain()] if self.rng.random() < 0.4 else [label], label)
        act = int(self.rng.integers(8))
        if act < 2:
            key = KEYS[self.rng.integers(len(KEYS))]
            if key != Qt.Key.Key_Delete or len(self.space.state.grains) > FEWEST + 1:
                self.key(key)
        elif act < 4:
            self.window.commands.run(f"grains.{OUTLINES[self.rng.integers(len(OUTLINES))]}")
        elif act < 6:
            self.paint(label)
        elif act == 6:
            self.split(label)
        else:
            self.begin_grain(label)
        self.idle()
        for _ in range(2):  # a message, a tool
            self.key(Qt.Key.Key_Escape)

    def paint(self, label):
        pane, _, (low, high) = self.pane(label)
        self.key(Qt.Key.Key_B if self.rng.random() < 0.5 else Qt.Key.Key_E)
        if self.rng.random() < 0.3:
            self.key(Qt.Key.Key_B, SHIFT)
        draw(pane, [tuple(self.rng.uniform(low, high)) for _ in range(3)])

    def split(self, label):
        pane, inside, (low, high) = self.pane(label)
        if self.rng.random() < 0.5:
            self.key(Qt.Key.Key_S)
            for place in self.rng.choice(inside, 2):
                click(pane, *place.tolist())
        else:
            self.key(Qt.Key.Key_S, SHIFT)
            draw(pane, [tuple(low), tuple((low + high) / 2), tuple(high)])
        self.idle()
        self.key(Qt.Key.Key_Return)

    def begin_grain(self, label):
        pane, _, (low, high) = self.pane(label)
        self.key(Qt.Key.Key_W)
        click(pane, *self.rng.uniform(low, high))
        self.idle()
        self.key(Qt.Key.Key_Return)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [20, pytest.param(500, marks=pytest.mark.full)])
def test_random_edits_are_what_python_gives_and_are_undone_bit_by_bit(at_grains, idle, grains, rng, count):
    space, hand = at_grains.workspace, Hand(at_grains, idle, rng)
    begun = space.project.history.position
    fits = dict(space.state.fits)
    made, states = grains, [grains.labels.copy()]
    for _ in range(12 * count):
        hand.choose()
        edits = space.state.grains.edits
        assert space.project.history.position - begun == len(edits)
        for edit in edits[len(made.edits) :]:
            made = made.edit(edit, space.scan).grains
        assert np.array_equal(space.state.grains.labels, made.labels)
        assert space.state.grains.table.equals(made.table)
        if len(states) <= len(edits):
            states.append(made.labels.copy())
        if len(edits) >= count:
            break
    assert len(space.state.grains.edits) >= count
    assert len({edit.kind for edit in made.edits}) >= 7
    last = made.labels
    for labels in states[-2::-1]:
        hand.key(Qt.Key.Key_Z, CONTROL)
        assert np.array_equal(space.state.grains.labels, labels)
    assert space.state.grains.edits == ()
    assert np.array_equal(space.state.grains.labels, grains.labels)
    assert all(space.state.fits[label] is fit for label, fit in fits.items())
    space.go_to(begun + len(states) - 1)
    assert np.array_equal(space.state.grains.labels, last)
