"""The dialog that corrects the voxel size: what lengths are, and what they will be."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QGridLayout, QLabel, QLineEdit, QVBoxLayout, QWidget

from mbstudio.core.errors import ProjectError, UnitError
from mbstudio.core.project import ProjectState
from mbstudio.core.project.voxel_size import VoxelSizeCorrection, correct_voxel_size
from mbstudio.core.units import VoxelSize
from mbstudio.scene.layers.annotations import readable_length
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label, primary_button


class VoxelSizeDialog(QDialog):
    """Asks for the right voxel size and shows typical lengths before and after.

    Parameters
    ----------
    state : ProjectState
        With scan or grains.
    parent : QWidget, optional

    Attributes
    ----------
    answered : signal (VoxelSize)
    field : QLineEdit
    button : QPushButton
    """

    answered = Signal(object)

    def __init__(self, state: ProjectState, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("Correct the voxel size"))
        self.setMinimumWidth(470)
        self._state = state
        layout = QVBoxLayout(self)
        layout.setContentsMargins(22, 20, 22, 18)
        layout.setSizeConstraint(QVBoxLayout.SizeConstraint.SetMinimumSize)  # long lengths are not cut
        layout.setSpacing(10)
        layout.addWidget(label(tr("Correct the voxel size"), "title"))
        words = tr(
            "Scan, grains, measures, avatars, style and clones follow. It is one step of undo. Sizes that "
            "you have typed into forms stay as they are."
        )
        layout.addWidget(label(words, "subtitle", wrap=True))
        self.field = QLineEdit()
        self.field.setPlaceholderText(tr("14 um, or 20 x 14 x 14 um (z, y, x)"))
        self.field.setAccessibleName(tr("Voxel size"))
        layout.addWidget(self.field)
        table = QGridLayout()
        table.setHorizontalSpacing(18)
        for column, words in enumerate((tr("Before"), tr("After")), 1):
            table.addWidget(label(words, "key"), 0, column)
        self._values: dict[str, tuple[QLabel, QLabel]] = {}
        for line, (name, title) in enumerate(
            (
                ("voxel", tr("Voxel size")),
                ("extent", tr("Size of the scan")),
                ("diameter", tr("Median nominal diameter")),
            ),
            1,
        ):
            pair = QLabel(), QLabel()
            for column, widget in enumerate((label(title, "key"), *pair)):
                table.addWidget(widget, line, column)
            self._values[name] = pair
        table.setColumnStretch(3, 1)
        layout.addLayout(table)
        self._told = label("", "hint", wrap=True)
        layout.addWidget(self._told)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.button(QDialogButtonBox.StandardButton.Cancel).setText(tr("Cancel"))
        self.button = primary_button(tr("Correct"))
        buttons.addButton(self.button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        layout.addWidget(buttons)
        self.field.textChanged.connect(self._show)
        size = state.scan.voxel_size if state.scan is not None else None
        if size is None and state.grains is not None:
            size = state.grains.voxel_size
        self.field.setText(str(size or ""))
        self._show()
        self.field.selectAll()
        self.field.setFocus()

    def accept(self) -> None:
        """Hand the size over."""
        correction, _ = self._correction()
        if correction is not None:
            super().accept()
            self.answered.emit(correction.after)

    def shown(self, name: str) -> tuple[str, str]:
        """Return what is shown of a length before and after: "voxel", "extent" or "diameter"."""
        before, after = self._values[name]
        return before.text(), after.text()

    def _correction(self) -> tuple[VoxelSizeCorrection | None, str]:
        try:
            return correct_voxel_size(self._state, VoxelSize.parse(self.field.text())), ""
        except (ProjectError, UnitError) as error:
            return None, str(error)

    def _show(self) -> None:
        correction, problem = self._correction()
        self.button.setEnabled(correction is not None)
        if correction is None:
            for _, after in self._values.values():
                after.setText("–")
            self._told.setText(problem)
            return
        self._told.setText("\n".join(correction.notes))
        medians = correction.median_diameters
        for place, size in enumerate((correction.before, correction.after)):
            self._values["voxel"][place].setText(str(size))
            self._values["extent"][place].setText(self._extent(size))
            words = "–" if medians is None else readable_length(medians[place], size.unit)
            self._values["diameter"][place].setText(words)

    def _extent(self, size: VoxelSize) -> str:
        scan, grains = self._state.scan, self._state.grains
        shape = scan.shape if scan is not None else grains.label_volume.shape if grains is not None else ()
        return " × ".join(
            readable_length(count * edge, size.unit) for count, edge in zip(shape, size.zyx, strict=True)
        )
