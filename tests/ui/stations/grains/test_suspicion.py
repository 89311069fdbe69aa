"""Suspicious grains are gone through by keys, with the reason; accepted ones are kept and not shown again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.project import Project
from mbstudio.scene.theme import rgb, score_colours
from mbstudio.ui.stations.grains.table_model import SUSPICION
from tests.core.grains.editing.placed_grains import ORIGIN, SIZE, ball, placed_labels, scan_of
from tests.core.project.test_twin_table import made_twin

FUSED, HALVES, WHOLE = 3, {5, 6}, {1, 2, 4}
NONE, CTRL, SHIFT = (
    Qt.KeyboardModifier.NoModifier,
    Qt.KeyboardModifier.ControlModifier,
    Qt.KeyboardModifier.ShiftModifier,
)


def suspicious_labels():
    """Return the placed grains, of which 3 is two that are fused, and a ball that was cut in 5 and 6."""
    labels = np.zeros((40, 48, 110), np.int32)
    labels[:, :, :72] = placed_labels()
    labels[ball(labels.shape, (20, 24, 95), 13)] = 5
    labels[:, :, 96:][labels[:, :, 96:] == 5] = 6
    return labels


@pytest.fixture
def at_grains(window, idle):
    grains = build_grain_set(suspicious_labels(), SIZE, ORIGIN)
    scan = scan_of(grains.labels)
    project = Project.new(scan, embed_scan=True)
    project.change("Find grains", grains=grains)
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    window.studio.enter("grains")
    window.resize(1500, 900)
    idle()
    return window


@pytest.fixture
def looked(at_grains, idle):
    """The window once all grains were looked at."""
    assert at_grains.commands.run("grains.look")
    idle()
    return at_grains


def press(window, key, modifier=NONE):
    QTest.keyClick(window, key, modifier)
    QTest.qWait(20)


def test_nothing_is_looked_at_unasked_and_n_looks_and_goes_to_the_first(at_grains, idle):
    space, station = at_grains.workspace, at_grains.stations.grains
    assert not at_grains.studio.offers.suspects
    assert station.card.look_button.isVisible()
    press(at_grains, Qt.Key.Key_N)
    idle()
    assert len(at_grains.studio.offers.suspects) == 6
    assert space.selected == FUSED or space.selected in HALVES
    assert int(space.state.grains.label_volume[cut_at(at_grains)]) == space.selected
    assert station.card.proposal.isVisible()


def cut_at(window):
    index = window.view.scene.layers.slices.planes.index
    return index["z"], index["y"], index["x"]


def test_keys_go_through_the_suspicious_grains_and_back(looked):
    space, tour = looked.workspace, looked.stations.grains.tour
    order = [one.label for one in tour.suspects]
    assert {FUSED} | HALVES == set(order)
    for label in (*order, order[0]):
        press(looked, Qt.Key.Key_N)
        assert space.selected == label
    press(looked, Qt.Key.Key_N, SHIFT)
    assert space.selected == order[-1]


def test_the_card_says_what_a_grain_looks_like_and_why(looked):
    space, card = looked.workspace, looked.stations.grains.card
    space.select(FUSED)
    assert card.proposal.text() == "Grain 3 looks like several grains: split it (S)."
    assert "of its convex hull" in card.reasons.text()
    space.select(5)
    assert card.proposal.text() == "Grain 5 looks like a part of grain 6: merge them (M)."
    assert "o groove along the border to grain 6" in card.reasons.text()
    assert card.count.text() == "3 grains are still to be looked at."
    space.select(1)
    assert not card.proposal.isVisible()


def test_a_part_is_chosen_with_the_rest_and_one_key_merges_them(looked, idle):
    space, tour = looked.workspace, looked.stations.grains.tour
    while space.selected not in HALVES:
        press(looked, Qt.Key.Key_N)
    kept = space.selected
    assert space.chosen == HALVES
    press(looked, Qt.Key.Key_M)
    idle()
    assert sorted(space.state.grains.table["label"]) == sorted([1, 2, 3, 4, kept])
    # What the edit touched was looked at again by itself: the ball is whole.
    assert set(looked.studio.offers.suspects) == {1, 2, 3, 4, kept}
    assert [one.label for one in tour.suspects] == [FUSED]
    press(looked, Qt.Key.Key_Z, CTRL)
    idle()
    assert {one.label for one in tour.suspects} == {FUSED} | HALVES


def test_enter_accepts_and_goes_on_undo_takes_it_back_and_the_project_keeps_it(looked, tmp_path, idle):
    space, tour = looked.workspace, looked.stations.grains.tour
    verdict = space.state.grains.verdict
    press(looked, Qt.Key.Key_N)
    first = space.selected
    press(looked, Qt.Key.Key_Return)
    assert space.state.grains.accepted_labels == {first}
    assert space.selected != first
    assert first not in [one.label for one in tour.suspects]
    assert space.state.grains.verdict is verdict
    assert space.undo_title == f"Accept grain {first}"
    path = space.project.save(tmp_path / "kept.mbs")
    again = Project.open(path or tmp_path / "kept.mbs")
    assert again.grains.accepted_labels == {first}
    again.close()
    space.undo()
    assert space.state.grains.accepted_labels == frozenset()
    assert first in [one.label for one in tour.suspects]


def test_enter_in_a_field_accepts_nothing(looked):
    panel = looked.stations.grains.panel
    press(looked, Qt.Key.Key_N)
    panel.smallest.setFocus()
    looked.studio.refresh()
    QTest.keyClick(panel.smallest, Qt.Key.Key_Return)
    assert looked.workspace.state.grains.accepted_labels == frozenset()


def test_an_accepted_grain_that_changes_is_looked_at_again(looked, idle):
    space, tour = looked.workspace, looked.stations.grains.tour
    space.select(FUSED)
    assert looked.commands.run("grains.accept")
    assert FUSED not in [one.label for one in tour.suspects]
    space.select(FUSED)
    looked.stations.grains.editing.smooth()
    idle()
    assert space.state.grains.accepted_labels == frozenset()
    assert FUSED in [one.label for one in tour.suspects]


def test_the_table_has_a_column_once_grains_were_looked_at_and_sorts_by_it(at_grains, idle):
    table = at_grains.stations.grains.table
    assert table.isColumnHidden(SUSPICION)
    at_grains.commands.run("grains.look")
    idle()
    assert not table.isColumnHidden(SUSPICION)
    table.sortByColumn(SUSPICION, Qt.SortOrder.DescendingOrder)
    assert set(table.labels_in_order()[:3]) == {FUSED} | HALVES
    at_grains.workspace.select(FUSED)
    at_grains.commands.run("grains.accept")
    index = table.content.index(table.content.row(FUSED), SUSPICION)
    assert table.content.data(index) == "accepted"
    assert FUSED not in table.labels_in_order()[:2]
    index = table.content.index(table.content.row(5), SUSPICION)
    assert float(table.content.data(index)) >= 0.3
    assert "grain 6" in table.content.data(index, Qt.ItemDataRole.ToolTipRole)


def test_the_gallery_can_be_sorted_by_suspicion(looked, idle):
    looked.shell.show_gallery(True)
    idle()
    gallery = looked.shell.gallery_link.gallery
    assert gallery.sort.findData("suspicion") > 0
    gallery.sort.setCurrentIndex(gallery.sort.findData("suspicion"))
    gallery.falling.setChecked(True)
    assert set(gallery.list.keys()[:3]) == {FUSED} | HALVES
    gallery.add_range()


def test_the_view_is_coloured_by_suspicion(looked, idle):
    layer = looked.view.scene.layers.grains
    looked.commands.run("grains.colour_by_suspicion")
    idle()
    mesh = layer.actors[0].mapper.dataset
    colours = {
        int(label): tuple(mesh.cell_data["colour"][mesh.cell_data["label"] == label][0])
        for label in np.unique(mesh.cell_data["label"])
    }
    one = looked.studio.offers.suspects[FUSED]
    assert colours[FUSED] == tuple(score_colours(np.array([one.score]))[0])
    assert all(colours[label] != colours[FUSED] for label in WHOLE)
    looked.workspace.select(FUSED)
    looked.commands.run("grains.accept")
    idle()
    looked.workspace.select(None)
    mesh = layer.actors[0].mapper.dataset
    shown = mesh.cell_data["colour"][mesh.cell_data["label"] == FUSED][0]
    assert tuple(shown) == tuple(score_colours(np.array([0.0]))[0])
    looked.commands.run("grains.colour_by_suspicion")
    assert layer.scores is None
    assert rgb(looked.theme.scene.grain) != tuple(shown)


def test_a_twin_makes_grains_suspicious_with_what_to_do(at_grains, idle):
    window = at_grains
    twin = made_twin(tuple(window.workspace.state.grains.table["label"].tolist()))
    contacts = twin.contacts.assign(gap=[0.0, 0.0, 0.0, 0.0, -2.0 * twin.voxel])
    peaks = [0.05, 0.4, 0.05, 0.05, 0.05, 0.05]
    residuals = twin.residuals.assign(peak=peaks)
    window.workspace.change("Fit the twin", twin=replace(twin, contacts=contacts, residuals=residuals))
    suspects = window.studio.offers.suspects
    assert {(one.label, one.kind, one.neighbour) for one in suspects.values()} == {
        (2, "merged", 0), (5, "split", 6), (6, "split", 5),
    }  # fmt: skip
    press(window, Qt.Key.Key_N)
    idle()
    assert window.workspace.chosen == {5, 6}
