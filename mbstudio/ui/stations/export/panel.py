"""Station Export: avatars to the files of a DEM engine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QDoubleSpinBox, QHBoxLayout, QLineEdit, QPushButton

from mbstudio.core.dem import targets
from mbstudio.core.errors import ExportError
from mbstudio.core.units import unit_label
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.offers import Offers
from mbstudio.ui.stations.export.preview_card import PreviewCard
from mbstudio.ui.stations.export.specimen_form import SpecimenForm
from mbstudio.ui.stations.export.target_form import TargetForm
from mbstudio.ui.stations.export.work import ChosenAvatars, chosen_clones, chosen_fits, chosen_kept
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label, primary_button, row
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.vae.shaping.kept_grain import KeptGrain
    from mbstudio.ui.stations.export.work import ExportWork

UNITS = ("um", "mm", "cm", "m")

_AVATARS = (mark("Export {count} avatar"), mark("Export {count} avatars"))
_KEPT = (mark("Export {count} kept grain"), mark("Export {count} kept grains"))
_EXPORTS = {
    "clones": (mark("Export {count} clone"), mark("Export {count} clones")),
    "kept": _KEPT,
    "kept one": _KEPT,
}


class ExportPanel(Panel):
    """Asks for target, selection, unit, density, options of the target, specimen and folder.

    Attributes
    ----------
    readiness_changed : signal
        There are avatars to write and a folder for them, or no longer.
    folder_asked : signal
    shape_changed : signal
        Another target, other avatars or options: what is handed over looks different.
    """

    readiness_changed = Signal()
    folder_asked = Signal()
    shape_changed = Signal()

    def __init__(self, workspace: Workspace, offers: Offers, theme: Theme, icons: Icons) -> None:
        super().__init__(tr("Export"), tr("Export the avatars to a DEM engine."))
        self._workspace, self._offers = workspace, offers
        self.target = QComboBox()
        for name, target in targets().items():
            self.target.addItem(target.title, name)
        self.target.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.target.setMinimumContentsLength(18)
        self.target.setAccessibleName(tr("Target"))
        self.selection = QComboBox()
        self.unit = QComboBox()
        self.density = QDoubleSpinBox()
        self.density.setRange(0.001, 100_000)
        self.density.setDecimals(0)
        self.density.setValue(2650)
        self.folder = QLineEdit()
        self.folder.setPlaceholderText(tr("Choose an empty folder"))
        self.folder.setAccessibleName(tr("Folder"))
        self.browse = QPushButton(tr("Browse…"))
        self.overwrite = QCheckBox(tr("The folder may hold other files"))
        self.export_button = primary_button(tr("Export"))
        self._density_row = row(
            tr("Density"), self.density, tr("Density of the grains' mineral: 2650 for quartz"), "kg/m³"
        )
        self.options = TargetForm()
        self.preview = PreviewCard(icons)
        self.specimen = SpecimenForm(theme)
        self._taken: tuple[object, ChosenAvatars] | None = None
        self._hint = label("", "hint", wrap=True)

        self.add(label(tr("Target"), "key"), self.target)
        self.add(row(tr("Avatars"), self.selection, tr("Which avatars to export")))
        self._bodies = label("", "hint", wrap=True)
        self.add(self._bodies)
        self.add(row(tr("Unit of the files"), self.unit, tr("All lengths in the files are in this unit")))
        self.add(self._density_row, self.options, self.preview)
        self.add_heading(tr("Specimen"))
        self.add(self.specimen)
        self.body.addStretch(1)
        line = QHBoxLayout()
        line.addWidget(self.folder, 1)
        line.addWidget(self.browse)
        self.foot.addLayout(line)
        self.foot.addWidget(self.overwrite)
        self.foot.addWidget(self._hint)
        self.foot.addWidget(self.export_button)

        self.target.currentIndexChanged.connect(self._target_changed)
        self.folder.textChanged.connect(lambda _: self._write_hint())
        self.specimen.changed.connect(self._write_hint)
        self.selection.currentIndexChanged.connect(lambda _: self._selection_taken())
        self.options.changed.connect(self.shape_changed)
        self.browse.clicked.connect(self.folder_asked)
        for signal in (
            workspace.fits_changed, workspace.selection_changed, workspace.grains_changed,
            workspace.clones_changed, offers.kept_changed, offers.kept_chosen,
        ):  # fmt: skip
            signal.connect(self.refresh)
        offers.export_chosen.connect(self.choose)
        self._target_changed()
        self.refresh()

    # ---- what was chosen -----------------------------------------------------------------------

    @property
    def target_name(self) -> str:
        return str(self.target.currentData())

    @property
    def folder_path(self) -> Path | None:
        """The folder, or None while none is given."""
        text = self.folder.text().strip()
        return Path(text).expanduser() if text else None

    def labels(self) -> list[int]:
        """Labels of the avatars that are to be written."""
        fits = self._workspace.state.included_fits
        kind = self.selection.currentData()
        if kind in ("clones", "kept", "kept one"):
            return []
        if kind == "chosen":
            return self.chosen_labels
        return [label for label, fit in fits.items() if kind != "valid" or fit.verdict.valid]

    @property
    def chosen_labels(self) -> list[int]:
        """Labels of the chosen grains that have an avatar and are not excluded."""
        return sorted(self._workspace.chosen & self._workspace.state.included_fits.keys())

    def chosen(self) -> ChosenAvatars:
        """Return the avatars that are to be written, by the names of their files."""
        kind = self.selection.currentData()
        if kind == "clones" and self._workspace.clones is not None:
            clones = self._workspace.clones
            return self._once(("clones", clones), lambda: chosen_clones(clones))
        if kind == "kept" and self._offers.learner is not None and self.kept:
            learner, kept = self._offers.learner, self.kept
            return self._once(("kept", learner, *map(id, kept)), lambda: chosen_kept(learner, kept))
        if kind == "kept one" and self._offers.learner is not None:
            one, by = self._one_kept(), self._offers.learner
            return self._once(("kept", by, *map(id, one)), lambda: chosen_kept(by, one))
        return chosen_fits(self._workspace.state.fits, self.labels())

    def _once(self, key: tuple[object, ...], make: Callable[[], ChosenAvatars]) -> ChosenAvatars:
        """Decode clones and kept grains once, not at every look."""
        if self._taken is None or self._taken[0] != key:
            self._taken = key, make()
        return self._taken[1]

    @property
    def kept(self) -> tuple[KeptGrain, ...]:
        """Grains shaped by hand that can be exported."""
        return self._offers.kept

    def _one_kept(self) -> list[KeptGrain]:
        return [grain for grain in self.kept if grain.name == self._offers.kept_name]

    def choose(self, kind: str) -> None:
        """Choose which avatars are written: 'valid', 'all', 'chosen', 'clones', 'kept' or 'kept one'."""
        self.selection.setCurrentIndex(max(0, self.selection.findData(kind)))

    @property
    def count(self) -> int:
        """How many avatars are to be written."""
        kind = self.selection.currentData()
        if kind == "clones":
            return 0 if self._workspace.clones is None else len(self._workspace.clones)
        if kind in ("kept", "kept one"):
            return len(self.kept if kind == "kept" else self._one_kept())
        return len(self.labels())

    def given(self) -> dict[str, Any]:
        """Return unit, density, overwrite, specimen and the target's options, as export wants them.

        Raises
        ------
        ExportError
            If the sieve curve of the specimen is none.
        """
        needs = targets()[self.target_name].needs_density
        return {
            "unit": self.unit.currentData(),
            "density": self.density.value() if needs else None,
            "overwrite": self.overwrite.isChecked(),
            "specimen": self.specimen.plan(),
            "options": self.options.values,
        }

    @property
    def is_ready(self) -> bool:
        """Whether something can be exported as set."""
        return self.count > 0 and self.folder_path is not None and not self._fault()

    def start(self, exports: ExportWork) -> None:
        """Let what was chosen be written."""
        if self.folder_path is not None:
            exports.export(self.chosen(), self.target_name, self.folder_path, self.given())

    def _fault(self) -> str:
        """Return what is wrong with the specimen, nothing if it is right."""
        try:
            self.specimen.plan()
        except ExportError as error:
            return str(error)
        return ""

    # ---- keeping in step -----------------------------------------------------------------------

    def refresh(self) -> None:
        """Offer what there is to export."""
        fits = self._workspace.state.included_fits
        chosen = self.chosen_labels
        valid = sum(fit.verdict.valid for fit in fits.values())
        kind = self.selection.currentData() or "valid"
        self.selection.blockSignals(True)
        self.selection.clear()
        self.selection.addItem(tr("All valid ({count})", count=valid), "valid")
        self.selection.addItem(tr("All ({count})", count=len(fits)), "all")
        if len(chosen) == 1:
            self.selection.addItem(tr("Grain {label}", label=chosen[0]), "chosen")
        elif chosen:
            self.selection.addItem(tr("Chosen grains ({count})", count=len(chosen)), "chosen")
        if self._workspace.clones is not None:
            self.selection.addItem(tr("Clones ({count})", count=len(self._workspace.clones)), "clones")
            kind = "clones" if not fits else kind
        if self.kept:
            self.selection.addItem(tr("Kept grains ({count})", count=len(self.kept)), "kept")
            if not fits and kind == "valid":
                kind = "kept"
        if self._one_kept():
            self.selection.addItem(tr("Kept grain {name}", name=self._offers.kept_name), "kept one")
        elif kind == "kept one":
            kind = "kept" if self.kept else "valid"
        self.selection.setCurrentIndex(max(0, self.selection.findData(kind)))
        self.selection.blockSignals(False)
        self._selection_taken()

    def _selection_taken(self) -> None:
        self._write_hint()
        self.shape_changed.emit()

    def _say_which_bodies(self) -> None:
        """Say what of clones of surfaces is written: the surface of record, or the metaball."""
        of_surfaces = (
            self.selection.currentData() == "clones" and self._workspace.state.surface_clones is not None
        )
        meshes = targets()[self.target_name].geometry == "mesh"
        self._bodies.setVisible(of_surfaces)
        self._bodies.setText(
            tr("Written are the surfaces of record. The manifest says how the metaballs differ.")
            if meshes
            else tr(
                "Written are the metaballs. The manifest says how they differ from the surfaces of record."
            )
        )

    def _write_hint(self) -> None:
        fault = self._fault()
        self._say_which_bodies()
        if not self._workspace.state.fits and not self.count:
            text = tr("No avatars yet: fit some grains first (station Fit).")
        elif not self.count:
            text = tr("No avatar is valid. Fit again with more control points, or choose “All”.")
        elif fault:
            text = tr("The sieve curve of the specimen is incomplete.")
        elif self.folder_path is None:
            text = tr("Choose a folder for the files.")
        else:
            text = ""
        self._hint.setText(text)
        self._hint.setVisible(bool(text))
        self.readiness_changed.emit()
        count = self.count
        one, many = _EXPORTS.get(self.selection.currentData(), _AVATARS)
        self.export_button.setText(tr(one if count == 1 else many, count=count) if count else tr("Export"))

    def _target_changed(self) -> None:
        target = targets()[self.target_name]
        self._density_row.setVisible(target.needs_density)
        self.unit.clear()
        usual = (
            tr("Default ({unit})", unit=unit_label(target.default_unit))
            if target.default_unit
            else tr("As in the scan")
        )
        self.unit.addItem(usual, None)
        # A target whose files can be in one unit only has nothing to choose.
        self.unit.setEnabled(len(target.units) != 1)
        for unit in target.units or UNITS:
            self.unit.addItem(unit_label(unit), unit)
        self.options.show_target(target)
        self._say_which_bodies()
        self.shape_changed.emit()
