"""Whether clones can be told from true grains: the judge's areas by set of features."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import Qt
from PySide6.QtGui import QBrush, QColor
from PySide6.QtWidgets import (
    QAbstractItemView,
    QFrame,
    QHBoxLayout,
    QHeaderView,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
)

from mbstudio.ui.language import mark, tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label

if TYPE_CHECKING:
    from mbstudio.core.judging.judgement import Area, Judgement

_CHANCE = mark("chance")
_HEADS = (
    mark("Features"), mark("Logistic"), _CHANCE, mark("Forest"), _CHANCE, mark("Verdict"),
)  # fmt: skip
_SETS = {
    "all": mark("all"),
    "bands 2-12": mark("harmonics 2–12"),
    "bands 2-20": mark("harmonics 2–20"),
    "curvature": mark("curvature"),
    "edge angles": mark("edge angles"),
    "convexity and roughness": mark("convexity, roughness"),
    "form": mark("form"),
}
_AREA_TIP = mark(
    "Area under the ROC curve of grains held out with all their relatives, ± one standard error: 0.5 cannot "
    "be told apart, 1 always"
)


class JudgeTable(QFrame):
    """Areas by set of features, with the buttons that judge and cancel."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._shown: Judgement | None = None
        self.judge_button = QPushButton(tr("Judge clones"))
        self.cancel_button = QPushButton(tr("Cancel"))
        self.words = label("", "hint", wrap=True)
        self.table = QTableWidget(0, len(_HEADS))
        self.table.setAccessibleName(tr("Clones told from true grains"))
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.table.setShowGrid(False)
        self.table.setAlternatingRowColors(True)
        self.table.setTabKeyNavigation(False)
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(22)
        header = self.table.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionsClickable(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setStretchLastSection(True)
        line = QHBoxLayout()
        line.setContentsMargins(14, 6, 14, 4)
        line.setSpacing(10)
        line.addWidget(self.words, 1)
        for button in (self.judge_button, self.cancel_button):
            line.addWidget(button, 0, Qt.AlignmentFlag.AlignTop)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addLayout(line)
        layout.addWidget(self.table, 1)
        layout.addStretch(0)
        theme.changed.connect(self._fill)
        self.say("")

    def say(self, words: str, is_running: bool = False) -> None:
        """Say why there is nothing to show."""
        self._shown = None
        self.words.setText(words)
        self.words.setToolTip("")
        self.judge_button.setVisible(not is_running)
        self.cancel_button.setVisible(is_running)
        self._fill()

    def show_judgement(self, judgement: Judgement) -> None:
        """Show what was found."""
        self._shown = judgement
        told = judgement.is_told_apart
        self.words.setText(
            tr("The clones are told from {count} true grains.", count=judgement.numbers[0])
            if told
            else tr(
                "The clones are not told from {count} true grains, within the error.",
                count=judgement.numbers[0],
            )
        )
        self.words.setToolTip("\n".join(judgement.notes))
        self.judge_button.hide()
        self.cancel_button.hide()
        self._fill()

    def _fill(self) -> None:
        self.table.setVisible(self._shown is not None)
        if self._shown is None:
            return
        results = self._shown.comparisons[0].results
        for column, head in enumerate(_HEADS):
            item = QTableWidgetItem(tr(head))
            side = Qt.AlignmentFlag.AlignLeft if column in (0, 5) else Qt.AlignmentFlag.AlignRight
            item.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
            self.table.setHorizontalHeaderItem(column, item)
        self.table.setRowCount(len(results))
        for row, result in enumerate(results):
            name = QTableWidgetItem(tr(_SETS[result.features]))
            self.table.setItem(row, 0, name)
            for column, area in ((1, result.logistic), (3, result.forest)):
                self.table.setItem(row, column, self._cell(area))
                chance = QTableWidgetItem(f"< {area.chance:.2f}")
                chance.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                chance.setForeground(QBrush(QColor(self._theme.tokens.muted)))
                chance.setToolTip(tr("What permuted labels stay below in 19 of 20 cases"))
                self.table.setItem(row, column + 1, chance)
            self.table.setItem(row, 5, QTableWidgetItem(_verdict(result.is_told_apart)))

    def _cell(self, area: Area) -> QTableWidgetItem:
        item = QTableWidgetItem(f"{area.value:.2f} ± {area.error:.2f}")
        item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        tokens = self._theme.tokens
        item.setForeground(QBrush(QColor(tokens.danger if area.is_told_apart else tokens.success)))
        item.setToolTip(tr(_AREA_TIP))
        return item


def _verdict(is_told_apart: bool) -> str:
    return tr("told apart") if is_told_apart else tr("not told apart")
