"""The panel of station Packing: what is packed and how, how it is looked at, and its numbers."""

from __future__ import annotations

import math

from PySide6.QtCore import QRectF, QSignalBlocker, Signal
from PySide6.QtGui import QColor, QLinearGradient, QPainter, QPaintEvent
from PySide6.QtWidgets import QComboBox, QDoubleSpinBox, QHBoxLayout, QPushButton, QSpinBox, QWidget

from mbstudio.core.packing.mould import SHAPES
from mbstudio.core.units import unit_label
from mbstudio.scene.packed_grains import COLOURED_BY, ramp_anchors
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.packing.plots import kind_name
from mbstudio.ui.stations.packing.work import SECONDS_A_GRAIN, SUBJECTS, PackingWork, PackRequest
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.widgets.forms import NumberSlider, label, primary_button, row
from mbstudio.ui.widgets.numbers import four_digits, readable_time

_SUBJECTS = {
    "parents": mark("Avatars of the grains"),
    "clones": mark("Clones"),
    "spheres": mark("Spheres of their volumes"),
    "all": mark("All of them, compared"),
}
_MOULDS = {"box": mark("Box"), "cylinder": mark("Cylinder")}
_COLOURS = {
    "size": mark("Size"), "coordination": mark("Coordination"), "force": mark("Force"),
    "overlap": mark("Overlap"),
}  # fmt: skip
_WIDE = 190


class ColourBar(QWidget):
    """The colours of the grains from the least to the largest."""

    def __init__(self) -> None:
        super().__init__()
        self.setFixedHeight(10)
        self.setAccessibleName(tr("Colours of the grains"))

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter, ramp = QPainter(self), ramp_anchors()
        gradient = QLinearGradient(0, 0, self.width(), 0)
        for place, colour in enumerate(ramp):
            gradient.setColorAt(place / (len(ramp) - 1), QColor(colour))
        painter.fillRect(QRectF(self.rect()), gradient)
        painter.end()


