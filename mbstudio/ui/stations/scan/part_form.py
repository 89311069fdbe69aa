"""The fields in which a part of the scan is chosen."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox, QGridLayout, QHBoxLayout, QPushButton, QSpinBox, QVBoxLayout, QWidget

from mbstudio.core.scan.excerpt import Counts, describe_bin
from mbstudio.scene.layers.annotations import readable_length
from mbstudio.scene.layers.slices import Axis
from mbstudio.ui.language import tr
from mbstudio.ui.stations.scan.part_draft import BINS, ORDER, PartDraft
from mbstudio.ui.widgets.forms import label, primary_button, row
from mbstudio.ui.workspace import Workspace


class PartForm(QWidget):
    """From and up to which voxel along each axis, how many become one, and what becomes of it.

    Parameters
    ----------
    draft : PartDraft
    workspace : Workspace

    Attributes
    ----------
    cancelled : signal
    take_button, reset_button : QPushButton
        To be bound to their commands.
    """

    cancelled = Signal()

    def __init__(self, draft: PartDraft, workspace: Workspace) -> None:
        super().__init__()
        self._draft, self._workspace = draft, workspace
        self.fields: dict[Axis, tuple[QSpinBox, QSpinBox]] = {}
        self._lengths = {axis: label("", "hint") for axis in ORDER}
        self.bin_field = QComboBox()
        self._bins: list[Counts] = []
        for factors in BINS:
            self._offer(factors)
        self.result = label("", "value", wrap=True)
        self.remark = label("", "hint", wrap=True)
        self.take_button = primary_button(tr("Take this part"))
        self.reset_button = QPushButton(tr("Reset"))
        cancel = QPushButton(tr("Cancel"))
        cancel.setToolTip(tr("Leave the scan as it is"))
        cancel.clicked.connect(self.cancelled)

        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(8)
        layout.addWidget(
            label(tr("Drag the edges and corners of the box in the slices, or give voxels."), "hint", True)
        )
        layout.addLayout(self._grid_of_ends())
        tip = tr("Voxels that become one, their mean; three numbers are those along z, y and x")
        layout.addWidget(row(tr("Bin"), self.bin_field, tip))
        layout.addWidget(self.result)
        layout.addWidget(self.remark)
        buttons = QHBoxLayout()
        buttons.setSpacing(8)
        buttons.addWidget(self.take_button, 1)
        buttons.addWidget(self.reset_button)
        buttons.addWidget(cancel)
        layout.addLayout(buttons)

        self.bin_field.activated.connect(lambda place: draft.set_bin(self._bins[place]))
        draft.changed.connect(self.refresh)
        workspace.grains_changed.connect(self.refresh)

    def _offer(self, factors: Counts) -> None:
        plain = factors == (1, 1, 1)
        self.bin_field.addItem(tr("none") if plain else describe_bin(factors))
        self._bins.append(factors)

    def _grid_of_ends(self) -> QGridLayout:
        grid = QGridLayout()
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(6)
        grid.setColumnStretch(3, 1)
        grid.addWidget(label(tr("from"), "hint"), 0, 1)
        grid.addWidget(label(tr("up to"), "hint"), 0, 2)
        for line, axis in enumerate(ORDER, 1):
            first, last = QSpinBox(), QSpinBox()
            names = (
                tr("First voxel of the region along {axis}", axis=axis),
                tr("Voxel behind the last of the region along {axis}", axis=axis),
            )
            for column, (field, name) in enumerate(zip((first, last), names, strict=True), 1):
                field.setButtonSymbols(QSpinBox.ButtonSymbols.NoButtons)
                field.setAlignment(Qt.AlignmentFlag.AlignRight)
                field.setFixedWidth(72)
                field.setAccessibleName(name)
                field.setToolTip(name)
                field.setKeyboardTracking(False)
                field.valueChanged.connect(lambda _, own=axis: self._typed(own))
                grid.addWidget(field, line, column)
            grid.addWidget(label(axis, "key"), line, 0)
            self._lengths[axis].setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            grid.addWidget(self._lengths[axis], line, 3)
            self.fields[axis] = first, last
        return grid

    def refresh(self) -> None:
        """Show the draft as it stands."""
        draft = self._draft
        if draft.scan is None:
            return
        for axis, count in zip(ORDER, draft.scan.shape, strict=True):
            (first, last), (start, stop) = self.fields[axis], draft.ends[axis]
            for field, low, high, value in ((first, 0, stop - 1, start), (last, start + 1, count, stop)):
                field.blockSignals(True)
                field.setRange(low, high)
                field.setValue(value)
                field.blockSignals(False)
            self._lengths[axis].setText(readable_length(draft.length_along(axis), draft.scan.unit))
        if draft.bin not in self._bins:
            self._offer(draft.bin)
        self.bin_field.setCurrentIndex(self._bins.index(draft.bin))
        self.bin_field.setEnabled(draft.may_bin)
        self.result.setText(draft.describe_result())
        remarks = [draft.describe_left_out()]
        if not draft.may_bin:
            remarks.append(tr("The scan is binned already: show the whole scan again for another bin."))
        if self._workspace.state.grains is not None:
            remarks.append(tr("Its grains are to be found anew; undo brings these back."))
        words = " ".join(remark for remark in remarks if remark)
        self.remark.setText(words)
        self.remark.setVisible(bool(words))

    def _typed(self, axis: Axis) -> None:
        first, last = self.fields[axis]
        self._draft.set_ends({axis: (first.value(), last.value())})
