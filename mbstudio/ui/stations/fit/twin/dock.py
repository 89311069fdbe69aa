"""The twin in the window: how its fit goes on, its contacts, its fabric."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QImage, QPixmap
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QStackedWidget,
    QTabBar,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.core.units import unit_label
from mbstudio.scene.layers.contact_network import MEASURES, Measure
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.fit.twin.contact_table import ContactTable
from mbstudio.ui.stations.fit.twin.work import TwinWork
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label, primary_button, scrolling
from mbstudio.ui.widgets.plots import Plot
from mbstudio.ui.workspace import Workspace


class MisfitCurve(Plot):
    """The misfit near the surfaces at the start and after each sweep."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, tr("Sweep"), tr("Misfit (%)"), tr("Misfit after each sweep"))
        self.setFixedHeight(160)
        self._line = self.plot([], [], symbol="o", symbolSize=7)
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self.getAxis("bottom").setTickSpacing(1, 1)  # sweeps are whole
        self.getViewBox().setMouseEnabled(x=False, y=False)
        self.repaint_theme()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        accent = self._theme.tokens.accent
        self._line.setPen(pg.mkPen(accent, width=2))
        self._line.setSymbolBrush(pg.mkBrush(accent))
        self._line.setSymbolPen(pg.mkPen(self._theme.tokens.surface, width=1))

    def show_misfits(self, misfits: list[float]) -> None:
        """Draw misfits in contrasts, the first that of the start."""
        values = 100 * np.asarray(misfits, dtype=float)
        self._line.setData(np.arange(len(values)), values)
        self.setXRange(-0.15, max(4, len(values) - 1) + 0.15, padding=0)
        if len(values):
            room = max(0.15 * float(np.ptp(values)), 0.1)
            self.setYRange(float(values.min()) - room, float(values.max()) + room, padding=0)


class Picture(QLabel):
    """A figure as a picture, as large as there is room."""

    resized = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self.setMinimumSize(QSize(120, 100))
        self.setAccessibleName(tr("Fabric of the contacts"))
        self._whole = QPixmap()
        self.installEventFilter(self)

    def show_pixels(self, pixels: np.ndarray | None) -> None:
        """Show red, green and blue, shape (h, w, 3); None for nothing."""
        self._whole = QPixmap()
        if pixels is not None:
            height, width, _ = pixels.shape
            image = QImage(pixels.tobytes(), width, height, 3 * width, QImage.Format.Format_RGB888)
            self._whole = QPixmap.fromImage(image)
        self._fit()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self and event.type() == QEvent.Type.Resize:
            self._fit()
        return super().eventFilter(watched, event)

    def _fit(self) -> None:
        if self._whole.isNull():
            self.setPixmap(QPixmap())
            return
        ratio = self.devicePixelRatioF()
        shown = self._whole.scaled(
            self.size() * ratio,
            Qt.AspectRatioMode.KeepAspectRatio,
            Qt.TransformationMode.SmoothTransformation,
        )
        shown.setDevicePixelRatio(ratio)
        self.setPixmap(shown)


