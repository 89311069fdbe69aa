"""Station Scan: what was scanned, and where to cut it."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QLabel, QPushButton, QWidget
from superqt import QDoubleRangeSlider

from mbstudio.core.scan import Scan
from mbstudio.scene.layers.annotations import readable_length
from mbstudio.scene.layers.slices import AXES, sample_of_voxels
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import SliceSlider, label, primary_button
from mbstudio.ui.widgets.plots import Histogram
from mbstudio.ui.workspace import Workspace

_FRAMES = {"x": mark("reddish"), "y": mark("green"), "z": mark("blue")}
_FACTS = (
    mark("File"), mark("Voxels"), mark("Voxel size"), mark("Size"), mark("Grey values"), mark("Memory"),
)  # fmt: skip


class ScanPanel(Panel):
    """Shows the scan's facts and moves its slices.

    Attributes
    ----------
    slice_moved : signal (str, int)
    slice_switched : signal (str, bool)
    window_changed : signal (float, float)
        Grey values shown black and white.
    """

    slice_moved = Signal(str, int)
    slice_switched = Signal(str, bool)
    window_changed = Signal(float, float)

    def __init__(self, workspace: Workspace, theme: Theme) -> None:
        super().__init__(tr("Scan"), tr("The CT stack that the grains are found in."))
        self._workspace = workspace
        self.open_button = primary_button(tr("Open scan…"))
        self.sample_button = QPushButton(tr("Try the sample"))
        self.sample_button.setToolTip(
            tr("A synthetic scan of grains in contact, which mbstudio makes itself")
        )
        self._facts = QWidget()
        grid = QGridLayout(self._facts)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setVerticalSpacing(7)
        grid.setColumnStretch(1, 1)
        self._values: dict[str, QLabel] = {}
        for number, name in enumerate(_FACTS):
            value = label("", "value", wrap=True)
            value.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            value.setAlignment(Qt.AlignmentFlag.AlignRight)
            grid.addWidget(label(tr(name), "key"), number, 0, Qt.AlignmentFlag.AlignTop)
            grid.addWidget(value, number, 1)
            self._values[name] = value
        self.histogram = Histogram(theme, tr("Histogram of grey values, the count on a log scale"))
        self.range = QDoubleRangeSlider(Qt.Orientation.Horizontal)
        self.range.setToolTip(tr("Grey values shown black and white"))
        self.range.setAccessibleName(tr("Grey values shown black and white"))
        self._range_text = label("", "hint")
        self.sliders = {axis: SliceSlider(axis, tr(_FRAMES[axis])) for axis in AXES}
        self._empty = label(
            tr(
                "No scan yet. Open a TIFF stack, a folder of slices, or a RAW, NPY, NRRD or MetaImage file – "
                "or drop one onto the window. The sample shows every step without a file of your own."
            ),
            "hint",
            wrap=True,
        )

        self.add(self._empty)
        self._shown_with_scan: list[QWidget] = [self._facts]
        self.add(self._facts)
        self._group(tr("Grey values"), self.histogram, self.range, self._range_text)
        self._group(tr("Slices"), *self.sliders.values())
        self.body.addStretch(1)
        self.foot.addWidget(self.open_button)
        self.foot.addWidget(self.sample_button)

        self.range.valueChanged.connect(self._range_moved)
        for axis, slider in self.sliders.items():
            slider.moved.connect(lambda index, name=axis: self.slice_moved.emit(name, index))
            slider.switched.connect(lambda shown, name=axis: self.slice_switched.emit(name, shown))
        workspace.scan_changed.connect(self.refresh)
        self.refresh()

    def _group(self, title: str, *widgets: QWidget) -> None:
        heading = label(title, "heading")
        self.body.addSpacing(6)
        self.add(heading, *widgets)
        self._shown_with_scan.extend((heading, *widgets))

    def show_window(self, low: float, high: float) -> None:
        """Take the grey values that the view shows, silently."""
        self.range.blockSignals(True)
        self.range.setValue((low, high))
        self.range.blockSignals(False)
        self._write_range(low, high)

    def refresh(self) -> None:
        """Show the scan of the workspace."""
        scan, reference = self._workspace.scan, self._workspace.state.scan
        self._empty.setVisible(reference is None)
        self._facts.setVisible(reference is not None)
        for widget in self._shown_with_scan[1:]:
            widget.setVisible(scan is not None)
        if reference is not None:
            self._values["File"].setText(reference.path.name if reference.path else tr("made by mbstudio"))
            self._values["File"].setToolTip(str(reference.path or ""))
            self._values["Voxels"].setText(
                " × ".join(f"{count}" for count in reference.shape) + "  (z, y, x)"
            )
            self._values["Voxel size"].setText(str(reference.voxel_size))
            extent = (n * edge for n, edge in zip(reference.shape, reference.voxel_size.zyx, strict=True))
            self._values["Size"].setText(
                " × ".join(readable_length(length, reference.voxel_size.unit) for length in extent)
            )
            self._values["Grey values"].setText(reference.dtype)
            size = int(np.prod(reference.shape)) * np.dtype(reference.dtype).itemsize
            memory = f"{size / 2**20:,.1f} MB"
            if scan is not None and scan.is_memory_mapped:
                memory = tr("{size}, read from disk as needed", size=memory)
            self._values["Memory"].setText(memory)
        if scan is not None:
            self._show_scan(scan)

    def _show_scan(self, scan: Scan) -> None:
        values = sample_of_voxels(scan)
        self.histogram.set_values(values, bins=96, log=True)
        low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
        self.range.blockSignals(True)
        self.range.setRange(low, high if high > low else low + 1.0)
        self.range.blockSignals(False)
        for axis, count in zip(AXES, scan.shape[::-1], strict=True):
            self.sliders[axis].set_count(count, count // 2)

    def _range_moved(self, values: tuple[float, float]) -> None:
        self._write_range(*values)
        self.window_changed.emit(*values)

    def _write_range(self, low: float, high: float) -> None:
        self._range_text.setText(tr("Black {black}   ·   white {white}", black=_grey(low), white=_grey(high)))


def _grey(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
