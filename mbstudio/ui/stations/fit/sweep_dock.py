"""A sweep over n in the window: what to sweep, what comes of it, and which n is enough."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QDoubleSpinBox,
    QFrame,
    QHBoxLayout,
    QHeaderView,
    QLineEdit,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
)

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.sweep import (
    SweepRow,
    checked_numbers,
    error_names,
    quantiles_of,
    smallest_numbers,
)
from mbstudio.core.populations import PAPER_FACTORS
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.fit.sweep_plots import SweepPlot, draw_sweep, line_colours, title_of
from mbstudio.ui.stations.fit.sweep_work import SweepWork
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label, primary_button
from mbstudio.ui.workspace import Workspace

NUMBERS = "10, 20, 40, 80, 120"
_NAME = Qt.ItemDataRole.UserRole


def read_numbers(text: str) -> tuple[int, ...]:
    """Read a list of numbers of control points.

    Raises
    ------
    FitError
        If there is none, or one is no whole number of 1 or more.
    """
    words = [word for word in re.split(r"[\s,;]+", text.strip()) if word]
    for word in words:
        if not word.isdecimal():
            raise FitError(
                tr(
                    "'{word}' is not a number of control points. Enter whole numbers, for example "
                    "'{numbers}'.",
                    word=word,
                    numbers=NUMBERS,
                )
            )
    return checked_numbers([int(word) for word in words])


class SweepDock(QFrame):
    """Field and buttons above, plots in the middle, the advice below.

    Attributes
    ----------
    advice_changed : signal
        Other errors or another limit were chosen, or there are other rows.
    """

    advice_changed = Signal()

    def __init__(self, workspace: Workspace, work: SweepWork, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumWidth(360)
        self._workspace, self._work, self._theme = workspace, work, theme
        self._chosen: list[str] = list(PAPER_FACTORS)
        self.numbers = QLineEdit(NUMBERS)
        self.numbers.setAccessibleName(tr("Numbers of control points to try"))
        self.numbers.setToolTip(tr("Numbers of control points n to try, separated by commas"))
        self.grains = QComboBox()
        self.grains.setAccessibleName(tr("Grains to sweep"))
        self.grains.setToolTip(tr("Which grains are fitted with each n"))
        self.start_button = primary_button(tr("Sweep"))
        self.cancel_button = QPushButton(tr("Cancel"))
        self.refusal = label("", "refusal", wrap=True)
        self.loss = SweepPlot(
            theme, tr("Mean loss"), tr("Loss against n"), tr("The loss of each fit is drawn here")
        )
        self.errors = SweepPlot(
            theme,
            tr("Error (%)"),
            tr("Errors against n"),
            tr("Errors of all factors against n are drawn here"),
        )
        self.limit = QDoubleSpinBox()
        self.limit.setRange(0.01, 100.0)
        self.limit.setValue(1.0)
        self.limit.setDecimals(2)
        self.limit.setSuffix(" %")
        self.limit.setAccessibleName(tr("Error limit"))
        self.limit.setToolTip(
            tr("The smallest n from which the median error stays at or below this limit is shown")
        )
        self.table = _table()
        self.use_button = QPushButton(tr("Use this n"))
        self._layout()
        self._connect()
        self.refresh()

    def _layout(self) -> None:
        layout = QVBoxLayout(self)
        layout.setContentsMargins(14, 4, 14, 10)
        layout.setSpacing(6)
        first, second, last = QHBoxLayout(), QHBoxLayout(), QHBoxLayout()
        for words, field in (("n", self.numbers), (tr("of"), self.grains)):
            first.addWidget(label(words, "key"))
            first.addWidget(field, 1)
        for button in (self.start_button, self.cancel_button):
            second.addWidget(button, 1)
        last.addWidget(label(tr("Error at most"), "key"))
        last.addWidget(self.limit)
        last.addStretch(1)
        last.addWidget(self.use_button)
        self._advice_note = label("", "hint", wrap=True)
        layout.addLayout(first)
        layout.addLayout(second)
        layout.addWidget(self.refusal)
        layout.addWidget(self.loss, 3)
        layout.addWidget(self.errors, 4)
        layout.addWidget(self.table, 4)
        layout.addWidget(self._advice_note)
        layout.addLayout(last)

    def _connect(self) -> None:
        self.numbers.returnPressed.connect(self.start_button.click)
        self.numbers.textEdited.connect(lambda _: self._refuse(""))
        self.limit.valueChanged.connect(lambda _: self._show_rows())
        self.table.itemSelectionChanged.connect(self._choice_changed)
        self._work.rows_changed.connect(self._show_rows)
        self.grains.currentIndexChanged.connect(lambda _: self._name_start())
        self._work.changed.connect(self.refresh)
        for signal in (self._workspace.selection_changed, self._workspace.grains_changed):
            signal.connect(self.refresh)
        self._theme.changed.connect(self._show_rows)

    # ---- running -------------------------------------------------------------------------------

    def labels(self) -> list[int]:
        """Labels of the grains that would be swept."""
        grains = self._workspace.state.grains
        if grains is None:
            return []
        if self.grains.currentData() == "inside":
            return grains.interior_labels
        return sorted(self._workspace.chosen - grains.excluded_labels)

    def choose(self, which: str) -> None:
        """Choose which grains are swept: 'chosen' or 'inside'."""
        self.grains.setCurrentIndex(self.grains.findData(which))

    def start(self) -> None:
        """Begin to sweep, or say why not."""
        try:
            numbers = read_numbers(self.numbers.text())
        except FitError as error:
            self._refuse(str(error))
            self.numbers.setFocus()
            return
        if not self.labels():
            self._refuse(
                tr("No grain is selected. Click one in the view or the table, or choose all inside.")
            )
            return
        self._refuse("")
        self._work.start(self.labels(), numbers)

    def refresh(self) -> None:
        """Show which grains there are to sweep, and what can be done now."""
        grains = self._workspace.state.grains
        inside = 0 if grains is None else len(grains.interior_labels)
        excluded = frozenset() if grains is None else grains.excluded_labels
        chosen = len(self._workspace.chosen - excluded)
        kind = self.grains.currentData() or "chosen"
        with QSignalBlocker(self.grains):
            self.grains.clear()
            self.grains.addItem(tr("chosen grains ({count})", count=chosen), "chosen")
            self.grains.addItem(tr("all inside ({count})", count=inside), "inside")
            self.grains.setCurrentIndex(self.grains.findData(kind))
        self._name_start()
        self._show_rows()

    def _name_start(self) -> None:
        """Say on the button how many grains would be swept."""
        count = len(self.labels())
        self.start_button.setText(
            tr("Sweeping …")
            if self._work.run.is_running
            else plural(count, mark("Sweep {count} grain"), mark("Sweep {count} grains"))
            if count
            else tr("Sweep")
        )

    # ---- what came of it -----------------------------------------------------------------------

    @property
    def advice(self) -> int | None:
        """The smallest n with which all errors that are chosen in the table are small enough."""
        rows = self._work.rows
        if not rows or not self._chosen:
            return None
        smallest = smallest_numbers(rows, self.limit.value() / 100)
        wanted = [smallest.get(name) for name in self._chosen]
        known = [n for n in wanted if n is not None]
        return max(known) if len(known) == len(wanted) else None

    def _show_rows(self) -> None:
        rows = self._work.rows
        draw_sweep(self.loss, self.errors, rows, self._chosen, self.limit.value(), self._theme)
        self._fill_table()
        failed = [row for row in rows if row.error]
        if failed:
            one = failed[0]
            told = tr("Grain {label}, n = {n}: {error}", label=one.label, n=one.n, error=one.error)
            self._refuse(
                tr("{failed} of {count} fits failed. {told}", failed=len(failed), count=len(rows), told=told)
            )
        self._write_advice()

    def _fill_table(self) -> None:
        rows = [row for row in self._work.rows if np.isfinite(row.loss)]
        names = error_names(rows) if rows else []
        last = max((row.n for row in rows), default=0)
        smallest = smallest_numbers(rows, self.limit.value() / 100) if rows else {}
        with QSignalBlocker(self.table):
            self.table.setRowCount(len(names))
            for head, text in enumerate(
                (tr("Error of"), tr("at n = {n}", n=last) if rows else "", tr("Smallest n"))
            ):
                item = QTableWidgetItem(text)
                item.setTextAlignment(_side(head))
                self.table.setHorizontalHeaderItem(head, item)
            self.table.clearSelection()
            for place, name in enumerate(names):
                median = quantiles_of([row for row in rows if row.n == last], _error(name), (0.5,))
                shown = f"{100 * median[last][0]:.3g} %" if last in median else "–"
                n = smallest[name]
                for column, text in enumerate((title_of(name), shown, tr("none") if n is None else str(n))):
                    item = QTableWidgetItem(text)
                    item.setTextAlignment(_side(column))
                    item.setData(_NAME, name)
                    self.table.setItem(place, column, item)
                    item.setSelected(name in self._chosen)
                self._head_of(place).setIcon(self._swatch(name))

    def _head_of(self, row: int) -> QTableWidgetItem:
        cell = self.table.item(row, 0)
        assert cell is not None
        return cell

    def _swatch(self, name: str) -> QIcon:
        square = QPixmap(10, 10)
        square.fill(Qt.GlobalColor.transparent)
        if name in self._chosen:
            colours = line_colours(self._theme)
            square.fill(QColor(colours[self._chosen.index(name) % len(colours)]))
        return QIcon(square)

    def _choice_changed(self) -> None:
        picked = self.table.selectionModel().selectedRows()
        self._chosen = [self._head_of(index.row()).data(_NAME) for index in picked]
        rows = self._work.rows
        draw_sweep(self.loss, self.errors, rows, self._chosen, self.limit.value(), self._theme)
        for place in range(self.table.rowCount()):
            item = self._head_of(place)
            item.setIcon(self._swatch(item.data(_NAME)))
        self._write_advice()

    def _write_advice(self) -> None:
        n = self.advice
        rows = self._work.rows
        smallest = smallest_numbers(rows, self.limit.value() / 100) if rows else {}
        missed = [title_of(name) for name in self._chosen if smallest.get(name) is None]
        if not rows:
            note = ""
        elif not self._chosen:
            note = tr("Select the errors that matter in the table.")
        elif missed:
            note = tr(
                "None of the tested n meets {limit:g} % for {errors}.",
                limit=self.limit.value(),
                errors=", ".join(missed),
            )
        else:
            note = tr(
                "From n = {n}, all selected median errors are {limit:g} % or less.",
                n=n,
                limit=self.limit.value(),
            )
        self.advice_changed.emit()
        self._advice_note.setText(note)
        self._advice_note.setVisible(bool(note))
        self.use_button.setText(tr("Use this n") if n is None else tr("Use n = {n}", n=n))
        self.use_button.setToolTip(
            tr(
                "None of the tested n meets this limit for all selected rows. Try larger n, or select "
                "fewer rows"
            )
            if n is None and self._work.rows
            else tr("Fit with the smallest n that meets the limit for all selected rows of the table")
        )

    def _refuse(self, words: str) -> None:
        self.refusal.setText(words)
        self.refusal.setVisible(bool(words))


def _error(name: str) -> Callable[[SweepRow], float]:
    return lambda row: row.error_of(name)


def _side(column: int) -> Qt.AlignmentFlag:
    side = Qt.AlignmentFlag.AlignLeft if column == 0 else Qt.AlignmentFlag.AlignRight
    return side | Qt.AlignmentFlag.AlignVCenter


def _table() -> QTableWidget:
    table = QTableWidget(0, 3)
    table.setAccessibleName(tr("Errors and the smallest n for each"))
    table.setToolTip(tr("Select the errors that matter. The button below uses the n that meets all of them"))
    table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
    table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    table.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
    table.setTabKeyNavigation(False)
    table.setShowGrid(False)
    table.setMinimumHeight(120)
    table.verticalHeader().hide()
    table.verticalHeader().setDefaultSectionSize(25)
    header = table.horizontalHeader()
    header.setHighlightSections(False)
    header.setSectionsClickable(False)
    header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
    return table
