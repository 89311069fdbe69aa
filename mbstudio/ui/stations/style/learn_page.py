"""The page on which a style is learned: parents, how, and the card of what was learned."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLineEdit, QPushButton, QSpinBox, QVBoxLayout, QWidget

from mbstudio.core.cloning.parent_choice import ENOUGH_PARENTS
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.units import unit_label
from mbstudio.core.vae.models.presets import PRESETS, find_preset, recommended_preset
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.style.parents import Parents, Source
from mbstudio.ui.stations.style.surface_learning import SURFACES
from mbstudio.ui.stations.style.work import LearnRequest, StyleWork, percent
from mbstudio.ui.widgets.factor_words import latent_count
from mbstudio.ui.widgets.forms import label, primary_button, quiet_button, row
from mbstudio.ui.workspace import Workspace

FEWEST = 5
_SURFACES_TITLE = mark("Surfaces")
_SURFACES_SUMMARY = mark(
    "Keeps the surfaces themselves: clones have the faces, edges and roughness of their parents, in other "
    "forms, and each has a metaball. Of all presets its clones are the hardest to tell from true grains."
)
_SOURCES = {
    "inside": mark("Grains inside"),
    "chosen": mark("Chosen grains"),
    "avatars": mark("Avatars"),
    "folder": mark("Folder of meshes"),
}
_LEAST_N = 9
"""Of metaballs fitted to surfaces; the value itself stands for as many as the parents need."""
_UNITS = ("mm", "um", "cm", "m")
_WIDE = 190


class LearnPage(QWidget):
    """Asks for parents and how to learn from them; shows the style-learner's card.

    Attributes
    ----------
    folder_asked : signal
    readiness_changed : signal
    is_ready : bool
        Whether there are parents enough to learn from.
    has_new_parents : bool
        Whether there are some that the style-learner does not know yet.
    foot : QWidget
        The buttons, for the panel's foot.
    """

    folder_asked = Signal()
    readiness_changed = Signal()

    def __init__(self, workspace: Workspace, work: StyleWork) -> None:
        super().__init__()
        self._workspace, self._work = workspace, work
        self.is_ready = self.has_new_parents = False
        self.source, self.preset, self.unit = QComboBox(), QComboBox(), QComboBox()
        for name in get_args(Source):
            self.source.addItem(tr(_SOURCES[name]), name)
        for preset in map(find_preset, PRESETS):
            self.preset.addItem(tr(preset.title), preset.name)
            self.preset.setItemData(self.preset.count() - 1, tr(preset.summary), 3)
        self.preset.insertItem(0, tr(_SURFACES_TITLE), SURFACES)
        self.preset.setItemData(0, tr(_SURFACES_SUMMARY), 3)
        self.preset.setCurrentIndex(0)
        for unit in _UNITS:
            self.unit.addItem(unit_label(unit), unit)
        self.n, self.steps, self.seed = QSpinBox(), QSpinBox(), QSpinBox()
        self.most = QSpinBox()
        self.most.setRange(FEWEST, 1_000_000)
        self.most.setValue(ENOUGH_PARENTS)
        self.metaball_n = QSpinBox()
        self.metaball_n.setRange(_LEAST_N, 400)
        self.metaball_n.setSpecialValueText(tr("by form"))
        self.n.setRange(4, 400)
        self.n.setValue(40)
        self.steps.setRange(0, 1_000_000)
        self.steps.setSingleStep(500)
        self.steps.setSpecialValueText(tr("default"))
        self.seed.setRange(0, 2**31 - 1)
        self.folder = QLineEdit()
        self.folder.setPlaceholderText(tr("Folder of STL, PLY, OBJ or OFF files"))
        self.folder.setAccessibleName(tr("Folder of meshes"))
        browse = QPushButton(tr("Browse…"))
        browse.clicked.connect(self.folder_asked)
        self._folder_rows = QWidget()
        self._explained = label("", "hint", wrap=True)
        self._advice = label("", "hint", wrap=True)
        self.take_pca = quiet_button(tr("Use principal components"))
        self.card = label("", "hint", wrap=True)
        self.card_name = label("", "key", wrap=True)
        self.open_button, self.save_button = QPushButton(tr("Open…")), QPushButton(tr("Save…"))
        self.open_button.setToolTip(tr("Open the folder of a style, as written by “mbstudio learn”"))
        self.save_button.setToolTip(tr("Write the style into a folder, for “mbstudio generate” too"))
        self._lay_out(browse)
        self._make_foot()
        self._connect()
        self.refresh()

    def _lay_out(self, browse: QPushButton) -> None:
        line = QHBoxLayout()
        line.addWidget(self.folder, 1)
        line.addWidget(browse)
        rows = QVBoxLayout(self._folder_rows)
        rows.setContentsMargins(0, 0, 0, 0)
        rows.addLayout(line)
        rows.addWidget(row(tr("Unit of the meshes"), self.unit, tr("Unit of the numbers in the files")))
        buttons = QHBoxLayout()
        buttons.addWidget(self.open_button)
        buttons.addWidget(self.save_button)
        buttons.addStretch(1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(10)
        self._n_row = row(
            tr("Control points n"),
            self.n,
            tr("Number of control points of every parent's avatar and of every clone"),
        )
        self._metaball_row = row(
            tr("Control points n"),
            self.metaball_n,
            tr("Of the metaball of every parent and clone; by form: 40 where these are enough, else 120"),
        )
        self._most_row = row(
            tr("Parents at most"),
            self.most,
            tr(
                "Of more grains, so many are taken, spread evenly over their sizes; chosen ones are all taken"
            ),
        )
        self._steps_row = row(
            tr("Steps"),
            self.steps,
            tr("Steps of the training; default: 4000, or 2000 with fewer than 100 parents (aligned)"),
        )
        for part in (
            row(tr("Parents"), self.source, tr("The bodies whose shape and size are learned")),
            self._folder_rows,
            row(tr("Preset"), self.preset, tr("Kind of style-learner")),
            self._explained,
            self._advice,
            self.take_pca,
            self._most_row,
            self._n_row,
            self._metaball_row,
            self._steps_row,
            row(tr("Seed"), self.seed, tr("The same seed gives the same style-learner")),
        ):
            layout.addWidget(part)
        for field in (self.source, self.preset):
            field.setFixedWidth(_WIDE)
        layout.addSpacing(8)
        layout.addWidget(label(tr("Style"), "heading"))
        layout.addWidget(self.card_name)
        layout.addWidget(self.card)
        layout.addLayout(buttons)
        layout.addStretch(1)

    def _make_foot(self) -> None:
        self.foot = QWidget()
        layout = QVBoxLayout(self.foot)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(8)
        self.hint = label("", "hint", wrap=True)
        self.learn_button = primary_button(tr("Learn"))
        self.on_button = QPushButton(tr("Continue learning"))
        self.on_button.setToolTip(tr("Teach the style-learner new grains without forgetting the old ones"))
        self.pause_button, self.stop_button = QPushButton(tr("Pause")), QPushButton(tr("Stop and keep"))
        self.cancel_button = QPushButton(tr("Cancel"))
        self.stop_button.setToolTip(tr("Stop the training and keep its best state"))
        self.cancel_button.setToolTip(tr("Cancel and keep the current style-learner"))
        self._running = QWidget()
        line = QHBoxLayout(self._running)
        line.setContentsMargins(0, 0, 0, 0)
        line.setSpacing(8)
        for button in (self.pause_button, self.stop_button, self.cancel_button):
            line.addWidget(button, 1)
        for part in (self.hint, self.learn_button, self.on_button, self._running):
            layout.addWidget(part)

    def _connect(self) -> None:
        self.take_pca.clicked.connect(self._choose_recommended)
        for field in (self.source, self.preset, self.unit):
            field.currentIndexChanged.connect(lambda _: self.refresh())
        self.folder.textChanged.connect(lambda _: self.refresh())
        self.most.valueChanged.connect(lambda _: self.refresh())
        space = self._workspace
        for signal in (
            space.grains_changed, space.fits_changed, space.selection_changed, space.style_changed,
            self._work.changed, self._work.run.reported,
        ):  # fmt: skip
            signal.connect(self.refresh)

    # ---- what was chosen -------------------------------------------------------------------------

    @property
    def parents(self) -> Parents:
        """The bodies that the fields mean."""
        source: Source = self.source.currentData()
        if source != "folder":
            return Parents(source, self._limited(source, self._work.labels(source)))
        text = self.folder.text().strip()
        return Parents("folder", (), Path(text).expanduser() if text else None, self.unit.currentData())

    def _limited(self, source: Source, labels: tuple[int, ...]) -> tuple[int, ...]:
        """Return as many grains as a style of surfaces is to be learned from; other presets take all."""
        if self.preset.currentData() != SURFACES or source == "chosen":
            return labels
        return self._work.spread(labels, self.most.value())

    @property
    def asked(self) -> LearnRequest:
        """What the fields ask for."""
        return LearnRequest(
            self.parents, self._asked_n, self.preset.currentData(), self.steps.value() or None,
            self.seed.value(),
        )  # fmt: skip

    @property
    def _asked_n(self) -> int | None:
        if self.preset.currentData() != SURFACES:
            return self.n.value()
        return self.metaball_n.value() if self.metaball_n.value() > _LEAST_N else None

    def learn(self) -> None:
        """Learn as the fields say."""
        self._work.learn(self.asked)

    def learn_on(self) -> None:
        """Teach the style-learner what it does not know yet."""
        given = self.parents
        labels = self._work.new_labels(given.source)
        new = (
            given if given.source == "folder" else Parents(given.source, self._limited(given.source, labels))
        )
        self._work.learn_on(new, self.seed.value())

    def choose_source(self, source: Source) -> None:
        """Choose what is learned from."""
        self.source.setCurrentIndex(self.source.findData(source))

    def choose_preset(self, name: str) -> None:
        """Choose a preset as a person does."""
        self.preset.setCurrentIndex(self.preset.findData(name))
        self.refresh()

    def _choose_recommended(self) -> None:
        self.choose_preset(recommended_preset(self._count() or FEWEST).name)

    # ---- keeping in step -------------------------------------------------------------------------

    def refresh(self) -> None:
        """Offer what there is to learn from, and show what runs and what was learned."""
        model = self.source
        for place, name in enumerate(get_args(Source)):
            if name != "folder":
                model.setItemText(place, f"{tr(_SOURCES[name])} ({len(self._work.labels(name))})")
        self._folder_rows.setVisible(self.source.currentData() == "folder")
        count = self._count()
        surfaces = self.preset.currentData() == SURFACES
        preset = None if surfaces else find_preset(self.preset.currentData())
        self._explained.setText(tr(_SURFACES_SUMMARY) if preset is None else tr(preset.summary))
        few = preset is not None and count is not None and FEWEST <= count < preset.enough_parents
        self._advice.setText(
            tr(
                "With {count} parents (fewer than {enough}), principal components reproduce unseen "
                "grains better than a network.",
                count=count,
                enough=0 if preset is None else preset.enough_parents,
            )
        )
        self._advice.setVisible(few)
        self.take_pca.setVisible(few)
        for part, shown in (
            (self._n_row, not surfaces), (self._metaball_row, surfaces), (self._steps_row, not surfaces),
            (self._most_row, surfaces and self.source.currentData() in ("inside", "avatars")),
        ):  # fmt: skip
            part.setVisible(shown)
        self.steps.setEnabled(preset is not None and preset.in_steps)
        self._show_foot(count)
        self._show_card()

    def _count(self) -> int | None:
        """Return the number of parents; None of a folder, which is read only when it is learned from."""
        source = self.source.currentData()
        return None if source == "folder" else len(self._limited(source, self._work.labels(source)))

    def _show_foot(self, count: int | None) -> None:
        running = self._work.run.is_running
        self.stop_button.setVisible(not self._work.learns_surfaces)
        folder = self.source.currentData() == "folder"
        ready = bool(self.folder.text().strip()) if folder else count is not None and count >= FEWEST
        source: Source = self.source.currentData()
        new = 0 if folder else len(self._limited(source, self._work.new_labels(source)))
        has_new = self._workspace.has_style and (ready if folder else new > 0)
        if (ready, has_new) != (self.is_ready, self.has_new_parents):
            self.is_ready, self.has_new_parents = ready, has_new
            self.readiness_changed.emit()
        self.learn_button.setVisible(not running)
        self.learn_button.setText(
            tr("Learn")
            if count is None or not ready
            else plural(count, mark("Learn from {count} parent"), mark("Learn from {count} parents"))
        )
        self.on_button.setVisible(not running and has_new)
        self.on_button.setText(
            tr("Continue learning")
            if folder
            else plural(
                new,
                mark("Continue learning with {count} new parent"),
                mark("Continue learning with {count} new parents"),
            )
        )
        self._running.setVisible(running)
        self.pause_button.setText(tr("Resume") if self._work.run.is_paused else tr("Pause"))
        hint = self._state() if running else "" if ready else self._explain_unready(folder, count)
        self.hint.setText(hint)
        self.hint.setVisible(bool(hint))

    def _state(self) -> str:
        """Return what runs, how far it is and how long it takes still."""
        if self._work.is_training:
            return self._work.run.state(tr("Training"))
        return self._work.run.state("" if self._work.learns_surfaces else tr("Serializing"))

    def _explain_unready(self, folder: bool, count: int | None) -> str:
        if folder:
            return tr("Choose a folder of meshes.")
        if self._workspace.state.grains is None and not count:
            return tr("No grains yet: find them first (station Grains), or learn from a folder of meshes.")
        return plural(
            count or 0,
            mark("A style needs at least {fewest} parents; there is {count}."),
            mark("A style needs at least {fewest} parents; there are {count}."),
            fewest=FEWEST,
        )

    def _show_card(self) -> None:
        learner, surfaces = self._workspace.style, self._workspace.surfaces
        if surfaces is not None:
            self._show_surfaces(surfaces)
            return
        if learner is None:
            self.card_name.setText(tr("None yet"))
            self.card.setText(tr("Learn one above, or open a saved one."))
            return
        card = learner.card
        title = find_preset(card.preset).title
        unit = unit_label(card.unit)
        self.card_name.setText(tr("{preset}, {count} parents", preset=tr(title), count=card.count))
        errors = [
            tr(words, error=percent(value))
            for words, value in (
                (mark("Held-out error {error}"), card.held_out_rms),
                (mark("seen parents {error}"), card.trained_rms),
                (mark("avatars against their grains {error}"), card.parents_rms),
            )
            if np.isfinite(value)
        ]
        lines = [
            tr(
                "n = {n} · {latents} latent variables · Dₙ {smallest:.3g} to {largest:.3g} {unit}",
                n=card.n,
                latents=latent_count(learner.core, learner.dimension),
                smallest=card.smallest,
                largest=card.largest,
                unit=unit,
            ),
            tr("{errors} (RMS distance in % of Dₙ)", errors=", ".join(errors)) if errors else "",
            tr("Steps {steps} · seed {seed}", steps=card.steps, seed=card.seed)
            if card.steps
            else tr("Seed {seed}", seed=card.seed),
            *card.notes,
        ]
        self.card.setText("\n".join(line for line in lines if line))

    def _show_surfaces(self, style: SurfaceStyle) -> None:
        """Show what was learned of surfaces: parents, registrations, strengths, metaballs."""
        sizes, unit = [parent.diameter for parent in style.parents], unit_label(style.unit)
        self.card_name.setText(
            tr("{preset}, {count} parents", preset=tr(_SURFACES_TITLE), count=len(style.parents))
        )
        triangles = sum(len(parent.faces) for parent in style.parents)
        lines = [
            tr(
                "{triangles:,} triangles · Dₙ {smallest:.3g} to {largest:.3g} {unit}",
                triangles=triangles,
                smallest=min(sizes),
                largest=max(sizes),
                unit=unit,
            ),
            tr(
                "Warps: {count} modes; grains differ by {strength} of Dₙ, registrations leave {misfit}",
                count=len(style.modes),
                strength=percent(style.warp_strength),
                misfit=percent(style.misfit),
            ),
        ]
        if style.avatars:
            rms = float(np.mean([entry.rms for entry in style.avatars]))
            volume = float(np.mean([abs(entry.volume_error) for entry in style.avatars]))
            lines.append(
                tr(
                    "Metaballs: n = {n}, {rms} of Dₙ from their parents (rms), volume off by {volume}",
                    n=len(style.avatars[0].avatar.weights),
                    rms=percent(rms),
                    volume=percent(volume),
                )
            )
        self.card.setText("\n".join(lines))
