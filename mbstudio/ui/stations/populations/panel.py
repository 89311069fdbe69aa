"""Station Populations: grains and avatars as two populations, and how far they are apart."""

from __future__ import annotations

from collections.abc import Iterable

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QCheckBox, QComboBox, QDoubleSpinBox, QHBoxLayout, QPushButton

from mbstudio.core.errors import MbstudioError
from mbstudio.core.metrics.factor_table import AXES, FACTORS
from mbstudio.core.populations import Population
from mbstudio.core.populations.sieving import SERIES_NAMES
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.stations.populations.certainty import CertaintyWork
from mbstudio.ui.stations.populations.plots import Shown
from mbstudio.ui.stations.populations.work import PopulationWork
from mbstudio.ui.widgets.comparison_table import (
    FACTOR_ROWS,
    NEED_ROWS,
    SIZE_ROWS,
    ComparisonTable,
    fill_factor,
    fill_needs,
    fill_sizes,
)
from mbstudio.ui.widgets.factor_words import factor_label, factor_tip
from mbstudio.ui.widgets.forms import label, primary_button, row
from mbstudio.ui.widgets.numbers import readable_time
from mbstudio.ui.workspace import Workspace

_WIDE = 200  # pixels: names of factors are long


class PopulationPanel(Panel):
    """What is measured and looked at, with the numbers of the comparison.

    Attributes
    ----------
    shown_changed : signal (Shown)
    certainty_changed : signal (Shown)
        What is shown is the same, and its intervals are known now.
    """

    shown_changed = Signal(object)
    certainty_changed = Signal(object)

    def __init__(self, workspace: Workspace, work: PopulationWork) -> None:
        super().__init__(tr("Populations"), tr("Distributions of grains and avatars, and how they differ."))
        self._workspace, self._work = workspace, work
        self._certainty = CertaintyWork(self)
        self.scope, self.axes, self.detail = (
            QComboBox(),
            QComboBox(),
            QCheckBox(tr("Detailed factors (slower)")),
        )
        self.scope.addItem(tr("With an avatar"), "fitted")
        self.scope.addItem(tr("All inside"), "inside")
        self.scope.addItem("", "chosen")
        for name, convention in AXES.items():
            self.axes.addItem(tr(convention.title), name)
            self.axes.setItemData(self.axes.count() - 1, tr(convention.meaning), 3)
        self.detail.setToolTip(
            tr(
                "Also convexity, inscribed and enclosing sphere, Feret diameters, roundness, roughness and "
                "the bands of spherical harmonics: takes about five times as long"
            )
        )
        self._add_factor()
        self._add_sizes()
        for field in (
            self.scope, self.axes, self.factor, self.second, self.by, self.sieves, self.precision,
        ):  # fmt: skip
            field.setFixedWidth(_WIDE)
        self.body.addStretch(1)
        self._hint = label("", "hint", wrap=True)
        self.measure_button = primary_button(tr("Measure"))
        self.report_button = QPushButton(tr("Report…"))
        self.report_button.setToolTip(
            tr("Write tables and figures as one file (HTML, PDF or JSON), as “mbstudio report” does")
        )
        line = QHBoxLayout()
        line.addWidget(self.measure_button, 1)
        line.addWidget(self.report_button)
        self.foot.addWidget(self._hint)
        self.foot.addLayout(line)
        self._connect()
        self.refresh()

    def _add_factor(self) -> None:
        self.factor, self.second, self.by, self.sieves = QComboBox(), QComboBox(), QComboBox(), QComboBox()
        self.by.addItem(tr("By number"), "number")
        self.by.addItem(tr("By mass"), "volume")
        self.sieves.addItem(tr("Size of each body"), None)
        for name, title in SERIES_NAMES.items():
            self.sieves.addItem(title, name)
        self._offer(FACTORS.core)
        self.add(
            row(
                tr("Grains"),
                self.scope,
                tr("Grains that have an avatar, all grains not cut by the edge, or the chosen ones"),
            ),
            row(tr("Axes"), self.axes, tr("How the axes a ≥ b ≥ c of a body are found")),
            self.detail,
        )
        self.add_heading(tr("Factor"))
        self.add(
            row(
                tr("Factor"),
                self.factor,
                tr("Shape factor of the distributions, and horizontal axis of the pairs"),
            ),
            row(tr("Against"), self.second, tr("Vertical axis of the pairs")),
            row(
                tr("Weighting"),
                self.by,
                tr("Weight every body equally, or by its volume (mass at constant density)"),
            ),
        )
        self.statistics = ComparisonTable(tr("Statistics of the factor"), FACTOR_ROWS)
        self.sizes = ComparisonTable(tr("Sizes by mass"), SIZE_ROWS)
        self._sizes_note = label("", "hint", wrap=True)
        self.add(self.statistics)

    def _add_sizes(self) -> None:
        self.add_heading(tr("Particle size by mass"))
        self.add(
            row(
                tr("Read at"),
                self.sieves,
                tr("Percentage finer at the intermediate axis b of each body, or on sieves"),
            ),
            self.sizes,
            self._sizes_note,
        )
        self.laboratory_button = QPushButton(tr("Laboratory table…"))
        self.border = QCheckBox(tr("Correct for the border"))
        self.border.setToolTip(
            tr("Count each grain inside for those of its size that the border cuts (Miles-Lantuéjoul)")
        )
        self.add(self.border, self.laboratory_button)
        self.add_heading(tr("Enough grains?"))
        self.precision = QDoubleSpinBox()
        self.precision.setRange(0.5, 50.0)
        self.precision.setDecimals(1)
        self.precision.setValue(5.0)
        self.precision.setPrefix("± ")
        self.precision.setSuffix(" %")
        self.precision.setKeyboardTracking(False)
        self.needs = ComparisonTable(tr("Enough grains?"), NEED_ROWS)
        self.needs.setToolTip(
            tr("Precision reached, and grains needed: after ISO 13322-1 and by drawing these grains again")
        )
        self.add(
            row(
                tr("Precision"),
                self.precision,
                tr("Wanted half width of the 95 % intervals of sizes by mass"),
            ),
            self.needs,
        )

    def _connect(self) -> None:
        for field, name in ((self.scope, "scope"), (self.axes, "axes")):
            field.currentIndexChanged.connect(
                lambda _, field=field, name=name: self._work.ask(**{name: field.currentData()})
            )
        self.detail.toggled.connect(lambda on: self._work.ask(detail=on))
        for field in (self.factor, self.second, self.by, self.sieves):
            field.currentIndexChanged.connect(self._show_choice)
        self.border.toggled.connect(self._show_choice)
        self.precision.valueChanged.connect(self._show_choice)
        self._certainty.changed.connect(self._show_certainty)
        self._work.changed.connect(self.refresh)
        self._work.grown.connect(self.refresh)
        self._workspace.selection_changed.connect(self._write_hint)

    @property
    def shown(self) -> Shown:
        """What is looked at, as the fields say."""
        return Shown(
            self.factor.currentData(), self.second.currentData(), self.by.currentData(),
            self.sieves.currentData(), self.border.isChecked(), self._certainty.found,
        )  # fmt: skip

    def refresh(self) -> None:
        """Show the populations that there are, and what can be done now."""
        populations = self._work.shown
        if populations:
            self._offer([f for f in populations[0].factors if all(f in p.factors for p in populations)])
        self._write_hint()
        self._show_choice()

    def close_certainty(self) -> None:
        """End the thread that finds intervals."""
        self._certainty.worker.close()

    @property
    def is_certain(self) -> bool:
        """Whether the intervals of what is shown are known, or there are none to come."""
        return self._certainty.worker.is_idle

    def choose_scope(self, scope: str) -> None:
        """Choose which grains are measured: 'fitted', 'inside' or 'chosen'."""
        self.scope.setCurrentIndex(self.scope.findData(scope))

    def _name_chosen(self) -> None:
        chosen = len(self._workspace.chosen)
        if self._work.asked.scope == "chosen":
            chosen = len(self._work.wanted.chosen)
        self.scope.setItemText(self.scope.findData("chosen"), tr("Chosen grains ({count})", count=chosen))

    def _show_choice(self, *_: object) -> None:
        populations = self._work.shown
        shown = self.shown
        if self._work.is_growing:
            self._certainty.ask([], shown.factor, shown.by, 0.0)
        else:
            self._certainty.ask(populations, shown.factor, shown.by, self.precision.value() / 100.0)
        self._fill(populations)
        self.shown_changed.emit(self.shown)

    def _show_certainty(self) -> None:
        self._fill(self._work.shown)
        self.certainty_changed.emit(self.shown)

    def _fill(self, populations: list[Population]) -> None:
        shown = self.shown
        certainty = self._certainty.found
        for part in (self.statistics, self.sizes, self.needs):
            part.setVisible(bool(populations))
        self._sizes_note.hide()
        if not populations:
            return
        try:
            fill_needs(self.needs, [] if certainty is None else certainty.needs)
            means = () if certainty is None else certainty.means
            tests = () if certainty is None else certainty.tests
            fill_factor(self.statistics, populations, shown.factor, shown.by, means, tests)
            fill_sizes(self.sizes, populations, shown.sieves)
            if shown.border:
                self._sizes_note.setText(
                    tr("The curves are corrected for the border; these numbers are of the grains inside.")
                )
                self._sizes_note.show()
        except MbstudioError as error:
            self.sizes.hide()
            self._sizes_note.setText(str(error))
            self._sizes_note.show()

    def _offer(self, factors: Iterable[str]) -> None:
        """Fill the two choices of a factor, keeping what was chosen."""
        names = list(factors)
        for field, usual in ((self.factor, "sphericity"), (self.second, "csf")):
            if [field.itemData(place) for place in range(field.count())] == names:
                continue
            chosen = field.currentData() or usual
            with QSignalBlocker(field):
                field.clear()
                for name in names:
                    field.addItem(factor_label(name), name)
                    field.setItemData(field.count() - 1, factor_tip(name), Qt.ItemDataRole.ToolTipRole)
                field.setCurrentIndex(max(0, field.findData(chosen)))
                field.view().setMinimumWidth(230)

    def _write_hint(self) -> None:
        work, state, chosen = self._work, self._workspace.state, self._workspace.chosen
        self._name_chosen()
        if state.grains is None:
            text = tr("Find the grains first (station Grains).")
        elif work.run.is_running:
            text = tr("Measuring … see the status bar for progress and to cancel; what is measured is kept.")
        elif not work.has_bodies:
            text = tr("No grain is chosen. Click one in the view or the table; Ctrl or Shift adds more.")
        elif not work.is_current:
            if not self.isVisible():
                return  # to count thousands of bodies after each correction would make it slow
            text = self._what_is_left()
        elif chosen:
            listed = ", ".join(map(str, sorted(chosen)[:8])) + (" …" if len(chosen) > 8 else "")
            text = plural(
                len(chosen),
                mark("Chosen: grain {labels}."),
                mark("{count} chosen: grains {labels}."),
                labels=listed,
            )
        else:
            text = tr("No grain is selected. Click or drag in a plot, the view or the table.")
        self._hint.setText(text)
        self.measure_button.setText(tr("Measure again") if work.measured is not None else tr("Measure"))

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._write_hint()

    def _what_is_left(self) -> str:
        """Say what measuring would take."""
        left, count = self._work.bodies_left
        if left == 0:
            return plural(
                count,
                mark("The body is measured already: press the button to show it."),
                mark("All {count} bodies are measured already: press the button to show them."),
            )
        time = readable_time(self._work.seconds_for(left))
        if self._work.measured is not None:
            return tr(
                "Out of date. {left} of {count} bodies are still to be measured: about {time}.",
                left=left,
                count=count,
                time=time,
            )
        if left < count:
            return tr(
                "{left} of {count} bodies are still to be measured: about {time}.",
                left=left,
                count=count,
                time=time,
            )
        return plural(
            count,
            mark("{count} grain is to be measured: about {time}."),
            mark("{count} grains and avatars are to be measured: about {time}."),
            time=time,
        )
