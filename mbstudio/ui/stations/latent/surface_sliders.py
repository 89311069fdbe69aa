"""Sliders for grains shaped from surfaces: size, form, edges, roughness; blending, warps, keeping."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QCheckBox, QComboBox, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from mbstudio.core.cloning.surface_studio import GrainShape, SurfaceStudio
from mbstudio.core.units import unit_label
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.latent.factor_titles import TITLES, decimals_of
from mbstudio.ui.stations.latent.surface_work import Change, SurfaceWork
from mbstudio.ui.widgets.forms import badge, label, primary_button, row, set_badge
from mbstudio.ui.widgets.value_slider import ValueSlider

_TIPS = {
    "size": mark("Diameter of the ball of equal volume. Keeps the shape."),
    "elongation": mark("By the ellipsoid of equal inertia, exact. Keeps size and S / I."),
    "flatness": mark("By the ellipsoid of equal inertia, exact. Keeps size and I / L."),
    "csf": mark("By the ellipsoid of equal inertia, exact. Elongation and flatness change in proportion."),
    "sphericity": mark("By the coarse form: towards an ellipsoid, or away from it. Keeps size and axes."),
    "convexity": mark(
        "Volume over that of the convex hull. By edges, faces and hollows: duller, or sharper."
    ),
    "roughness": mark(
        "Height of what is finer than a twelfth of the way round (rms, over Dₙ). Keeps all else."
    ),
}
_FORM = ("elongation", "flatness", "csf")
_FEW_NAMES = 5


class SurfaceSliders(QWidget):
    """What is asked of a grain shaped from surfaces.

    Attributes
    ----------
    foot : QWidget
        What is done with the grain, for the panel's foot.
    """

    def __init__(self, work: SurfaceWork, icons: Icons) -> None:
        super().__init__()
        self._work = work
        self._seed = 0
        self._about = label("", "hint", wrap=True)
        self.parent_choice, self.other = QComboBox(), QComboBox()
        self.factors = {name: ValueSlider(tr(TITLES[name]), icons, tr(tip)) for name, tip in _TIPS.items()}
        self.share = ValueSlider(
            tr("From the one to the other"), icons, tr("0 is the first parent, 1 the second"), lock=False
        )
        self.share.set_range(0.0, 1.0, 0.5, decimals=2)
        self.noise = ValueSlider(
            tr("Warp"), icons, tr("0 changes nothing; 1 is as grains of this kind differ"), lock=False
        )
        self.noise.set_range(0.0, 1.0, 0.2, decimals=2)
        self.another, self.randomise = QPushButton(tr("New warp")), QPushButton(tr("Randomise"))
        self.another.setToolTip(tr("Draw another warp of the same strength"))
        self.randomise.setToolTip(tr("Draw a clone at random: another parent, form, size and warp"))
        self.shows_metaball = QCheckBox(tr("Show the metaball at rest"))
        self.shows_metaball.setToolTip(
            tr("Shows the metaball that is fitted to the grain in its place, as soon as no slider moves")
        )
        self.ball = label("", "hint", wrap=True)
        self._lay_out()
        self._make_foot()
        self._connect()
        self.take_style()

    # ---- making it -------------------------------------------------------------------------------

    def _lay_out(self) -> None:
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(9)
        layout.addWidget(self._about)
        layout.addWidget(row(tr("Parent"), self.parent_choice, tr("Begin with this parent")))
        layout.addWidget(label(tr("Size and shape"), "heading"))
        for slider in self.factors.values():
            layout.addWidget(slider)
        layout.addSpacing(6)
        layout.addWidget(label(tr("Blend with another parent"), "heading"))
        layout.addWidget(row(tr("Other parent"), self.other, tr("Its surface is laid onto the first one's")))
        layout.addWidget(self.share)
        layout.addSpacing(6)
        layout.addWidget(label(tr("Random variation"), "heading"))
        layout.addWidget(self.noise)
        line = QHBoxLayout()
        line.addWidget(self.another)
        line.addWidget(self.randomise)
        line.addStretch(1)
        layout.addLayout(line)
        layout.addSpacing(6)
        layout.addWidget(label(tr("Metaball"), "heading"))
        layout.addWidget(self.ball)
        layout.addWidget(self.shows_metaball)

    def _make_foot(self) -> None:
        self.foot = QWidget()
        layout = QVBoxLayout(self.foot)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(8)
        self.light = badge()
        self._way = label("", "hint", wrap=True)
        self.undo, self.redo, self.reset = (
            QPushButton(text) for text in (tr("Undo"), tr("Redo"), tr("Reset"))
        )
        self.undo.setToolTip(tr("Undo the last step (Ctrl+Z)"))
        self.redo.setToolTip(tr("Redo the step (Ctrl+Shift+Z)"))
        self.reset.setToolTip(tr("Return to the parent as it is"))
        self.keep = primary_button(tr("Keep among the clones"))
        self.keep.setToolTip(tr("Add the grain to the clones, measured and with its metaball"))
        line = QHBoxLayout()
        for button in (self.undo, self.redo, self.reset):
            line.addWidget(button)
        lights = QHBoxLayout()
        lights.addWidget(self.light)
        lights.addStretch(1)
        layout.addLayout(lights)
        layout.addWidget(self._way)
        layout.addLayout(line)
        layout.addWidget(self.keep)

    def _connect(self) -> None:
        work = self._work
        for name, slider in self.factors.items():
            slider.moved.connect(lambda to, name=name: work.reach(name, to, final=False))
            slider.settled.connect(lambda to, name=name: work.reach(name, to, final=True))
            slider.lock_changed.connect(lambda locked, name=name: work.lock(name, locked))
            slider.lock.setToolTip(
                tr("Lock: “{title}” stays while other factors are asked for", title=slider.title)
            )
        self.parent_choice.activated.connect(work.begin_with)
        self.other.activated.connect(lambda place: work.blend_with(place - 1 if place else None))
        self.share.moved.connect(lambda share: work.preview(self._blend(share)))
        self.share.settled.connect(
            lambda share: work.commit(self._blend(share), tr("{percent:.0f} % blended", percent=100 * share))
        )
        self.noise.moved.connect(lambda strength: work.preview(self._warp(strength)))
        self.noise.settled.connect(self._settle_warp)
        work.locks_changed.connect(self._show_locks)
        work.style_taken.connect(self.take_style)
        work.stepped.connect(self._show_step)
        work.grain_changed.connect(self._show_grain)
        work.fitted_changed.connect(self._show_ball)

    # ---- moves -----------------------------------------------------------------------------------

    def _blend(self, share: float) -> Change:
        step = self._work.step
        other = None if step is None else step.shape.other
        return lambda studio, shape: studio.blended(shape, other, share)

    def _warp(self, strength: float) -> Change:
        seed = self._seed

        def change(studio: SurfaceStudio, shape: GrainShape) -> tuple[GrainShape, bool]:
            return studio.warped(shape, strength, seed)

        return change

    def _settle_warp(self, strength: float) -> None:
        words = tr("warp {strength:.2f} (seed {seed})", strength=strength, seed=self._seed)
        self._work.commit(self._warp(strength), words)

    def draw_another(self) -> None:
        """Show the grain with another warp of the same strength."""
        self._seed += 1
        if self.noise.value <= 0.0:
            self.noise.set_value(0.2)
        self._settle_warp(self.noise.value)

    def draw_at_random(self) -> None:
        """Show a clone drawn at random."""
        self._seed += 1
        seed = self._seed
        self._work.draw(seed, tr("drawn (seed {seed})", seed=seed))

    # ---- keeping in step -------------------------------------------------------------------------

    def take_style(self) -> None:
        """Show the sliders of another style, or that its parents are being measured."""
        style = self._work.style
        ready = style is not None
        for part in (*self.factors.values(), self.noise, self.another, self.randomise, self.keep):
            part.setEnabled(ready)
        if style is None:
            self._about.setText(tr("Measuring the parents …"))
            return
        names = [parent.name for parent in style.parents]
        self._about.setText(tr("{count} parents, kept as surfaces.", count=len(names)))
        for field, entries in ((self.parent_choice, names), (self.other, [tr("none"), *names])):
            with QSignalBlocker(field):
                field.clear()
                field.addItems(entries)
        for name, (low, middle, high) in self._work.ranges.items():
            self.factors[name].set_range(low, high, middle, decimals=decimals_of(name, middle), beyond=0.5)
        self.factors["size"].box.setSuffix(f" {unit_label(style.unit)}")
        self._show_step()

    def _show_locks(self) -> None:
        """Let nobody move the third of three factors of form of which two are held."""
        held = self._work.locked & set(_FORM)
        for name in _FORM:
            self.factors[name].slider.setEnabled(name in held or len(held) < 2)
            self.factors[name].box.setEnabled(name in held or len(held) < 2)

    def _show_step(self) -> None:
        step = self._work.step
        if step is None:
            return
        shape = step.shape
        for field, place in (
            (self.parent_choice, shape.parent), (self.other, 0 if shape.other is None else shape.other + 1)
        ):  # fmt: skip
            with QSignalBlocker(field):
                field.setCurrentIndex(place)
        self.share.setEnabled(shape.other is not None)
        self.share.set_value(shape.share)
        words = self._work.words
        shown = (
            words
            if len(words) <= _FEW_NAMES
            else [words[0], tr("… {count} steps …", count=len(words) - 4), *words[-3:]]
        )
        self._way.setText(" → ".join(shown))

    def _show_grain(self) -> None:
        grain = self._work.grain
        if grain is None:
            return
        for name, slider in self.factors.items():
            if name in grain.values:
                slider.set_value(grain.values[name])
        if not grain.is_sound:
            set_badge(self.light, tr("● Folds over"), "bad")
            self.light.setToolTip(tr("Parts of the surface have turned over: undo, or ask for less"))
        elif self._work.is_held:
            set_badge(self.light, tr("▲ As near as this grain allows"), "amber")
            self.light.setToolTip(tr("The surface would fold, or cannot go further"))
        else:
            set_badge(self.light, tr("● No folds"), "good")
            self.light.setToolTip(tr("The surface is closed, and nothing of it has turned over"))

    def _show_ball(self) -> None:
        fitted = self._work.fitted
        if fitted is None:
            self.ball.setText(tr("It is fitted as soon as no slider moves."))
            return
        self.ball.setText(
            tr(
                "n = {n}, {rms:.2f} % of Dₙ from the surface (rms), volume {volume:+.2f} %{valid}",
                n=fitted.avatar.n,
                rms=100 * fitted.rms,
                volume=100 * fitted.volume_error,
                valid="" if fitted.valid else tr(" · not valid"),
            )
        )
