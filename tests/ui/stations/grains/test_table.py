"""The table of grains: gaps stand last, the choice survives sorting, columns are the person's."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest

from mbstudio.core.grains import GrainSet
from mbstudio.core.units import VoxelSize
from mbstudio.ui.stations.grains.table import GrainTable
from mbstudio.ui.stations.grains.table_model import COLUMNS, SHARE, VERDICT

UP, DOWN = Qt.SortOrder.AscendingOrder, Qt.SortOrder.DescendingOrder
PLACES = {column.name: place for place, column in enumerate(COLUMNS)}


def grains_of(volumes):
    """A set of grains of these volumes, labelled from 1, whose voxels nobody asks for."""
    count = len(volumes)
    table = pd.DataFrame(
        {
            "label": np.arange(1, count + 1),
            "volume": np.asarray(volumes, float),
            "touches_border": np.arange(count) % 2 == 0,
        }
    )
    return GrainSet(np.zeros((1, 1, 1), np.int32), table, VoxelSize.parse("10 um"))


def fit_of(rms, n=10, valid=True):
    return SimpleNamespace(
        avatar=SimpleNamespace(n=n), verdict=SimpleNamespace(rms=rms, valid=valid, reasons=(), warnings=())
    )


NEEDLESS = ["use", "suspicion"]
"""Columns that say nothing while all grains take part and none was looked at."""


@pytest.fixture
def kept(tmp_path):
    return QSettings(str(tmp_path / "table.ini"), QSettings.Format.IniFormat)


@pytest.fixture
def table(qtbot, kept):
    table = GrainTable(kept)
    qtbot.addWidget(table)
    table.resize(700, 300)
    table.show()
    table.content.set_grains(grains_of([4e6, 1e6, 3e6, 2e6, 5e6]))
    table.content.set_fits({2: fit_of(0.4), 4: fit_of(0.2, 20, False), 5: fit_of(0.3)})
    return table


def text(table, label, name):
    index = table.content.index(table.content.row(label), PLACES[name])
    return table.content.data(index, Qt.ItemDataRole.DisplayRole)


@pytest.mark.parametrize(
    ("name", "up", "down"),
    [
        ("label", [1, 2, 3, 4, 5], [5, 4, 3, 2, 1]),
        ("volume", [2, 4, 3, 1, 5], [5, 1, 3, 4, 2]),
        ("rms", [4, 5, 2, 1, 3], [2, 5, 4, 1, 3]),
        ("n", [2, 5, 4, 1, 3], [4, 2, 5, 1, 3]),
        ("verdict", [4, 2, 5, 1, 3], [2, 5, 4, 1, 3]),
        ("border", [2, 4, 1, 3, 5], [1, 3, 5, 2, 4]),
    ],
)
def test_what_is_missing_stands_last_whichever_way(table, name, up, down):
    table.sortByColumn(PLACES[name], UP)
    assert table.labels_in_order() == up
    table.sortByColumn(PLACES[name], DOWN)
    assert table.labels_in_order() == down


def test_a_fit_that_arrives_takes_its_place(table):
    table.sortByColumn(PLACES["rms"], UP)
    table.select_labels([3], 3)
    table.content.set_fits({3: fit_of(0.25), 4: fit_of(0.2)})
    assert table.labels_in_order() == [4, 3, 1, 2, 5]
    assert table.chosen_labels() == [3]


def test_the_distance_is_told_in_percent_of_the_size_as_well(table):
    size = (6 * 1e6 / np.pi) ** (1 / 3)
    assert text(table, 2, "rms") == "0.400"
    assert float(text(table, 2, "share")) == pytest.approx(100 * 0.4 / size, rel=1e-2)
    assert text(table, 1, "share") == "–"


def test_the_choice_stays_with_its_grains_when_rows_change_places(table):
    told = []
    table.chosen.connect(lambda *given: told.append(given))
    table.select_labels([1, 2, 5], 2)
    table.sortByColumn(PLACES["volume"], DOWN)
    assert sorted(table.chosen_labels()) == [1, 2, 5]
    assert table.content.label(table.currentIndex().row()) == 2
    assert [index.row() for index in table.selectionModel().selectedRows()] == [0, 1, 4]
    assert told == []


def test_a_click_tells_all_chosen_labels(table, qtbot):
    table.sortByColumn(PLACES["volume"], UP)
    told = []
    table.chosen.connect(lambda *given: told.append(given))
    for row, key in ((0, Qt.KeyboardModifier.NoModifier), (3, Qt.KeyboardModifier.ShiftModifier)):
        place = table.visualRect(table.content.index(row, 0)).center()
        QTest.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, key, place)
    labels, current = told[-1]
    assert sorted(labels) == [1, 2, 3, 4]
    assert current == 1


def test_labels_that_are_no_grains_are_not_chosen(table):
    table.select_labels([2, 77], 77)
    assert table.chosen_labels() == [2]
    assert not table.currentIndex().isValid()
    table.select_labels([], None)
    assert table.chosen_labels() == []


def test_columns_are_chosen_by_the_person_and_remembered(table, kept, qtbot):
    assert not table.isColumnHidden(SHARE)
    table.resize(450, 300)
    assert [c.name for p, c in enumerate(COLUMNS) if table.isColumnHidden(p)] == [
        "volume", "share", *NEEDLESS
    ]  # fmt: skip
    actions = {action.text(): action for action in table.column_menu().actions()}
    actions["Verdict"].trigger()
    actions["RMS [%]"].trigger()
    hidden = {"volume", "verdict"}
    assert {c.name for p, c in enumerate(COLUMNS) if table.isColumnHidden(p)} == hidden | set(NEEDLESS)
    table.resize(900, 300)
    assert table.isColumnHidden(VERDICT)
    again = GrainTable(kept)
    qtbot.addWidget(again)
    assert again.hidden_columns == hidden
    table.choose_columns(None)
    assert [c.name for p, c in enumerate(COLUMNS) if table.isColumnHidden(p)] == NEEDLESS
    again.choose_columns(None)
    assert again.hidden_columns is None


def test_no_grains_are_an_empty_table(table):
    table.content.set_grains(None)
    assert table.model().rowCount() == 0
    table.sortByColumn(PLACES["share"], UP)
    assert table.labels_in_order() == []
