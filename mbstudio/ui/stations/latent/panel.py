"""Station Latent: grains shaped by hand with sliders for what they mean, then for what they are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PySide6.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.metrics.factor_table import LATENT_MEANINGS
from mbstudio.core.units import unit_label
from mbstudio.core.vae.shaping.latent_recipe import Operation
from mbstudio.core.vae.shaping.meaning import HELD
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.latent.factor_radar import describe_rank, show_lights
from mbstudio.ui.stations.latent.surface_sliders import SurfaceSliders
from mbstudio.ui.stations.latent.surface_work import SurfaceWork
from mbstudio.ui.stations.latent.work import LatentWork
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.widgets.factor_words import latent_count
from mbstudio.ui.widgets.forms import badge, label, primary_button, quiet_button
from mbstudio.ui.widgets.value_slider import ValueSlider

_FIRST, _MORE = 8, 12
"""Sliders of components that are there at first, and that each “more” adds."""
_MOST_NOISE = 1.0
_BEYOND = 2.0
"""Times as far as the parents reach go the sliders where that is allowed."""
_WRITTEN = 1.0
"""Share of a slider's range by which a value written in its box may lie beyond it."""
_NOT_LEARNED = mark("The meanings have not been learned. Leave the station and come back to learn them.")


class LatentPanel(Panel):
    """Sliders, noise and what is done with the grain."""

    def __init__(self, work: LatentWork, surface_work: SurfaceWork, icons: Icons) -> None:
        super().__init__(tr("Latent studio"), tr("The surface follows the slider."))
        self._work, self._surface_work, self._icons = work, surface_work, icons
        self._seed = 0
        self._no_style()
        self._make_meanings()
        self._make_noise()
        self._make_components()
        self._make_foot()
        self.surfaces = SurfaceSliders(surface_work, icons)
        self.add(self.surfaces)
        self.foot.addWidget(self.surfaces.foot)
        self.body.addStretch(1)
        self._connect()
        self.take_style()

    # ---- making it -------------------------------------------------------------------------------

    def _no_style(self) -> None:
        self._missing = QWidget()
        layout = QVBoxLayout(self._missing)
        layout.setContentsMargins(0, 6, 0, 0)
        layout.setSpacing(10)
        layout.addWidget(
            label(
                tr(
                    "There is no style-learner yet. It is learned from at least five avatars of the same "
                    "kind of grain and describes how such grains differ. Here each of its latent "
                    "variables gets a slider."
                ),
                "hint",
                wrap=True,
            )
        )
        self.open_button = primary_button(tr("Open a style-learner…"))
        self.open_button.setToolTip(tr("The folder that “mbstudio learn” or station Style wrote"))
        self.style_button = QPushButton(tr("Learn one"))
        self.style_button.setToolTip(tr("Go to the station where styles are learned"))
        layout.addWidget(self.open_button)
        layout.addWidget(self.style_button)
        self.add(self._missing)
        self._about = label("", "hint", wrap=True)
        self.add(self._about)

    def _make_meanings(self) -> None:
        self._shaping = QWidget()
        self._inner = QVBoxLayout(self._shaping)
        self._inner.setContentsMargins(0, 0, 0, 0)
        self._inner.setSpacing(9)
        self._inner.addWidget(label(tr("Size and shape"), "heading"))
        self._learning = label("", "hint", wrap=True)
        self._inner.addWidget(self._learning)
        self.meanings: dict[str, ValueSlider] = {}
        for name in MEANINGS:
            held = ", ".join(tr(LATENT_MEANINGS[other].plain) for other in HELD[name])
            slider = ValueSlider(
                tr(LATENT_MEANINGS[name].title), self._icons, tr("Keeps constant: {factors}.", factors=held)
            )
            self.meanings[name] = slider
            self._inner.addWidget(slider)
        self.add(self._shaping)

    def _make_noise(self) -> None:
        self._inner.addSpacing(6)
        self._inner.addWidget(label(tr("Random variation"), "heading"))
        self.noise = ValueSlider(
            tr("Noise σ"),
            self._icons,
            tr("0 changes nothing; 1 deviates as much as another parent does"),
            lock=False,
        )
        self.noise.set_range(0.0, _MOST_NOISE, 0.0, decimals=2)
        self.another, self.randomise = QPushButton(tr("New noise")), QPushButton(tr("Randomise"))
        self.another.setToolTip(tr("Draw new noise of the same strength"))
        self.randomise.setToolTip(tr("Draw a new grain in the style of the parents; locked values stay"))
        line = QHBoxLayout()
        line.addWidget(self.another)
        line.addWidget(self.randomise)
        line.addStretch(1)
        self._inner.addWidget(self.noise)
        self._inner.addLayout(line)

    def _make_components(self) -> None:
        self._inner.addSpacing(6)
        self._inner.addWidget(label(tr("Latent variables, strongest first"), "heading"))
        self.components: dict[int, ValueSlider] = {}
        self._component_box = QVBoxLayout()
        self._component_box.setSpacing(9)
        self._inner.addLayout(self._component_box)
        self.more = quiet_button(tr("More latent variables"))
        self._inner.addWidget(self.more)
        self.beyond = QCheckBox(tr("Allow grains far outside the parents"))
        self.beyond.setToolTip(
            tr(
                "If this is off, grains are held at the edge of the parents' range, and held values "
                "turn amber"
            )
        )
        self._inner.addWidget(self.beyond)

    def _make_foot(self) -> None:
        self.undo, self.redo, self.reset = (
            QPushButton(text) for text in (tr("Undo"), tr("Redo"), tr("Reset"))
        )
        self.keep = primary_button(tr("Keep"))
        self.alike, self.count = QPushButton(tr("More like this")), QSpinBox()
        self.undo.setToolTip(tr("Undo the last step (Ctrl+Z)"))
        self.redo.setToolTip(tr("Redo the step (Ctrl+Shift+Z)"))
        self.reset.setToolTip(tr("Return to the grain before it was shaped"))
        self.keep.setToolTip(tr("Keep the grain on the shelf, with its recipe"))
        self.alike.setToolTip(tr("Keep variations of this grain, with the noise σ set above"))
        self.count.setRange(1, 100)
        self.count.setValue(6)
        self.count.setFixedWidth(64)
        self.count.setAccessibleName(tr("Number of variations"))
        first, second = QHBoxLayout(), QHBoxLayout()
        for button in (self.undo, self.redo, self.reset):
            first.addWidget(button)
        second.addWidget(self.keep, 1)
        second.addWidget(self.alike)
        second.addWidget(self.count)
        self._way: QLabel = label("", "hint", wrap=True)
        self.light, self.edge = badge(), badge()
        lights = QHBoxLayout()
        lights.addWidget(self.light)
        lights.addWidget(self.edge)
        lights.addStretch(1)
        self._foot_of_learner = QWidget()
        layout = QVBoxLayout(self._foot_of_learner)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(8)
        layout.addLayout(lights)
        layout.addWidget(self._way)
        layout.addLayout(first)
        layout.addLayout(second)
        self.foot.addWidget(self._foot_of_learner)

    def _connect(self) -> None:
        work = self._work
        for name, slider in self.meanings.items():
            slider.moved.connect(lambda to, name=name: work.preview(_reach(name, to)))
            slider.settled.connect(lambda to, name=name: work.commit(_reach(name, to)))
            slider.lock_changed.connect(
                lambda on, name=name: (work.locked_meanings.add if on else work.locked_meanings.discard)(name)
            )
        self.noise.moved.connect(lambda sigma: work.preview(self._noise(sigma), instead=True))
        self.noise.settled.connect(lambda sigma: work.commit(self._noise(sigma), instead=True))
        self.beyond.toggled.connect(self._allow)
        self.more.clicked.connect(lambda: self._add_components(_MORE))
        work.style_taken.connect(self.take_style)
        self._surface_work.style_taken.connect(self.take_style)
        work.meanings_changed.connect(self._show_meanings)
        work.grain_changed.connect(self._show_grain)
        work.stepped.connect(self._show_steps)

    # ---- chance ----------------------------------------------------------------------------------

    def _noise(self, sigma: float) -> Operation:
        given = {"sigma": sigma, "seed": self._seed, **self._work.locks()}
        return Operation(
            "noise", given, tr("noise σ {sigma:.2f} (seed {seed})", sigma=sigma, seed=self._seed)
        )

    def _allow(self, on: bool) -> None:
        self._work.beyond = on
        self._set_ranges()

    def draw_another(self) -> None:
        """Show the grain with other noise of the same strength."""
        self._seed += 1
        if self.noise.value <= 0.0:
            self.noise.set_value(0.3)
        self._work.commit(self._noise(self.noise.value), instead=True)

    def draw_at_random(self) -> None:
        """Show a new grain in the style of the parents."""
        self._seed += 1
        given = {"seed": self._seed, **self._work.locks()}
        self._work.commit(Operation("random", given, tr("drawn (seed {seed})", seed=self._seed)))

    def keep_alike(self) -> None:
        """Keep variations of the grain, with the noise that is set."""
        sigma = self.noise.value or 0.3
        self._work.keep_variations(sigma, self.count.value(), self._seed + 1)
        self._seed += self.count.value()

    # ---- keeping in step -------------------------------------------------------------------------

    def take_style(self) -> None:
        """Show the sliders of another style-learner, or that there is none."""
        learner, work = self._work.learner, self._work
        self.light.setVisible(learner is not None)
        self.edge.hide()
        of_surfaces = self._surface_work.style is not None or self._surface_work.is_opening
        self.surfaces.setVisible(of_surfaces)
        self.surfaces.foot.setVisible(of_surfaces)
        self._foot_of_learner.setVisible(not of_surfaces)
        self._missing.setVisible(learner is None and not work.is_opening and not of_surfaces)
        self._about.setVisible(learner is not None or work.is_opening)
        self._about.setText(tr("Measuring the parents …"))
        self._shaping.setVisible(learner is not None)
        for slider in self.components.values():
            slider.hide()
            slider.deleteLater()
        self.components.clear()
        self.noise.set_value(0.0)
        for slider in self.meanings.values():
            slider.lock.setChecked(False)
        if learner is not None:
            self._about.setText(
                tr(
                    "{parents} parents, preset “{preset}”, {dimension} latent variables. "
                    "Double-click a grain below to begin with it.",
                    parents=len(learner.parents),
                    preset=learner.preset,
                    dimension=latent_count(learner.core, learner.dimension),
                )
            )
            assert work.about is not None
            self._order = [int(k) for k in np.argsort(-work.about.effects) if work.about.reach[k] > 1e-9]
            self._add_components(_FIRST)
        self._show_meanings()
        self._show_steps()

    def _add_components(self, count: int) -> None:
        about, stance = self._work.about, self._work.stance
        assert about is not None
        assert stance is not None
        for k in self._order[len(self.components) : len(self.components) + count]:
            slider = ValueSlider(
                f"z{k + 1}",
                self._icons,
                tr("Its effect: how much of the radius one deviation changes (rms)."),
            )
            self.components[k] = slider
            self._set_range(k)
            slider.set_value(float(stance.latent[k]), self._effect(k))
            slider.moved.connect(lambda to, k=k: self._work.preview(_component(k, to)))
            slider.settled.connect(lambda to, k=k: self._work.commit(_component(k, to)))
            slider.lock_changed.connect(lambda on, k=k: self._lock(k, on))
            self._component_box.addWidget(slider)
        self.more.setVisible(len(self.components) < len(self._order))

    def _set_range(self, k: int) -> None:
        about = self._work.about
        assert about is not None
        reach = about.reach[k] * (_BEYOND if self.beyond.isChecked() else 1.0)
        mean = about.mean[k]
        self.components[k].set_range(mean - reach, mean + reach, mean, beyond=_WRITTEN)

    def _set_ranges(self) -> None:
        """Give the sliders their ranges anew, and their values in them."""
        for k in self.components:
            self._set_range(k)
        self._show_meanings()
        self._show_grain()

    def _effect(self, k: int) -> str:
        about = self._work.about
        return "" if about is None else tr("effect {percent:.2g} %", percent=100 * about.effects[k])

    def _lock(self, k: int, on: bool) -> None:
        locked = self._work.locked_components
        (locked.add if on else locked.discard)(k)

    def _show_meanings(self) -> None:
        work = self._work
        known = work.meanings
        for slider in self.meanings.values():
            slider.setEnabled(known is not None)
        self._learning.setVisible(work.learner is not None and known is None)
        # Half a second: the status bar has its progress.
        self._learning.setText(
            tr("Learning what the latents mean …") if work.is_learning else tr(_NOT_LEARNED)
        )
        if known is None:
            return
        for row, (name, slider) in enumerate(self.meanings.items()):
            low, high = work.deviations_of(name)
            if self.beyond.isChecked():
                middle, half = 0.5 * (low + high), 0.5 * _BEYOND * (high - low)
                low, high = middle - half, middle + half
            scale = _Scale(float(known.mean[row]), float(known.deviation[row]), name == "size")
            decimals = 1 if name == "size" and scale.read(0.0) > 20 else 3
            slider.set_range(
                low, high, 0.0, read=scale.read, write=scale.write, decimals=decimals, beyond=_WRITTEN
            )
        assert work.learner is not None
        self.meanings["size"].box.setSuffix(f" {unit_label(work.learner.unit)}")
        self._show_grain()

    def _show_grain(self) -> None:
        work = self._work
        grain, about, known = work.grain, work.about, work.meanings
        if grain is None or about is None:
            return
        show_lights(self.light, self.edge, grain, work.is_held, work.is_beyond)
        outside = work.is_held or work.is_beyond
        shares = about.share_below(grain.factors)
        if known is not None:
            units = known.units(grain.factors)
            for row, (name, slider) in enumerate(self.meanings.items()):
                slider.set_amber(outside and not 0.0 < shares[row] < 1.0)
                slider.set_value(float(units[row]), describe_rank(name, float(shares[row])))
        for k, slider in self.components.items():
            slider.set_value(float(grain.latent[k]), self._effect(k))
            slider.set_amber(outside and abs(grain.latent[k] - about.mean[k]) > 0.999 * about.reach[k])

    def _show_steps(self) -> None:
        stance = self._work.stance
        self.count.setEnabled(stance is not None)
        last = stance.operations[-1] if stance is not None else None
        strays = last is not None and last.kind == "noise"
        self.noise.set_value(float(last.given["sigma"]) if last is not None and strays else 0.0)
        words = [operation.words for operation in stance.operations] if stance is not None else []
        shown = (
            words
            if len(words) <= 4
            else [words[0], tr("… {count} steps …", count=len(words) - 3), *words[-2:]]
        )
        self._way.setText(" → ".join(shown))
        self._way.setVisible(bool(words))


@dataclass(frozen=True)
class _Scale:
    """Between standard deviations about the parents' mean and what people read."""

    mean: float
    deviation: float
    is_log: bool

    def read(self, units: float) -> float:
        value = self.mean + units * self.deviation
        return float(np.exp(value)) if self.is_log else value

    def write(self, value: float) -> float:
        return float(((np.log(max(value, 1e-300)) if self.is_log else value) - self.mean) / self.deviation)


def _reach(name: str, to: float) -> Operation:
    return Operation(
        "reach",
        {"meaning": name, "to": to},
        tr("{factor} {deviations:+.2f} s.d.", factor=tr(LATENT_MEANINGS[name].title), deviations=to),
    )


def _component(k: int, to: float) -> Operation:
    return Operation("component", {"component": k, "to": to}, f"z{k + 1} = {to:.3g}")
