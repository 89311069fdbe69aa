"""The page on which clones are generated: how many, what they are to be like, the one looked at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtWidgets import (
    QDoubleSpinBox,
    QHBoxLayout,
    QPlainTextEdit,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.cloning.clone_maker import CloneOptions
from mbstudio.core.cloning.surface_generation import SurfaceGeneration
from mbstudio.core.errors import GenerationError
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import Population
from mbstudio.scene.figures.population_style import readable_scale
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.style.clone_work import CloneWork
from mbstudio.ui.stations.style.dock import SHOWN
from mbstudio.ui.widgets.comparison_table import ComparisonTable
from mbstudio.ui.widgets.forms import label, primary_button, row
from mbstudio.ui.widgets.numbers import four_digits
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.vae.generate.generation import Generation

_ROWS = tuple(
    (factor.symbol if factor.power else factor.title, factor.title)
    for factor in (FACTORS[name] for name in SHOWN)
)


_RANGES = {"stretch": (1.0, 3.0), "warping": (0.0, 1.5), "detail_stretch": (0.0, 1.0)}
_LOOK = mark("Click a clone in the view, or a row of the table, to look at it.")


class GeneratePage(QWidget):
    """Asks for clones, and shows the one that is looked at.

    Attributes
    ----------
    foot : QWidget
        The buttons, for the panel's foot.
    """

    def __init__(self, workspace: Workspace, work: CloneWork) -> None:
        super().__init__()
        self._workspace, self._work = workspace, work
        self.count, self.seed = QSpinBox(), QSpinBox()
        self.count.setRange(1, 100_000)
        self.count.setValue(100)
        self.seed.setRange(0, 2**31 - 1)
        self.stretch, self.warping, self.detail_stretch = (QDoubleSpinBox() for _ in range(3))
        for field, name in (
            (self.stretch, "stretch"), (self.warping, "warping"), (self.detail_stretch, "detail_stretch")
        ):  # fmt: skip
            about = CloneOptions.list_options().options[name]
            field.setRange(*_RANGES[name])
            field.setSingleStep(0.05)
            field.setDecimals(2)
            field.setValue(about.default)
        self.where = QPlainTextEdit()
        self.where.setPlaceholderText("sphericity=0.75..0.8\nD50=0.4 mm")
        self.where.setAccessibleName(tr("Conditions"))
        self.where.setTabChangesFocus(True)
        self.where.setFixedHeight(64)
        tip = tr(
            "<p>Conditions that the clones must meet, one on each line: "
            "<i>sphericity=0.75..0.8</i> for every clone, <i>csf=0.7+-0.05</i> for mean and "
            "deviation, <i>D50=0.4 mm</i>, <i>sieve=0.3:10,0.4:55,0.6:100 mm</i>. Leave empty for "
            "clones like their parents.</p>"
        )
        self.where.setToolTip(tip)
        self.refusal = label("", "refusal", wrap=True)
        self.refusal.hide()
        conditions = label(tr("Conditions"), "key")
        conditions.setBuddy(self.where)
        conditions.setToolTip(tip)
        self._clone = label("", "figure")
        self._facts = label("", "hint", wrap=True)
        self.factors = ComparisonTable(tr("Factors of the clone"), _ROWS)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(10)
        self._strengths = (
            row(
                tr("Stretch up to"),
                self.stretch,
                tr(
                    "By how much a parent may be stretched or squeezed along an axis to take on another "
                    "form: more is newer, and easier to tell"
                ),
            ),
            row(
                tr("Warping"),
                self.warping,
                tr("Strength of the smooth warp; 1 is as grains of this kind differ"),
            ),
            row(
                tr("Stretch of details"),
                self.detail_stretch,
                tr(
                    "Share of the stretch that edges and roughness take on: 0 only turns them, 1 keeps "
                    "planes plane and makes squeezed edges sharper"
                ),
            ),
        )
        for part in (
            row(tr("Clones"), self.count, tr("How many new grains")),
            row(tr("Seed"), self.seed, tr("The same seed gives the same clones")),
            *self._strengths,
            conditions,
            self.where,
            self.refusal,
        ):
            layout.addWidget(part)
        layout.addSpacing(8)
        for part in (self._clone, self._facts, self.factors):
            layout.addWidget(part)
        layout.addStretch(1)
        self._make_foot()
        self._connect()
        self.refresh()

    def _make_foot(self) -> None:
        self.foot = QWidget()
        layout = QVBoxLayout(self.foot)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(8)
        self._hint = label("", "hint", wrap=True)
        self.generate_button = primary_button(tr("Generate"))
        self.cancel_button = QPushButton(tr("Cancel"))
        self.report_button = QPushButton(tr("Report…"))
        self.report_button.setToolTip(tr("Write a comparison of parents and clones as one HTML file"))
        self.populations_button, self.export_button = (
            QPushButton(tr("Populations")),
            QPushButton(tr("Export…")),
        )
        self.populations_button.setToolTip(
            tr("Compare the clones with grains and avatars at station Populations")
        )
        self.export_button.setToolTip(tr("Write the clones for a DEM engine at station Export"))
        self._after = QWidget()
        line = QHBoxLayout(self._after)
        line.setContentsMargins(0, 0, 0, 0)
        line.setSpacing(8)
        for button in (self.report_button, self.populations_button, self.export_button):
            line.addWidget(button, 1)
        for part in (self._hint, self.generate_button, self.cancel_button, self._after):
            layout.addWidget(part)

    def _connect(self) -> None:
        self.where.textChanged.connect(lambda: self._refuse(""))
        self._work.refused.connect(self._refuse)
        self._work.changed.connect(self.refresh)
        self._work.run.reported.connect(self.refresh)
        self._workspace.clone_changed.connect(self._show_clone)
        self._workspace.style_changed.connect(self.refresh)

    def generate(self) -> None:
        """Generate as the fields say; what cannot be understood stays, with the reason below."""
        try:
            where = self._work.targets(self.where.toPlainText())
        except GenerationError as error:
            self._refuse(str(error))
            return
        options = CloneOptions(
            stretch=self.stretch.value(),
            warping=self.warping.value(),
            detail_stretch=self.detail_stretch.value(),
        )
        self._work.generate(self.count.value(), self.seed.value(), where, options)

    def _refuse(self, why: str) -> None:
        self.refusal.setText(why)
        self.refusal.setVisible(bool(why))

    # ---- keeping in step -------------------------------------------------------------------------

    def refresh(self) -> None:
        """Show what runs, what can be done and the clone that is looked at."""
        running = self._work.run.is_running
        for part in self._strengths:
            part.setVisible(self._workspace.surfaces is not None)
        self.report_button.setVisible(self._workspace.state.clones is not None)
        clones = self._workspace.clones
        self.generate_button.setVisible(not running)
        self.cancel_button.setVisible(running)
        self._after.setVisible(not running and clones is not None)
        hint = ""
        if running:
            hint = self._work.run.state()
        elif not self._workspace.has_style:
            hint = tr("There is no style yet. Learn or open one first.")
        self._hint.setText(hint)
        self._hint.setVisible(bool(hint))
        self._show_clone()

    def _show_clone(self) -> None:
        clones, factors, chosen = self._workspace.clones, self._work.factors, self._workspace.clone
        self._clone.setVisible(clones is not None)
        self._facts.setVisible(clones is not None)
        self.factors.setVisible(factors is not None)
        if clones is None:
            return
        if chosen is None:
            self._clone.setText(plural(len(clones), mark("{count} clone"), mark("{count} clones")))
            self._facts.setText(f"{_describe_drawing(clones)} {tr(_LOOK)}")
        else:
            self._clone.setText(tr("Clone {number}", number=chosen))
            learner = self._workspace.style
            names = () if learner is None else learner.parents.names
            self._facts.setText(_describe_clone(clones, chosen - 1, names))
        if factors is not None:
            self._fill(factors, chosen)

    def _fill(self, factors: Population, chosen: int | None) -> None:
        """Show the factors of the chosen clone, else those in the mean, beside the parents'."""
        assessed = self._work.assessed
        shown = [factors] if assessed is None else [factors, assessed.parents]
        ours, theirs, units = [], [], []
        for name in SHOWN:
            scale, unit = readable_scale([factors], name)
            column = factors.column(name)
            value = np.nanmean(column) if chosen is None else column[chosen - 1]
            ours.append(four_digits(scale * float(value)))
            theirs.append(
                "" if assessed is None else four_digits(scale * float(np.nanmean(shown[1].column(name))))
            )
            units.append(FACTORS[name].unit(unit))
        heads = [tr("Mean") if chosen is None else tr("Clone {number}", number=chosen), tr("Parents")]
        columns = [ours, theirs]
        some = 2 if assessed is not None else 1
        self.factors.fill(heads[:some], columns[:some], units)