class TwinDock(QFrame):
    """Buttons and misfit above, contacts and fabric below.

    Attributes
    ----------
    measure_changed : signal (str)
        By what the network is coloured.
    residual_switched : signal (bool)
    page_turned : signal
        Another page is looked at.
    """

    measure_changed = Signal(str)
    residual_switched = Signal(bool)
    page_turned = Signal()

    def __init__(self, workspace: Workspace, work: TwinWork, theme: Theme, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumWidth(330)
        self._workspace, self._work = workspace, work
        self._told: KeptTwin | None = None
        self.start_button = primary_button(tr("Fit the twin"))
        self.pause_button, self.stop_button = QPushButton(tr("Pause")), QPushButton(tr("Stop and keep"))
        self.cancel_button = QPushButton(tr("Cancel"))
        self.state = label("", "hint", wrap=True)
        self.curve = MisfitCurve(theme)
        self.facts = label("", "hint", wrap=True)
        self.optics, self.notes = label("", "hint", wrap=True), label("", "refusal", wrap=True)
        self.tensors = label("", "hint", wrap=True)
        self.residual = QCheckBox(tr("Residual over the slices"))
        self.residual.setChecked(True)
        self.residual.setToolTip(
            tr(
                "Where the scan is brighter (red) or darker (blue) than the twin; the colour is full at a "
                "quarter of the contrast. Kept until the program ends"
            )
        )
        self.measure = QComboBox()
        for name, title in MEASURES.items():
            self.measure.addItem(tr(title), name)
        self.measure.setAccessibleName(tr("Colour of the contact network"))
        self.measure.setToolTip(tr("By what the contact network in the view is coloured"))
        self.near = QCheckBox(tr("Near misses too"))
        self.near.setToolTip(tr("List pairs less than a voxel apart that are probably no contacts, too"))
        self.export_button = QToolButton()
        icons.set(self.export_button, "ph.download-simple")
        self.export_button.setAccessibleName(tr("Export contacts"))
        self.table = ContactTable()
        self.picture = Picture()
        self.tabs, self.stack = QTabBar(), QStackedWidget()
        self._layout()
        self._connect()
        self.refresh()

    def _layout(self) -> None:
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("What is shown of the twin"))
        self._network = label(tr("Network by"), "key")
        colour, buttons, pages = QHBoxLayout(), QHBoxLayout(), QHBoxLayout()
        colour.addWidget(self._network)
        colour.addWidget(self.measure, 1)
        self.tensors.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        fit, contacts, fabric = QWidget(), QWidget(), QWidget()
        for title, page, parts in (
            (tr("Fit"), fit, (self.curve, self.optics, self.notes, self.residual)),
            (tr("Contacts"), contacts, (colour, self.near, self.table)),
            (tr("Fabric"), fabric, (self.picture, self.tensors)),
        ):
            inner = QVBoxLayout(page)
            inner.setContentsMargins(0, 6, 0, 0)
            inner.setSpacing(6)
            for part in parts:
                if isinstance(part, QWidget):
                    inner.addWidget(part, 100 if part in (self.table, self.picture) else 0)
                else:
                    inner.addLayout(part)
            inner.addStretch(1)
            self.tabs.addTab(title)
            # Of its parts none may be squeezed where the slices below take their room.
            self.stack.addWidget(scrolling(page) if page is fit else page)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(14, 4, 14, 10)
        layout.setSpacing(6)
        for button in (self.start_button, self.pause_button, self.stop_button, self.cancel_button):
            buttons.addWidget(button, 1)
        layout.addLayout(buttons)
        for widget in (self.state, self.facts):
            layout.addWidget(widget)
        pages.addWidget(self.tabs, 1)
        pages.addWidget(self.export_button)
        layout.addLayout(pages)
        layout.addWidget(self.stack, 100)
        layout.addStretch(1)

    def _connect(self) -> None:
        self.measure.currentIndexChanged.connect(lambda _: self.measure_changed.emit(self.chosen_measure))
        self.residual.toggled.connect(self.residual_switched)
        self.near.toggled.connect(lambda _: self._show_twin())
        self.tabs.currentChanged.connect(self._turn)
        self._work.changed.connect(self.refresh)
        self._work.run.reported.connect(self._show_state)
        self._work.moved.connect(lambda: self.curve.show_misfits(self._work.misfits))
        self._work.run.changed.connect(self._follow)
        self._work.finished.connect(lambda: self.tabs.setCurrentIndex(1))
        self._workspace.state_changed.connect(self.refresh)

    @property
    def chosen_measure(self) -> Measure:
        """By what the network is coloured."""
        found: Measure = self.measure.currentData()
        return found

    @property
    def shows_fabric(self) -> bool:
        """Whether the page of the fabric is looked at."""
        return self.tabs.currentIndex() == 2

    def _follow(self) -> None:
        """Show how the fit goes on while it runs."""
        if self._work.run.is_running:
            self.tabs.setCurrentIndex(0)

    def _turn(self, page: int) -> None:
        self.stack.setCurrentIndex(page)
        self.page_turned.emit()

    def refresh(self) -> None:
        """Show what runs and what there is."""
        run = self._work.run
        for button in (self.pause_button, self.stop_button, self.cancel_button):
            button.setVisible(run.is_running)
        self.start_button.setVisible(not run.is_running)
        self.pause_button.setText(tr("Resume") if run.is_paused else tr("Pause"))
        self.start_button.setText(
            tr("Fit the twin again") if self._workspace.state.twin is not None else tr("Fit the twin")
        )
        self._show_state()
        self._show_twin()

    def _show_state(self) -> None:
        words = self._work.run.state()
        if not words and self._workspace.state.twin is None:
            words = tr(
                "Fits the avatars of all grains together to the grey values of the scan, and finds where "
                "they touch. Avatars that there are already are where it starts."
            )
        self.state.setText(words)
        self.state.setVisible(bool(words))

    def _show_twin(self) -> None:
        twin = self._workspace.state.twin
        has = twin is not None
        self.facts.setVisible(has)
        for widget in (self.tabs, self.stack):
            widget.setVisible(has or self._work.run.is_running)
        self.export_button.setVisible(has)
        self.residual.setEnabled(self._work.has_residual)
        for place in (1, 2):
            self.tabs.setTabEnabled(place, has)
        self.notes.setText("\n".join(twin.notes) if twin is not None else "")
        self.notes.setVisible(bool(twin is not None and twin.notes))
        if twin is not self._told:
            self._told = twin
            self.facts.setText("" if twin is None else _facts_of(twin))
            self.optics.setText("" if twin is None else _optics_of(twin))
            self.tensors.setText("" if twin is None else _tensors_of(twin))
        with QSignalBlocker(self.table.selectionModel()):
            self.table.show_twin(twin, self.near.isChecked())


