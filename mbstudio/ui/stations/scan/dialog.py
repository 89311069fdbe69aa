"""What a scan file does not say by itself: voxel size, and for RAW its shape and type."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QHBoxLayout,
    QLineEdit,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.errors import UnitError
from mbstudio.core.units import VoxelSize, unit_label
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label, primary_button, row

TYPES = ("uint8", "uint16", "int16", "float32", "int32", "uint32", "float64")


@dataclass(frozen=True)
class ScanAnswer:
    """What the person said about a scan; None where nothing had to be said."""

    path: Path
    voxel_size: VoxelSize | None
    shape: tuple[int, int, int] | None = None
    dtype: str | None = None
    header_bytes: int = 0
    big_endian: bool = False


class ScanDialog(QDialog):
    """Asks for the voxel size (and the layout of a RAW file); accepts only what can be right.

    Parameters
    ----------
    path : Path
    why : str
        What is missing, in a sentence.
    raw : bool
        Whether shape and type are needed too.
    """

    answered = Signal(object)

    def __init__(self, path: Path, why: str, raw: bool, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("Open scan"))
        self.setMinimumWidth(430)
        self._path, self._raw = path, raw
        self.size_field = QLineEdit()
        self.size_field.setPlaceholderText(tr("14 or 20 x 14 x 14"))
        self.size_field.setMinimumWidth(190)
        self.unit_field = QComboBox()
        for unit in ("um", "mm", "nm", "cm", "m"):
            self.unit_field.addItem(unit_label(unit), unit)
        self.unit_field.setAccessibleName(tr("Unit of the voxel size"))
        size = QWidget()
        line = QHBoxLayout(size)
        line.setContentsMargins(0, 0, 0, 0)
        line.addWidget(self.size_field, 1)
        line.addWidget(self.unit_field)
        self._size_row = row(
            tr("Voxel size"), size, tr("Edge length of a voxel; three numbers (z, y, x) if they differ")
        )
        self.size_field.setAccessibleName(tr("Voxel size"))
        self.shape_fields = [QSpinBox() for _ in "zyx"]
        self.type_field = QComboBox()
        self.type_field.addItems(TYPES)
        self.header_field = QSpinBox()
        self.header_field.setRange(0, 2**31 - 1)
        self.header_field.setSuffix(tr(" bytes"))
        self.order_field = QCheckBox(tr("Most significant byte first (big endian)"))
        self._problem = label("", "hint", wrap=True)

        layout = QVBoxLayout(self)
        layout.setContentsMargins(22, 20, 22, 18)
        layout.setSpacing(10)
        layout.addWidget(label(path.name, "title"))
        layout.addWidget(label(why, "subtitle", wrap=True))
        layout.addSpacing(6)
        layout.addWidget(self._size_row)
        if raw:
            for axis, field in zip("zyx", self.shape_fields, strict=True):
                field.setRange(1, 100_000)
                field.setValue(256)
                field.setMinimumWidth(120)
                layout.addWidget(row(tr("Voxels along {axis}", axis=axis), field))
                field.valueChanged.connect(self._check)
            layout.addWidget(row(tr("Type of a voxel"), self.type_field))
            layout.addWidget(row(tr("Header to skip"), self.header_field))
            layout.addWidget(self.order_field)
            self.type_field.currentIndexChanged.connect(self._check)
            self.header_field.valueChanged.connect(self._check)
        layout.addWidget(self._problem)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.button(QDialogButtonBox.StandardButton.Cancel).setText(tr("Cancel"))
        self.open_button = primary_button(tr("Open scan"))
        buttons.addButton(self.open_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        layout.addWidget(buttons)
        self.size_field.textChanged.connect(self._check)
        self.unit_field.currentIndexChanged.connect(self._check)
        self.accepted.connect(lambda: self.answered.emit(self.answer()))
        self._check()
        self.size_field.setFocus()

    def answer(self) -> ScanAnswer:
        """Return what was said; UnitError if the voxel size is none."""
        size = VoxelSize.parse(self.size_field.text(), self.unit_field.currentData())
        if not self._raw:
            return ScanAnswer(self._path, size)
        z, y, x = (field.value() for field in self.shape_fields)
        return ScanAnswer(
            self._path,
            size,
            (z, y, x),
            self.type_field.currentText(),
            self.header_field.value(),
            self.order_field.isChecked(),
        )

    def _check(self) -> None:
        problem = ""
        if not self.size_field.text().strip():
            problem = tr("The voxel size is given in the reconstruction report or the scanner's protocol.")
            good = False
        else:
            try:
                self.answer()
                good = True
            except UnitError as error:
                problem, good = str(error), False
        if good and self._raw and self._path.is_file():
            said = self.answer()
            assert said.shape is not None
            import numpy as np

            needed = int(np.prod(said.shape)) * np.dtype(said.dtype).itemsize + said.header_bytes
            there = self._path.stat().st_size
            if needed != there:
                problem = tr(
                    "These settings need {needed:,} bytes; the file has {there:,}.",
                    needed=needed,
                    there=there,
                )
                good = needed <= there
        self._problem.setText(problem)
        self.open_button.setEnabled(good)
