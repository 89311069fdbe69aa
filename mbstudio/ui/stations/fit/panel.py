"""Station Fit: one grain and its avatar, or all of them."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QToolButton,
    QWidget,
)

from mbstudio.core.errors import FitError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.imaging import FitGoal, FitResult
from mbstudio.core.metrics import FactorIntervals, ShapeFactors
from mbstudio.core.units import unit_label
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.fit.factors_table import FactorsTable
from mbstudio.ui.stations.fit.words import reaches_goals
from mbstudio.ui.stations.fit.work import FitWork
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.widgets.forms import NumberSlider, badge, label, primary_button, quiet_button, row, set_badge
from mbstudio.ui.widgets.options_form import OptionsForm
from mbstudio.ui.workspace import Workspace


class FitPanel(Panel):
    """Settings of the fit, its buttons, and what came of it.

    Attributes
    ----------
    opacity_changed : signal (str, float)
        Layer (grain, avatar) and opacity.
    """

    opacity_changed = Signal(str, float)

    def __init__(self, workspace: Workspace, work: FitWork, icons: Icons) -> None:
        super().__init__(
            tr("Fit"), tr("A grain becomes an avatar: the surface f\u00a0=\u00a01 of n control points.")
        )
        self._workspace, self._work, self._icons = workspace, work, icons
        self._make_head()
        self._make_settings()
        self._make_result()
        self._make_opacity()
        self.body.addStretch(1)
        self._make_foot()
        self._connect()
        self.refresh()

    def _make_head(self) -> None:
        self._name = label(tr("No grain selected"), "figure")
        self._facts = label("", "hint", wrap=True)
        self.before, self.after = QToolButton(), QToolButton()
        for button, icon, words in (
            (self.before, "ph.caret-left", tr("Previous grain")),
            (self.after, "ph.caret-right", tr("Next grain")),
        ):
            self._icons.set(button, icon)
            button.setToolTip(words)
            button.setAccessibleName(words)
        head = QHBoxLayout()
        head.addWidget(self._name, 1)
        head.addWidget(self.before)
        head.addWidget(self.after)
        self.body.addLayout(head)
        self.add(self._facts)

    def _make_settings(self) -> None:
        self.n = QSpinBox()
        self.n.setRange(1, 1000)
        self.method = QComboBox()
        self.method.addItem(tr("Fast"), "fast")
        self.method.addItem(tr("As in the paper"), "paper")
        self.seed = QSpinBox()
        self.seed.setRange(0, 2**31 - 1)
        self.target = QLineEdit()
        self.target.setPlaceholderText(tr("none, or volume 0.5 % and hausdorff 2 %"))
        self.target.setClearButtonEnabled(True)
        self.target.setAccessibleName(tr("Goal"))
        tip = tr(
            "<p>The goals that an avatar must meet with as few control points as possible: "
            "measures and limits joined by <i>and</i>. Errors of any factor (volume, area, "
            "sphericity, csf …), hausdorff and rms over D<sub>n</sub> in percent, a lower limit "
            "of iou, an upper limit of n. Leave empty to fit with n as above.</p>"
        )
        self.target.setToolTip(tip)
        self.refusal = label("", "refusal", wrap=True)
        self.refusal.hide()
        self._target_shown = ""
        self.sweep_button = quiet_button(tr("Sweep over n …"))
        self.sweep_button.setToolTip(
            tr("Fit the selected grains with several n and compare the accuracy of their avatars")
        )
        name = label(tr("Goal"), "key")
        name.setBuddy(self.target)
        name.setToolTip(tip)
        self.add_heading(tr("Avatar"))
        self.add(
            row(tr("Control points n"), self.n, tr("More points follow edges better and take longer")),
            row(
                tr("Method"),
                self.method,
                tr("Fast: Levenberg–Marquardt. As in the paper: Algorithms 1 and 2 to the letter"),
            ),
            row(tr("Seed"), self.seed, tr("The same seed gives the same avatar")),
            name,
            self.target,
            self.refusal,
            self.sweep_button,
        )
        self.options = OptionsForm()
        self.add(self.options)

    def _make_result(self) -> None:
        self._result_heading = label(tr("Result"), "heading")
        self.verdict = badge()
        line = QHBoxLayout()
        line.setContentsMargins(0, 8, 0, 0)
        line.addWidget(self._result_heading, 1)
        line.addWidget(self.verdict)
        self.body.addLayout(line)
        self._reasons = label("", "hint", wrap=True)
        self.factors = FactorsTable()
        self.intervals_button = quiet_button(tr("Intervals of the grain"))
        self.intervals_button.setToolTip(
            tr(
                "The intervals within which the factors of the grain as it is labelled lie, because its "
                "position on the voxel grid, the threshold and the blur are uncertain. What finding the "
                "grains did to it is not in. Bold errors: the avatar lies outside the interval."
            )
        )
        self.intervals_button.setEnabled(False)
        self.add(self._reasons, self.factors, self.intervals_button)

    def _make_opacity(self) -> None:
        self.grain_opacity = NumberSlider(
            tr("Grain"), 0, 1, 0.6, 0.01, "{:.0%}", tr("Opacity of the grain's surface")
        )
        self.avatar_opacity = NumberSlider(
            tr("Avatar"), 0, 1, 1.0, 0.01, "{:.0%}", tr("Opacity of the avatar's surface")
        )
        self.points = QCheckBox(tr("Control points"))
        self.points.setToolTip(
            tr("Small spheres at the control points; lower the avatar's opacity to see them")
        )
        self.add_heading(tr("Opacity"))
        self.add(self.grain_opacity, self.avatar_opacity, self.points)

    def _make_foot(self) -> None:
        self.fit_button = primary_button(tr("Fit grain"))
        self.pause_button, self.stop_button = QPushButton(tr("Pause")), QPushButton(tr("Stop and keep"))
        self.stop_button.setToolTip(tr("Stop the search and keep the avatar found so far"))
        self.more = QSpinBox()
        self.more.setRange(1, 10_000)
        self.more.setValue(30)
        self.more.setSuffix(tr(" generations"))
        self.more.setAccessibleName(tr("How many more generations"))
        self.more_button = QPushButton(tr("Go on"))
        self.more_button.setToolTip(tr("Continue the search from here, with n as set above"))
        self.all_button = QPushButton(tr("Fit all grains"))
        self._running, self._going_on = QWidget(), QWidget()
        pairs: tuple[tuple[QWidget, tuple[QWidget, ...]], ...] = (
            (self._running, (self.pause_button, self.stop_button)),
            (self._going_on, (self.more, self.more_button)),
        )
        for holder, widgets in pairs:
            layout = QHBoxLayout(holder)
            layout.setContentsMargins(0, 0, 0, 0)
            layout.setSpacing(8)
            for widget in widgets:
                layout.addWidget(widget, 1)
        self.twin_button = QPushButton(tr("Twin…"))
        self.twin_button.setToolTip(
            tr("Fit all avatars together to the grey values of the scan, and find their contacts")
        )
        for part in (self.fit_button, self._running, self._going_on, self.all_button, self.twin_button):
            self.foot.addWidget(part)

    def _connect(self) -> None:
        change = self._workspace.change_fit_settings
        self.n.valueChanged.connect(lambda value: change(n=value))
        self.n.valueChanged.connect(self._work.change_n)
        self.method.currentIndexChanged.connect(
            lambda _: change(method=self.method.currentData(), options={})
        )
        self.options.changed.connect(lambda options: change(options=options))
        self.seed.valueChanged.connect(lambda value: change(seed=value))
        self.target.editingFinished.connect(self.take_target)
        self.target.textEdited.connect(lambda _: self.refusal.hide())
        self.grain_opacity.value_changed.connect(lambda value: self.opacity_changed.emit("grain", value))
        self.avatar_opacity.value_changed.connect(lambda value: self.opacity_changed.emit("avatar", value))
        for signal in (
            self._workspace.selection_changed,
            self._workspace.grains_changed,
            self._workspace.fits_changed,
            self._workspace.settings_changed,
            self._work.changed,
        ):
            signal.connect(self.refresh)

    def take_target(self) -> bool:
        """Put the target into the project's settings; return whether it can be understood.

        What cannot be understood stays in its field, with the reason below.
        """
        text = self.target.text().strip()
        try:
            aims = str(FitGoal.parse(text)) if text else ""
        except FitError as error:
            self.refusal.setText(str(error))
            self.refusal.show()
            return False
        self.refusal.hide()
        if aims != self._workspace.state.fit_settings.target:
            self._workspace.change_fit_settings(target=aims)
        return True

    def _show_target(self, target: str) -> None:
        if target != self._target_shown:
            self._target_shown = target
            self.target.setText(target)
            self.refusal.hide()
        # The number is looked for; while a fit runs a change of n gives the target up.
        self.n.setEnabled(not target or self._work.run.is_running)

    def refresh(self) -> None:
        """Show the chosen grain, its fit, and what can be done now."""
        state, label_ = self._workspace.state, self._workspace.selected
        grains = state.grains
        for field, value in ((self.n, state.fit_settings.n), (self.seed, state.fit_settings.seed)):
            field.blockSignals(True)
            field.setValue(value)
            field.blockSignals(False)
        self.method.blockSignals(True)
        self.method.setCurrentIndex(self.method.findData(state.fit_settings.method))
        self.method.blockSignals(False)
        self.options.show_options(state.fit_settings.method, state.fit_settings.options)
        self._show_target(state.fit_settings.target)
        if grains is None:
            self._name.setText(tr("No grains yet"))
            self._facts.setText(tr("Find the grains first (station Grains)."))
        elif label_ is None:
            self._name.setText(tr("No grain selected"))
            self._facts.setText(tr("Click a grain in the view or a row of the table."))
        else:
            table = grains.table
            line = table.loc[table["label"] == label_].iloc[0]
            diameter = nominal_diameter(float(line["volume"]))
            self._name.setText(tr("Grain {label}", label=label_))
            facts = tr(
                "Dₙ {diameter:.4g} {unit} · {voxels:,} voxels",
                diameter=diameter,
                unit=unit_label(grains.unit),
                voxels=int(line["voxels"]),
            )
            if line["touches_border"]:
                facts = tr(
                    "{facts}. The edge of the scan cuts this grain, so its true shape is unknown", facts=facts
                )
            if grains.is_of_meshes:
                facts = f"{grains.name_of(label_)} · {facts}"
            self._facts.setText(facts)
        running = self._work.run.is_running
        self.fit_button.setVisible(not running)
        self.fit_button.setText(self._work.words_of_fit())
        self._running.setVisible(running)
        self.pause_button.setText(tr("Resume") if self._work.run.is_paused else tr("Pause"))
        self._going_on.setVisible(self._work.can_go_on(label_))
        left = len(self._work.unfitted())
        self.all_button.setText(
            plural(
                left,
                mark("Fit the {count} grain without an avatar"),
                mark("Fit all {count} grains without an avatar"),
            )
            if left
            else tr("Fit all grains")
        )
        self._show_result(state.fits.get(label_) if label_ is not None else None)

    def _show_result(self, fit: FitResult | None) -> None:
        if fit is None:
            running = self._work.run.is_running and self._work.running_label == self._workspace.selected
            set_badge(self.verdict, tr("being fitted") if running else tr("not fitted"), "quiet")
            self._reasons.hide()
            return
        verdict = fit.verdict
        set_badge(
            self.verdict,
            tr("valid") if verdict.valid else tr("not valid"),
            "good" if verdict.valid else "bad",
        )
        unit = unit_label(fit.avatar.unit)
        text = tr(
            "RMS distance {distance:.3g} {unit} · n = {n} · {generations} generations",
            distance=verdict.rms,
            unit=unit,
            n=fit.avatar.n,
            generations=len(fit.history) - 1,
        )
        if verdict.smallest_neck is not None:
            neck = tr("smallest neck {width:.3g} {unit}", width=verdict.smallest_neck, unit=unit)
            text += f" · {neck}"
        if fit.target:
            aims = FitGoal.parse(fit.target)
            met = tr("Goal reached") if reaches_goals(fit) else tr("Goal not reached")
            text += f"\n{met}: {aims.describe(fit.reached)}" if fit.reached else f"\n{met}"
        self._reasons.setText("\n".join((*verdict.reasons, *verdict.warnings, text)))
        self._reasons.show()

    def show_factors(self, grain: ShapeFactors | None, avatar: ShapeFactors | None) -> None:
        """Fill the table of factors."""
        self.factors.show_factors(grain, avatar)
        self._show_intervals_button()

    def show_intervals(self, label: int, intervals: FactorIntervals | None) -> None:
        """Show the intervals of this grain if it is still the one looked at; None: its factors again."""
        if label == self._workspace.selected:
            self.factors.show_intervals(intervals)
            self._show_intervals_button()

    def _show_intervals_button(self) -> None:
        grains = self._workspace.state.grains
        exact = grains is not None and self._workspace.selected in grains.meshes
        self.intervals_button.setVisible(not exact)
        on = self.factors.has_intervals
        self.intervals_button.setText(tr("Factors of the grain") if on else tr("Intervals of the grain"))
