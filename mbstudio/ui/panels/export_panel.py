"""Station Export: avatars to the files of a DEM engine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.dem import targets
from mbstudio.core.units import unit_label
from mbstudio.ui.panels.panel import Panel
from mbstudio.ui.widgets.forms import empty, label, primary_button, row
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.vae.generation import Generation
    from mbstudio.core.vae.kept_grain import KeptGrain
    from mbstudio.core.vae.style_learner import StyleLearner
    from mbstudio.ui.work.export_work import ExportWork

UNITS = ("um", "mm", "cm", "m")


class ExportPanel(Panel):
    """Asks for target, selection, unit, density, options of the target and folder.

    Attributes
    ----------
    export_asked : signal
    folder_asked : signal
    """

    export_asked = Signal()
    folder_asked = Signal()

    def __init__(self, workspace: Workspace) -> None:
        super().__init__("Export", "Hand the avatars over to a DEM engine.")
        self._workspace = workspace
        self._clones: Generation | None = None
        self.kept: list[KeptGrain] = []
        self._learner: StyleLearner | None = None
        self.target = QComboBox()
        for name, target in targets().items():
            self.target.addItem(target.title, name)
        self.target.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.target.setMinimumContentsLength(18)
        self.target.setAccessibleName("Target")
        self.selection = QComboBox()
        self.unit = QComboBox()
        self.density = QDoubleSpinBox()
        self.density.setRange(0.001, 100_000)
        self.density.setDecimals(0)
        self.density.setValue(2650)
        self.folder = QLineEdit()
        self.folder.setPlaceholderText("Choose an empty folder")
        self.folder.setAccessibleName("Folder")
        self.browse = QPushButton("Browse…")
        self.overwrite = QCheckBox("The folder may hold other files")
        self.export_button = primary_button("Export")
        self._density_row = row("Density", self.density, "Of the grains' mineral: quartz 2650", "kg/m³")
        self._options = QWidget()
        self._options_layout = QVBoxLayout(self._options)
        self._options_layout.setContentsMargins(0, 0, 0, 0)
        self._options_layout.setSpacing(10)
        self._option_fields: dict[str, QWidget] = {}
        self._hint = label("", "hint", wrap=True)

        self.add(label("Target", "key"), self.target)
        self.add(row("Avatars", self.selection, "Which avatars are written"))
        self.add(row("Unit of the files", self.unit, "All lengths in the files are in this unit"))
        self.add(self._density_row, self._options)
        self.add_heading("Folder")
        line = QHBoxLayout()
        line.addWidget(self.folder, 1)
        line.addWidget(self.browse)
        self.body.addLayout(line)
        self.add(self.overwrite)
        self.body.addStretch(1)
        self.foot.addWidget(self._hint)
        self.foot.addWidget(self.export_button)

        self.target.currentIndexChanged.connect(self._target_changed)
        self.folder.textChanged.connect(lambda _: self.refresh())
        self.selection.currentIndexChanged.connect(lambda _: self._write_hint())
        self.browse.clicked.connect(self.folder_asked)
        self.export_button.clicked.connect(self.export_asked)
        for signal in (workspace.fits_changed, workspace.selection_changed, workspace.grains_changed):
            signal.connect(self.refresh)
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
        fits = self._workspace.state.fits
        kind = self.selection.currentData()
        if kind in ("clones", "kept"):
            return []
        if kind == "chosen":
            chosen = self._workspace.selected
            return [chosen] if chosen is not None and chosen in fits else []
        return sorted(label for label, fit in fits.items() if kind != "valid" or fit.verdict.valid)

    def clones(self) -> Generation | None:
        """Return the clones if they are what is to be written."""
        return self._clones if self.selection.currentData() == "clones" else None

    def offer_clones(self, clones: Generation | None) -> None:
        """Offer clones beside the avatars of grains, or no longer."""
        self._clones = clones
        self.refresh()

    def kept_grains(self) -> tuple[StyleLearner, list[KeptGrain]] | None:
        """Return the kept grains with the style-learner that decodes them, where they were chosen."""
        if self.selection.currentData() != "kept" or self._learner is None or not self.kept:
            return None
        return self._learner, self.kept

    def set_kept(self, kept: Sequence[KeptGrain], learner: StyleLearner | None) -> None:
        """Offer the kept grains of the latent studio."""
        self.kept, self._learner = list(kept), learner
        self.refresh()

    def choose(self, kind: str) -> None:
        """Choose which avatars are written: 'valid', 'all', 'chosen', 'clones' or 'kept'."""
        self.selection.setCurrentIndex(max(0, self.selection.findData(kind)))

    @property
    def count(self) -> int:
        """How many avatars are to be written."""
        clones, kept = self.clones(), self.kept_grains()
        if kept is not None:
            return len(kept[1])
        return len(self.labels()) if clones is None else len(clones)

    def given(self) -> dict[str, Any]:
        """Return unit, density, overwrite and the target's options, as export wants them."""
        needs = targets()[self.target_name].needs_density
        return {
            "unit": self.unit.currentData(),
            "density": self.density.value() if needs else None,
            "overwrite": self.overwrite.isChecked(),
            "options": {name: _value(field) for name, field in self._option_fields.items()},
        }

    @property
    def is_ready(self) -> bool:
        """Whether something can be exported as set."""
        return self.count > 0 and self.folder_path is not None

    def start(self, exports: ExportWork) -> None:
        """Let what was chosen be written."""
        folder, clones, kept = self.folder_path, self.clones(), self.kept_grains()
        if folder is None:
            return
        if clones is not None:
            exports.export_clones(clones, self.target_name, folder, **self.given())
        elif kept is not None:
            exports.export_kept(*kept, self.target_name, folder, **self.given())
        else:
            exports.export(self.labels(), self.target_name, folder, **self.given())

    # ---- keeping in step -----------------------------------------------------------------------

    def refresh(self) -> None:
        """Offer what there is to export."""
        fits, chosen = self._workspace.state.fits, self._workspace.selected
        valid = sum(fit.verdict.valid for fit in fits.values())
        kind = self.selection.currentData() or "valid"
        self.selection.blockSignals(True)
        self.selection.clear()
        self.selection.addItem(f"All valid ({valid})", "valid")
        self.selection.addItem(f"All ({len(fits)})", "all")
        if chosen in fits:
            self.selection.addItem(f"Grain {chosen}", "chosen")
        if self._clones is not None:
            self.selection.addItem(f"Clones ({len(self._clones)})", "clones")
            kind = "clones" if not fits else kind
        if self.kept:
            self.selection.addItem(f"Kept grains ({len(self.kept)})", "kept")
            if not fits and kind == "valid":
                kind = "kept"
        self.selection.setCurrentIndex(max(0, self.selection.findData(kind)))
        self.selection.blockSignals(False)
        self._write_hint()

    def _write_hint(self) -> None:
        if not self._workspace.state.fits and self.clones() is None and self.kept_grains() is None:
            text = "No avatars yet: fit some grains first (station Fit)."
        elif not self.count:
            text = "None of the avatars is valid: fit again with more control points, or choose “All”."
        elif self.folder_path is None:
            text = "Choose a folder for the files."
        else:
            text = ""
        self._hint.setText(text)
        self._hint.setVisible(bool(text))
        self.export_button.setEnabled(self.is_ready)
        count = self.count
        what = "clone" if self.clones() else "kept grain" if self.kept_grains() else "avatar"
        self.export_button.setText(f"Export {count} {what}{'s' if count != 1 else ''}" if count else "Export")

    def _target_changed(self) -> None:
        target = targets()[self.target_name]
        self._density_row.setVisible(target.needs_density)
        self.unit.clear()
        usual = f"Usual ({unit_label(target.default_unit)})" if target.default_unit else "As in the scan"
        self.unit.addItem(usual, None)
        # A target whose files can be in one unit only has nothing to choose.
        self.unit.setEnabled(len(target.units) != 1)
        for unit in target.units or UNITS:
            self.unit.addItem(unit_label(unit), unit)
        empty(self._options_layout)
        self._option_fields = {}
        for name, option in target.options.items():
            field = _field(option)
            self._option_fields[name] = field
            title = name.replace("_", " ").capitalize()
            self._options_layout.addWidget(row(title, field, option.meaning))
        self._options.setVisible(bool(target.options))


def _field(option: Any) -> QWidget:
    """Return the field that can hold an option and nothing it refuses."""
    default = option.default
    if isinstance(default, bool):
        box = QCheckBox()
        box.setChecked(default)
        return box
    if isinstance(default, int):
        whole = QSpinBox()
        low = 0 if option.minimum is None else option.minimum
        whole.setRange(int(low), int(10_000_000 if option.maximum is None else option.maximum))
        whole.setValue(default)
        return whole
    if isinstance(default, float):
        real = QDoubleSpinBox()
        real.setDecimals(4)
        real.setRange(
            -1e9 if option.minimum is None else option.minimum,
            1e9 if option.maximum is None else option.maximum,
        )
        real.setValue(default)
        return real
    line = QLineEdit(str(default))
    line.setMaximumWidth(120)
    return line


def _value(field: QWidget) -> Any:
    if isinstance(field, QCheckBox):
        return field.isChecked()
    if isinstance(field, QSpinBox | QDoubleSpinBox):
        return field.value()
    assert isinstance(field, QLineEdit)
    return field.text()