def _describe_drawing(clones: Generation | SurfaceGeneration) -> str:
    """Return how clones came about."""
    if isinstance(clones, SurfaceGeneration):
        if clones.reached:
            return tr("Chosen from {candidates} drawn.", candidates=clones.candidates)
        return tr("Nothing was selected: all that were drawn.")
    counts = clones.counts
    return tr(
        "Of {candidates} candidates {valid} were valid when drawn and {repaired} were repaired.",
        candidates=counts.candidates,
        valid=counts.valid,
        repaired=counts.repaired,
    )


def _describe_clone(clones: Generation | SurfaceGeneration, row: int, parents: Sequence[str]) -> str:
    """Return what one clone was made of, and what its metaball is like."""
    if not isinstance(clones, SurfaceGeneration):
        parent = int(clones.parents[row])
        drawn = (
            tr("Drawn from {parent}", parent=parents[parent])
            if 0 <= parent < len(parents)
            else tr("Not drawn from a single parent")
        )
        return tr("{drawn} · n = {n} · valid", drawn=drawn, n=clones.clones.template.n)
    clone = clones.clones[row]
    told = [tr("Made of {parent}", parent=clone.parent)]
    if clone.shaped:
        told.append(clone.shaped)
    told.append(tr("{count:,} triangles", count=len(clone.surface.faces)))
    if clone.fitted is not None:
        told.append(
            tr(
                "metaball n = {n}: {rms:.2f} % of Dₙ from the surface (rms), volume {volume:+.2f} %",
                n=clone.fitted.avatar.n,
                rms=100 * clone.fitted.rms,
                volume=100 * clone.fitted.volume_error,
            )
        )
        if not clone.fitted.valid:
            told.append(tr("metaball not valid"))
    return " · ".join(told)