def _facts_of(twin: KeptTwin) -> str:
    counts = dict.fromkeys(twin.avatars, 0)
    for column in ("a", "b"):
        for one in twin.touching[column].tolist():
            counts[one] += 1
    whole = [count for one, count in counts.items() if one not in twin.cut]
    parts = [
        plural(len(twin.avatars), mark("{count} grain"), mark("{count} grains")),
        plural(len(twin.touching), mark("{count} contact"), mark("{count} contacts")),
    ]
    if whole:
        parts.append(tr("{mean:.2f} contacts a whole grain", mean=float(np.mean(whole))))
    parts.append(tr("porosity {share:.1f} %", share=100 * twin.porosity.whole))
    return tr("{facts}. Lengths in {unit}.", facts=" · ".join(parts), unit=unit_label(twin.unit))


def _optics_of(twin: KeptTwin) -> str:
    models = {"constant": tr("constant"), "linear": tr("linear"), "quadratic": tr("quadratic")}
    return tr(
        "Blur {blur:.3g} {unit}, noise {noise:.1f} % of the contrast, tones {tones}, void level {void}. The "
        "misfit is the median over the grains of scan less model near the surface.",
        blur=twin.blur,
        unit=unit_label(twin.unit),
        noise=100 * twin.noise,
        tones=models[twin.tone_model],
        void=models[twin.void_model],
    )


def _tensors_of(twin: KeptTwin) -> str:
    """Return the principal values of the tensors, and how anisotropic they are."""
    if not len(twin.touching):
        return tr("There is no contact.")
    fabric = twin.fabric()
    lines = []
    named = (
        (tr("Normals"), fabric.normal),
        (tr("Branches"), fabric.branch),
        (tr("Long axes"), fabric.long_axis),
    )
    for name, tensor in named:
        if tensor is not None:
            low, high = tensor.anisotropy_interval
            lines.append(
                tr(
                    "{name}: {first:.3f}, {second:.3f}, {third:.3f}; anisotropy {value:.2f} "
                    "[{low:.2f}, {high:.2f}]",
                    name=name,
                    first=tensor.values[0],
                    second=tensor.values[1],
                    third=tensor.values[2],
                    value=tensor.anisotropy,
                    low=low,
                    high=high,
                )
            )
    return "\n".join(lines)