class PackingPanel(Panel):
    """Asks for a packing, and shows what came of it.

    Attributes
    ----------
    look_changed : signal
        Grains are to be coloured by something else, or those of another kind shown.
    cut_moved : signal (float)
        Which share of the packing is to be cut away.
    """

    look_changed = Signal()
    cut_moved = Signal(float)

    def __init__(self, work: PackingWork) -> None:
        super().__init__(tr("Packing"), tr("Pour grains into a mould, and see and measure how they settle."))
        self._work = work
        self._subject_fields()
        self._view_fields()
        self.body.addStretch(1)
        self._hint = label("", "hint", wrap=True)
        self.pack_button = primary_button(tr("Pack"))
        self.pause_button, self.cancel_button = QPushButton(tr("Pause")), QPushButton(tr("Cancel"))
        self.export_button = QPushButton(tr("Export…"))
        line = QHBoxLayout()
        line.addWidget(self.pack_button, 1)
        for button in (self.pause_button, self.cancel_button, self.export_button):
            line.addWidget(button)
        self.foot.addWidget(self._hint)
        self.foot.addLayout(line)
        work.changed.connect(self.refresh)
        work.run.reported.connect(self._write_hint)
        for field in (self.subject, self.mould):
            field.currentIndexChanged.connect(self._write_hint)
        for box in (self.count, self.seeds, self.seed, self.spheres, self.friction):
            box.valueChanged.connect(self._write_hint)
        self.show_ends("size", float("nan"), float("nan"), "")
        self.refresh()

    def _subject_fields(self) -> None:
        self.subject, self.mould = QComboBox(), QComboBox()
        for name in SHAPES:
            self.mould.addItem(tr(_MOULDS[name]), name)
        self.count, self.seeds, self.seed, self.spheres = (QSpinBox() for _ in range(4))
        for box, low, high, value in (
            (self.count, 2, 5000, 200), (self.seeds, 1, 20, 1), (self.seed, 0, 1_000_000, 0),
            (self.spheres, 2, 200, 20),
        ):  # fmt: skip
            box.setRange(low, high)
            box.setValue(value)
        self.friction = QDoubleSpinBox()
        self.friction.setRange(0.0, 2.0)
        self.friction.setSingleStep(0.1)
        self.friction.setDecimals(2)
        self.friction.setValue(0.5)
        self.add(
            row(tr("Grains of"), self.subject, tr("What is packed; each form is taken equally often")),
            row(tr("Grains"), self.count, tr("Number of grains of each packing")),
            row(
                tr("Friction"), self.friction, tr("Coefficient between grains, and between grains and mould")
            ),
            row(tr("Mould"), self.mould, tr("About as wide as the settled grains are high")),
            row(tr("Packings"), self.seeds, tr("Packings of each kind; two or more give a standard error")),
            row(tr("First seed"), self.seed, tr("The same seed gives the same packing")),
            row(tr("Spheres a grain"), self.spheres, tr("Spheres of the clumps by which grains touch")),
        )
        for field in (self.subject, self.mould):
            field.setFixedWidth(_WIDE)

    def _view_fields(self) -> None:
        self.kind, self.colour = QComboBox(), QComboBox()
        for name in COLOURED_BY:
            self.colour.addItem(tr(_COLOURS[name]), name)
        self.cut = NumberSlider(
            tr("Cut open"), 0.0, 0.95, 0.0, 0.05, "{:.0%}", tr("How much is cut away from the front")
        )
        self.bar = ColourBar()
        self._low, self._high = label("", "hint"), label("", "hint")
        ends = QWidget()
        line = QHBoxLayout(ends)
        line.setContentsMargins(0, 0, 0, 0)
        line.addWidget(self._low, 1)
        line.addWidget(self._high)
        self._ends = ends
        self._kind_row = row(tr("Show"), self.kind, tr("Which of the packings is shown"))
        self.add_heading(tr("View"))
        self.add(
            self._kind_row,
            row(tr("Colour by"), self.colour, tr("What the colours of the grains tell")),
            self.bar,
            ends,
            self.cut,
        )
        for field in (self.kind, self.colour):
            field.setFixedWidth(_WIDE)
            field.currentIndexChanged.connect(self.look_changed)
        self.cut.value_changed.connect(self.cut_moved)

    # ---- what was chosen -------------------------------------------------------------------------

    @property
    def asked(self) -> PackRequest:
        """The packing that the fields ask for."""
        subject = str(self.subject.currentData() or "")
        seeds = self.seeds.value()
        if subject == "all":
            seeds = max(2, seeds)
        return PackRequest(
            subject, self.count.value(), self.friction.value(), str(self.mould.currentData()), seeds,
            self.seed.value(), self.spheres.value(),
        )  # fmt: skip

    @property
    def colour_by(self) -> str:
        """What the grains are coloured by."""
        return str(self.colour.currentData())

    @property
    def kind_shown(self) -> str:
        """Name of the kind whose packing is shown; empty without one."""
        return str(self.kind.currentData() or "")

    @property
    def is_ready(self) -> bool:
        """Whether there is something to pack."""
        return self.subject.count() > 0 and not self._work.run.is_running

    # ---- keeping in step -------------------------------------------------------------------------

    def refresh(self) -> None:
        """Offer what there is to pack and to look at, and what can be done now."""
        there = [name for name in SUBJECTS if name in self._work.subjects]
        _fill(self.subject, there, [tr(_SUBJECTS[name]) for name in there])
        trial = self._work.trial
        names = [] if trial is None else list(trial.packings)
        _fill(self.kind, names, [kind_name(name) for name in names])
        self._kind_row.setVisible(len(names) > 1)
        running = self._work.run.is_running
        self.pack_button.setText(tr("Pack again") if trial is not None else tr("Pack"))
        self.pause_button.setText(tr("Resume") if self._work.run.is_paused else tr("Pause"))
        for button, shown in (
            (self.pack_button, not running), (self.export_button, not running),
            (self.pause_button, running), (self.cancel_button, running),
        ):  # fmt: skip
            button.setVisible(shown)
        self._write_hint()

    def show_ends(self, by: str, low: float, high: float, unit: str) -> None:
        """Say what the two ends of the colours are."""
        known = math.isfinite(low) and math.isfinite(high)
        self._ends.setVisible(known)
        self.bar.setVisible(known)
        if by == "coordination":
            words = [
                plural(int(end), mark("{count} contact"), mark("{count} contacts")) for end in (low, high)
            ]
        elif by == "force":
            words = [tr("{value} m g", value=four_digits(end)) for end in (low, high)]
        elif by == "overlap":
            words = [tr("{value} % of D", value=four_digits(100 * end)) for end in (low, high)]
        else:
            words = [f"{four_digits(end)} {unit_label(unit)}" for end in (low, high)]
        if known:
            self._low.setText(words[0])
            self._high.setText(words[1])

    def _write_hint(self, *_: object) -> None:
        work, asked = self._work, self.asked
        if work.run.is_running:
            self._hint.setText(work.run.state())
            return
        if not self.subject.count():
            self._hint.setText(tr("There is nothing to pack yet: fit avatars (station Fit) or make clones."))
            return
        kinds = len(work.subjects) - 1 if asked.subject == "all" else 1
        seconds = SECONDS_A_GRAIN * asked.count * asked.seeds * kinds * asked.spheres / 20
        packings = asked.seeds * kinds
        self._hint.setText(
            plural(
                packings,
                mark("{count} packing of {grains} grains: about {time} on this kind of machine, or more."),
                mark("{count} packings of {grains} grains: about {time} on this kind of machine, or more."),
                grains=asked.count,
                time=readable_time(seconds),
            )
        )


def _fill(field: QComboBox, names: list[str], titles: list[str]) -> None:
    """Offer names, keeping what was chosen."""
    if [field.itemData(place) for place in range(field.count())] == names:
        return
    chosen = field.currentData()
    with QSignalBlocker(field):
        field.clear()
        for name, title in zip(names, titles, strict=True):
            field.addItem(title, name)
        field.setCurrentIndex(max(0, field.findData(chosen)) if names else -1)
