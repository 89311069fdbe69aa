"""What files of meshes do not say by themselves: the unit of their numbers, and how to take them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QSettings, Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QDialog, QDialogButtonBox, QSpinBox, QVBoxLayout, QWidget

from mbstudio.core.units import METRES_PER_UNIT, conversion_factor, unit_label
from mbstudio.scene.layers.annotations import readable_length
from mbstudio.ui.kept_settings import whole_number
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.grains.mesh_work import FirstStone, MeshAnswer
from mbstudio.ui.widgets.forms import label, primary_button, row

UNITS = ("mm", "um", "m", "cm", "nm")
SIZES = (1e-4, 0.3)
"""Lengths of stones in metres, between which a unit is likely."""
_STATING = (".3mf", ".glb", ".gltf")
_CAVITIES = (("fill", mark("Fill")), ("keep", mark("Keep as voids")))


def likely_unit(length: float | None, before: str = "") -> str:
    """Return the unit in which a stone of this length in numbers is as large as stones are.

    Parameters
    ----------
    before : str
        The unit chosen last, which is taken if it is likely.
    """
    wanted = [before, *UNITS] if before in UNITS else list(UNITS)
    if length is None:
        return wanted[0]
    return next((unit for unit in wanted if SIZES[0] <= length * METRES_PER_UNIT[unit] <= SIZES[1]), UNITS[0])


class MeshDialog(QDialog):
    """Asks for unit, resolution and cavities, and says how large that makes the first stone.

    Parameters
    ----------
    paths : sequence of Path
    first : FirstStone or None
        None if none of the first files could be read.
    left_out : int
        How many of the files that were given are none of meshes.
    settings : QSettings
        Keeps the unit and resolution chosen last.

    Attributes
    ----------
    answered : signal (MeshAnswer)
    """

    answered = Signal(object)

    def __init__(
        self,
        paths: Sequence[Path],
        first: FirstStone | None,
        left_out: int,
        settings: QSettings,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("Open meshes"))
        self.setMinimumWidth(470)
        self._paths, self._first, self._settings = tuple(paths), first, settings
        self._make_fields()
        self._hint = label("", "value", wrap=True)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(22, 20, 22, 18)
        layout.setSpacing(10)
        one = len(paths) == 1
        layout.addWidget(label(paths[0].name if one else tr("{count} meshes", count=len(paths)), "title"))
        layout.addWidget(label(self._told(left_out), "subtitle", wrap=True))
        layout.addSpacing(6)
        for field in self._rows:
            layout.addWidget(field)
        layout.addWidget(self.override)
        layout.addSpacing(2)
        layout.addWidget(self._hint)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.button(QDialogButtonBox.StandardButton.Cancel).setText(tr("Cancel"))
        self.open_button = primary_button(tr("Open meshes"))
        buttons.addButton(self.open_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        layout.addWidget(buttons)
        self.unit.currentIndexChanged.connect(self._show_size)
        self.override.toggled.connect(self._show_size)
        self.accepted.connect(self._answer)
        self._show_size()
        self.unit.setFocus()

    def _make_fields(self) -> None:
        first = self._first
        self.unit, self.resolution, self.cavities = QComboBox(), QSpinBox(), QComboBox()
        for unit in UNITS:
            self.unit.addItem(unit_label(unit), unit)
        known = None if first is None or first.unit is not None else first.length
        before = str(self._settings.value("meshes/unit", ""))
        self.unit.setCurrentIndex(self.unit.findData(likely_unit(known, before)))
        self.resolution.setRange(20, 400)
        self.resolution.setSingleStep(10)
        self.resolution.setValue(whole_number(self._settings, "meshes/resolution", 120, 20, 400))
        for word, title in _CAVITIES:
            self.cavities.addItem(tr(title), word)
        self.override = QCheckBox(tr("Take this unit also for files that state another"))
        self.override.setToolTip(
            tr("3MF, GLB and glTF state their unit. Some programs write it wrongly, for example mm as m.")
        )
        self.override.setVisible(any(path.suffix.lower() in _STATING for path in self._paths))
        self._rows = (
            row(
                tr("Unit of the coordinates"),
                self.unit,
                tr("STL, PLY, OBJ and OFF files hold numbers without a unit"),
            ),
            row(
                tr("Resolution"),
                self.resolution,
                tr(
                    "Voxels along a stone of middle length. Avatars are fitted to these voxels; surfaces are "
                    "shown and measured as the files have them"
                ),
                tr("voxels"),
            ),
            row(
                tr("Enclosed cavities"),
                self.cavities,
                tr("Fill voids that a body encloses, or keep them: then avatars are fitted with voids"),
            ),
        )

    def answer(self) -> MeshAnswer:
        """Return what was said."""
        return MeshAnswer(
            self._paths,
            self.unit.currentData(),
            self.override.isChecked(),
            self.resolution.value(),
            self.cavities.currentData(),
        )

    @property
    def hint(self) -> str:
        """How large the first stone is in the chosen unit."""
        return self._hint.text()

    def _answer(self) -> None:
        said = self.answer()
        self._settings.setValue("meshes/unit", said.unit)
        self._settings.setValue("meshes/resolution", said.resolution)
        self.answered.emit(said)

    def _told(self, left_out: int) -> str:
        words = [tr("Each closed body becomes a grain.")]
        if left_out:
            words.append(
                plural(
                    left_out,
                    mark("{count} of the files given is no mesh and is left out."),
                    mark("{count} of the files given are no meshes and are left out."),
                )
            )
        return " ".join(words)

    def _show_size(self) -> None:
        first = self._first
        if first is None:
            self._hint.setText(tr("The first files could not be read, so their size is not known."))
            return
        states = first.unit is not None and not self.override.isChecked()
        unit = first.unit if states and first.unit is not None else self.unit.currentData()
        metres = first.length * METRES_PER_UNIT[unit]
        # In the unit that is read best: 23 mm rather than 0.023 m.
        size = readable_length(first.length * conversion_factor(unit, "um"), "um")
        words = tr("{name}: the stone is {size} across.", name=first.name, size=size)
        if first.bodies > 1:
            words = tr(
                "{name} holds {count} bodies; the first is {size} across.",
                name=first.name, count=first.bodies, size=size,
            )  # fmt: skip
        if states:
            words += " " + tr("The file states its unit, {unit}.", unit=unit_label(unit))
        elif not SIZES[0] <= metres <= SIZES[1]:
            words += " " + tr("Is the unit right?")
        self._hint.setText(words)
