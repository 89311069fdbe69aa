"""Station Grains: how they are told apart, and what was found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QLineEdit,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.batch.memory_estimate import need_of_segmentation
from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.grains import GrainSet
from mbstudio.core.grains.grey_ranges import read_ranges, write_ranges
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.grains.verdict import CRITERIA, SegmentationVerdict
from mbstudio.core.memory import readable_bytes
from mbstudio.core.units import unit_label
from mbstudio.scene.layers.annotations import readable_length
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.grains.work import words_of
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.factor_words import factor_label
from mbstudio.ui.widgets.forms import NumberSlider, badge, label, primary_button, quiet_button, row, set_badge
from mbstudio.ui.widgets.grey_histogram import GreyHistogram
from mbstudio.ui.widgets.plots import Histogram
from mbstudio.ui.workspace import Workspace


class GrainPanel(Panel):
    """Settings of the segmentation, and a summary of its grains.

    Parameters
    ----------
    workspace : Workspace
    theme : Theme
    suspicion : QWidget, optional
        Card of the suspicious grains, put below the verdict.
    """

    def __init__(self, workspace: Workspace, theme: Theme, suspicion: QWidget | None = None) -> None:
        super().__init__(tr("Grains"), tr("Separate the grains from the pores and from each other."))
        self._workspace = workspace
        default = SegmentationSettings()
        self._make_settings(default, theme)
        self._learning_box: QWidget | None = None
        self._make_result(theme)
        self._tools: QWidget | None = None
        if suspicion is not None:
            self._under_verdict.addWidget(suspicion)
        self.body.addStretch(1)
        self._make_foot()
        self.threshold_kind.currentIndexChanged.connect(self._threshold_kind_changed)
        self.threshold.valueChanged.connect(lambda value: self.greys.set_threshold(value))
        workspace.fits_changed.connect(self.tell_memory)
        workspace.grains_changed.connect(self.refresh)
        workspace.scan_changed.connect(self.refresh)
        workspace.settings_changed.connect(self._take_settings)
        self.show_settings(default)
        self.refresh()

    def _make_settings(self, default: SegmentationSettings, theme: Theme) -> None:
        self.smoothing = QDoubleSpinBox()
        self.smoothing.setRange(0.0, 5.0)
        self.smoothing.setSingleStep(0.1)
        self.smoothing.setDecimals(1)
        self.threshold_kind = QComboBox()
        self.threshold_kind.addItem(tr("Automatic"), "")
        self.threshold_kind.addItem(tr("By hand"), "threshold")
        self.threshold_kind.addItem(tr("Ranges"), "ranges")
        self.threshold_kind.addItem(tr("From strokes"), "classifier")
        self.ranges = QLineEdit()
        self.ranges.setPlaceholderText("90:140, 200:255")
        self.tone = QComboBox()
        self.tone.addItem(tr("Automatic"), None)
        self.tone.addItem(tr("Brighter than the pores"), False)
        self.tone.addItem(tr("Darker than the pores"), True)
        self.threshold = QDoubleSpinBox()
        self.threshold.setRange(-1e9, 1e9)
        self.threshold.setDecimals(1)
        self._make_more(default, theme)
        self._settings = QWidget()
        fields = QVBoxLayout(self._settings)
        fields.setContentsMargins(0, 0, 0, 0)
        fields.setSpacing(10)
        self._smoothing_row = row(
            tr("Smoothing"),
            self.smoothing,
            tr("Standard deviation of the Gaussian filter before the threshold; 0: none"),
            tr("voxels"),
        )
        self._tone_row = row(
            tr("Grains are"), self.tone, tr("Automatic: the side whose surface is mostly convex")
        )
        for field in (
            self._smoothing_row,
            self._tone_row,
            row(
                tr("Threshold"),
                self.threshold_kind,
                tr(
                    "Grey value that separates grains from pores; automatic: half-way between the grey "
                    "values on both sides of their surfaces, which may vary from place to place"
                ),
            ),
        ):
            fields.addWidget(field)
        self._threshold_row = row(
            tr("Grey value"), self.threshold, tr("Voxels at least this bright are grain")
        )
        self._ranges_row = row(
            tr("Grey values"), self.ranges, tr("Voxels in one of these ranges are grain: low:high, low:high")
        )
        smallest = row(
            tr("Smallest grain"), self.smallest, tr("Pieces with fewer voxels are discarded"), tr("voxels")
        )
        self.learning = QVBoxLayout()
        self.learning.setContentsMargins(0, 0, 0, 0)
        fields.addWidget(self._threshold_row)
        fields.addWidget(self.greys)
        fields.addWidget(self._ranges_row)
        fields.addLayout(self.learning)
        self.preview_button = quiet_button(tr("Preview the splitting"))
        for more in (self.splitting, self.preview_button, smallest, self.drop_border):
            fields.addWidget(more)
        self.add(self._settings)

    def _make_more(self, default: SegmentationSettings, theme: Theme) -> None:
        """Make the histogram, and what grains are parted by."""
        self.greys = GreyHistogram(theme)
        self.greys.dragged.connect(self._threshold_dragged)
        self.splitting = NumberSlider(
            tr("Split touching grains"),
            0.0,
            1.0,
            default.splitting,
            0.01,
            "{:.2f}",
            tr(
                "How strongly touching grains are split: too low a value merges grains, too high a value "
                "breaks them"
            ),
            (tr("less"), tr("more")),
        )
        self.smallest = QSpinBox()
        self.smallest.setRange(1, 1_000_000)
        self.drop_border = QCheckBox(tr("Leave out grains cut by the edge"))

    def add_learning(self, box: QWidget) -> None:
        """Put in what strokes are painted and learned with; it is seen where grains are told by them."""
        self._learning_box = box
        self.learning.addWidget(box)
        self._threshold_kind_changed()

    def _make_result(self, theme: Theme) -> None:
        self._count = label("", "figure")
        self._inside = label("", "hint", wrap=True)
        self.verdict = badge()
        self._doubts = label("", "hint", wrap=True)
        self._histogram_name = label("", "hint")
        self.histogram = Histogram(theme, tr("Histogram of nominal diameters"))
        self._result = QWidget()
        result = QVBoxLayout(self._result)
        result.setContentsMargins(0, 12, 0, 0)
        result.setSpacing(6)
        result.addWidget(label(tr("Found"), "heading"))
        line = QHBoxLayout()
        line.addWidget(self._count)
        line.addStretch(1)
        line.addWidget(self.verdict)
        result.addLayout(line)
        result.addWidget(self._inside)
        result.addWidget(self._doubts)
        self._under_verdict = QVBoxLayout()
        result.addLayout(self._under_verdict)
        result.addSpacing(6)
        result.addWidget(self._histogram_name)
        result.addWidget(self.histogram)
        self.add(self._result)

    def _make_foot(self) -> None:
        self.find_button = primary_button(tr("Find grains"))
        self.load_button = quiet_button(tr("Load labels…"))
        self.load_button.setToolTip(
            tr("Load a label image made with another program (such as ilastik), with the shape of the scan")
        )
        self.meshes_button = quiet_button(tr("Open meshes…"))
        self._hint = label("", "hint", wrap=True)
        line = QHBoxLayout()
        line.addWidget(self.load_button)
        line.addWidget(self.meshes_button)
        line.addStretch(1)
        self.foot.addWidget(self._hint)
        self.foot.addWidget(self.find_button)
        self.foot.addLayout(line)

    def settings(self) -> SegmentationSettings:
        """Return the settings as they stand in the panel; SegmentationError for ranges that are none."""
        kind = self.threshold_kind.currentData()
        return SegmentationSettings(
            denoise_sigma=self.smoothing.value(),
            threshold=self.threshold.value() if kind == "threshold" else None,
            ranges=read_ranges(self.ranges.text()) if kind == "ranges" else (),
            dark=self.tone.currentData() if kind != "classifier" else None,
            by_classifier=kind == "classifier",
            splitting=self.splitting.value,
            smallest_voxels=self.smallest.value(),
            drop_border=self.drop_border.isChecked(),
        )

    def show_settings(self, settings: SegmentationSettings) -> None:
        """Put settings into the fields."""
        self.smoothing.setValue(settings.denoise_sigma)
        kind = "ranges" if settings.ranges else "threshold" if settings.threshold is not None else ""
        kind = "classifier" if settings.by_classifier else kind
        self.threshold_kind.setCurrentIndex(self.threshold_kind.findData(kind))
        self.ranges.setText(write_ranges(settings.ranges))
        self.tone.setCurrentIndex((None, False, True).index(settings.dark))
        if settings.threshold is not None:
            self.threshold.setValue(settings.threshold)
        self.splitting.set_value(settings.splitting)
        self.smallest.setValue(settings.smallest_voxels)
        self.drop_border.setChecked(settings.drop_border)
        self._threshold_kind_changed()

    def add_tools(self, tools: QWidget) -> None:
        """Put the tools of the hand below what was found."""
        self._tools = tools
        self.body.insertWidget(self.body.indexOf(self._result) + 1, tools)
        self.refresh()

    def set_threshold_range(self, low: float, high: float) -> None:
        """Let the threshold lie within the scan's grey values."""
        self.threshold.setRange(low, high)
        self.threshold.setDecimals(0 if high - low > 50 else 3)
        self.threshold.setSingleStep(max((high - low) / 100, 0.001))
        if self.threshold_kind.currentData() != "threshold":
            self.threshold.setValue((low + high) / 2)

    def show_greys(self, counts: np.ndarray, edges: np.ndarray) -> None:
        """Show the histogram of the scan's grey values."""
        self.greys.set_counts(counts, edges)
        self.greys.set_threshold(self.threshold.value())

    def _threshold_dragged(self, value: float) -> None:
        self.threshold.setValue(value)

    def refresh(self) -> None:
        """Show the grains of the workspace."""
        grains = self._workspace.state.grains
        self._result.setVisible(grains is not None)
        of_meshes = grains is not None and grains.is_of_meshes
        # Bodies of meshes are told apart already.
        for widget in (self._settings, self.find_button, self.load_button):
            widget.setHidden(of_meshes)
        self._hint.setHidden(of_meshes)
        if self._tools is not None:
            self._tools.setVisible(grains is not None and not of_meshes)
        self.tell_memory()
        if grains is None:
            return
        self._count.setText(plural(len(grains), mark("{count:,} grain"), mark("{count:,} grains")))
        self._inside.setText(_words_of_meshes(grains) if of_meshes else _words_of_scan(grains))
        self._show_verdict(grains.verdict)
        diameters = nominal_diameters(grains.table["volume"].to_numpy(float))
        self._histogram_name.setText(f"{factor_label('dn')} [{unit_label(grains.unit)}]")
        self.histogram.set_values(diameters, bins=min(30, max(6, len(grains) // 4)))
        self.histogram.setVisible(len(grains) > 2)

    def _show_verdict(self, verdict: SegmentationVerdict | None) -> None:
        """Show how well the scan bears the grains out; the figures in a tool tip."""
        self.verdict.setVisible(verdict is not None)
        self._doubts.setVisible(verdict is not None and bool(verdict.doubts or verdict.edits))
        if verdict is None:
            return
        text, kind = {
            "green": (tr("● Sound"), "good"),
            "amber": (tr("▲ In doubt"), "amber"),
            "red": (tr("■ Unsound"), "bad"),
        }[verdict.level]
        set_badge(self.verdict, text, kind)
        self.verdict.setToolTip(_figures_table(verdict))
        self._doubts.setText("\n\n".join(filter(None, (verdict.edited_note, *verdict.described))))

    def tell_memory(self) -> None:
        """Say what finding the grains will take, and what is free where that is not plenty."""
        scan = self._workspace.scan
        if scan is None:
            self._hint.setText(tr("Open a scan first (station Scan), or the meshes of scanned stones."))
            return
        need = need_of_segmentation(scan)
        if need.is_worth_telling:
            words = tr("Finding the grains takes {need}.", need=words_of(need))
        else:
            words = tr(
                "Finding the grains takes about {needed} of memory.", needed=readable_bytes(need.needed, 2)
            )
        if self._workspace.state.fits:
            kept = tr(
                "Avatars stay where their grain does not change; you are asked before any is discarded."
            )
            words = f"{words} {kept}"
        self._hint.setText(words)

    def mark_grain(self, diameter: float | None) -> None:
        """Show where the chosen grain stands among the others."""
        self.histogram.mark(diameter)

    def _threshold_kind_changed(self) -> None:
        kind = self.threshold_kind.currentData()
        self._threshold_row.setVisible(kind == "threshold")
        self.greys.setVisible(kind == "threshold")
        for widget in (self._smoothing_row, self._tone_row):
            widget.setVisible(kind != "classifier")
        if self._learning_box is not None:
            self._learning_box.setVisible(kind == "classifier")
        self._ranges_row.setVisible(kind == "ranges")

    def _take_settings(self) -> None:
        if self._workspace.state.segmentation is not None:
            self.show_settings(self._workspace.state.segmentation)


def _words_of_scan(grains: GrainSet) -> str:
    inside = len(grains.interior_labels)
    return tr("{inside:,} inside the scan, {cut:,} cut by its edge", inside=inside, cut=len(grains) - inside)


def _words_of_meshes(grains: GrainSet) -> str:
    """Return where grains of meshes come from, and how finely they are taken."""
    files = [Path(str(file)) for file in grains.table["file"].unique()] if "file" in grains.table else []
    if len(files) == 1:
        words = [tr("From {name}.", name=files[0].name)]
    else:
        words = [
            plural(
                len(files) or len(grains),
                mark("From {count:,} mesh file."),
                mark("From {count:,} mesh files."),
            )
        ]
    edge = readable_length(grains.voxel_size.x, grains.unit)
    triangles = sum(len(mesh.faces) for mesh in grains.meshes.values())
    if triangles:
        words.append(
            tr(
                "Shown and measured as the files have them ({triangles:,} triangles); avatars are fitted to "
                "voxels of {edge}.",
                triangles=triangles,
                edge=edge,
            )
        )
    else:
        words.append(tr("Shown, measured and fitted as voxels of {edge}.", edge=edge))
    return " ".join(words)


def _figures_table(verdict: SegmentationVerdict) -> str:
    """Return the figures of a verdict as a table of a tool tip."""
    rows = []
    for criterion in CRITERIA:
        if criterion.name in verdict.figures:
            wanted = tr("should be {wanted}", wanted=criterion.wanted)
            figure = criterion.written(verdict.figures[criterion.name])
            title = tr(criterion.title)
            rows.append(
                f"<tr><td>{title}&nbsp;</td><td align=right>{figure}&nbsp;</td><td>({wanted})</td></tr>"
            )
    heading = tr("How well the scan bears the grains out")
    phases = plural(
        verdict.phases,
        mark("{count} phase; field of view: {view}"),
        mark("{count} phases; field of view: {view}"),
        view=verdict.view,
    )
    return f"<p>{heading}</p><table>{''.join(rows)}</table><p>{phases}</p>"
