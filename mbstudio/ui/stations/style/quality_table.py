"""How good clones are: the paper's table against what true new grains would score, and how new they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt
from PySide6.QtGui import QBrush, QColor
from PySide6.QtWidgets import (
    QAbstractItemView,
    QFrame,
    QHBoxLayout,
    QHeaderView,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
)

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import Population
from mbstudio.scene.figures.population_style import readable_scale
from mbstudio.ui.language import mark, tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.factor_words import factor_title
from mbstudio.ui.widgets.forms import label
from mbstudio.ui.widgets.numbers import four_digits

if TYPE_CHECKING:
    from mbstudio.core.vae.generate.quality import FactorQuality, Quality

_TRUE = mark("true")
_HEADS = (
    mark("Factor"), mark("Mean"), mark("δ mean"), _TRUE, mark("Std. dev."), mark("δ s.d."), _TRUE,
    mark("K-S D"), _TRUE,
)  # fmt: skip
_TRUE_TIP = mark("The score that one in twenty samples of as many true new grains exceeds")
_TIPS = (
    mark("The paper's six factors"),
    mark("Mean of the clones; that of the parents in brackets"),
    mark("100 |clones − parents| / |parents| of the means"),
    _TRUE_TIP,
    mark("Standard deviation of the clones; that of the parents in brackets"),
    mark("100 |clones − parents| / |parents| of the standard deviations"),
    _TRUE_TIP,
    mark("Kolmogorov–Smirnov: largest distance of the two cumulative distributions"),
    _TRUE_TIP,
)
_FACTS = (
    (
        mark("Novelty"),
        mark("Median distance to the nearest parent over the parents' own: 1 means as new as real grains"),
    ),
    (
        mark("Copies"),
        mark("Share of clones nearer to a parent than 0.3 of the parents' own distance"),
    ),
    (
        mark("Diversity"),
        mark("Median distance to the nearest other clone over that of the parents: 1 means equally varied"),
    ),
    (
        mark("Valid"),
        mark("Share of the candidates, and of the clones, that are one body without voids"),
    ),
    (
        mark("Recognised as clones"),
        mark(
            "Area under the ROC curve of a forest that tells clones from parents as they were serialized, "
            "with the error of drawing and teaching it anew; 0.5 is guessing. Page Judge compares with the "
            "grains themselves"
        ),
    ),
)


class QualityTable(QFrame):
    """Table and facts of a generation's quality."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self._shown: tuple[Quality, Sequence[Population]] | None = None
        self.table = QTableWidget(0, len(_HEADS))
        self.table.setAccessibleName(tr("Errors of the clones' factors"))
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.table.setShowGrid(False)
        self.table.setAlternatingRowColors(True)
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(24)
        header = self.table.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionsClickable(False)
        header.setMinimumSectionSize(44)
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.words = label("", "hint", wrap=True)
        self.words.setContentsMargins(14, 6, 14, 6)
        self.selected_on = label(
            tr(
                "Against the serialized parents, by the factors that the generator selects on. Whether "
                "clones can be told from true grains stands on page Judge."
            ),
            "hint",
            wrap=True,
        )
        self.selected_on.setContentsMargins(14, 6, 14, 4)
        self._facts = {title: label("", "hint") for title, _ in _FACTS}
        line = QHBoxLayout()
        line.setContentsMargins(14, 4, 14, 5)
        line.setSpacing(22)
        for title, tip in _FACTS:
            self._facts[title].setToolTip(tr(tip))
            line.addWidget(self._facts[title])
        line.addStretch(1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.words)
        layout.addWidget(self.selected_on)
        layout.addWidget(self.table, 1)
        layout.addLayout(line)
        theme.changed.connect(self._fill)
        self.say("")

    def say(self, words: str) -> None:
        """Say why there is nothing to show."""
        self._shown = None
        self.words.setText(words)
        self._fill()

    def show_quality(self, quality: Quality, shown: Sequence[Population]) -> None:
        """Show a quality; `shown` are parents and clones, for readable units."""
        self._shown = quality, shown
        self._fill()

    def text(self, factor: str, head: str) -> str:
        """Return what stands in the row of a factor below the first head of this name."""
        cells = [
            [self.table.item(i, j) for j in (0, _HEADS.index(head))] for i in range(self.table.rowCount())
        ]
        return next(text.text() for name, text in cells if name and text and name.text() == factor)

    def fact(self, title: str) -> str:
        """Return a fact, by its title."""
        return self._facts[title].text().removeprefix(f"{tr(title)}: ")

    def _fill(self) -> None:
        there = self._shown is not None
        self.words.setVisible(not there)
        self.selected_on.setVisible(there)
        self.table.setVisible(there)
        for fact in self._facts.values():
            fact.setVisible(there)
        if self._shown is None:
            return
        quality, shown = self._shown
        self.table.setRowCount(len(quality.factors))
        for column, (head, tip) in enumerate(zip(_HEADS, _TIPS, strict=True)):
            item = QTableWidgetItem(tr(head))
            item.setToolTip(tr(tip))
            item.setTextAlignment(_side(column))
            self.table.setHorizontalHeaderItem(column, item)
        for row, factor in enumerate(quality.factors):
            self._fill_row(row, factor, shown)
        told, new = quality.discrimination, quality.novelty
        valid = tr("{kept:.0f} % of the clones", kept=100 * quality.valid_after)
        if quality.valid_before is not None:
            valid = tr("{drawn:.0f} % when drawn, {valid}", drawn=100 * quality.valid_before, valid=valid)
        facts = {
            "Novelty": f"{new.novelty:.2f}",
            "Copies": f"{100 * new.copies:.1f} %",
            "Diversity": f"{new.diversity:.2f}",
            "Valid": valid,
            "Recognised as clones": tr("too few to tell")
            if told is None
            else f"{told.auc:.2f} ± {told.error:.2f}",
        }
        for title, text in facts.items():
            self._facts[title].setText(f"{tr(title)}: {text}")

    def _fill_row(self, row: int, factor: FactorQuality, shown: Sequence[Population]) -> None:
        scale, unit = readable_scale(shown, factor.factor)
        floor, title = factor.floor, factor_title(factor.factor)
        shown_unit = FACTORS[factor.factor].unit(unit)
        words = f"{title} [{shown_unit}]" if shown_unit else title
        pairs = [[four_digits(scale * value) for value in pair] for pair in (factor.means, factor.deviations)]
        marks = {
            2: factor.mean_error <= floor.mean_error[1],
            5: factor.deviation_error <= floor.deviation_error[1],
            7: factor.ks <= floor.ks[1],
        }
        texts = (
            words,
            f"{pairs[0][1]} ({pairs[0][0]})", f"{factor.mean_error:.2f} %", f"≤ {floor.mean_error[1]:.2f}",
            f"{pairs[1][1]} ({pairs[1][0]})", f"{factor.deviation_error:.2f} %",
            f"≤ {floor.deviation_error[1]:.2f}", f"{factor.ks:.3f}", f"≤ {floor.ks[1]:.3f}",
        )  # fmt: skip
        tokens = self._theme.tokens
        for column, text in enumerate(texts):
            item = QTableWidgetItem(text)
            item.setTextAlignment(_side(column))
            item.setToolTip(tr(_TIPS[column]))
            if column in marks:
                item.setForeground(QBrush(QColor(tokens.success if marks[column] else tokens.danger)))
                measure = tr(_TIPS[column])
                item.setToolTip(
                    tr("{measure}. No worse than 19 of 20 samples of true new grains", measure=measure)
                    if marks[column]
                    else tr("{measure}. Worse than 19 of 20 samples of true new grains", measure=measure)
                )
            elif column in (3, 6, 8):
                item.setForeground(QBrush(QColor(tokens.muted)))
            self.table.setItem(row, column, item)


def _side(column: int) -> Qt.AlignmentFlag:
    side = Qt.AlignmentFlag.AlignLeft if column == 0 else Qt.AlignmentFlag.AlignRight
    return side | Qt.AlignmentFlag.AlignVCenter
