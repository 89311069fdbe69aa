"""A, B and C: interpolation with its strip, and arithmetic with the equation in pictures."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QPushButton, QToolButton, QVBoxLayout, QWidget

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label, rule
from mbstudio.ui.widgets.grain_strip import GrainSlot
from mbstudio.ui.widgets.value_slider import ValueSlider

LETTERS = ("A", "B", "C")
STRIP = (0.0, 0.25, 0.5, 0.75, 1.0)
_FRAME = 60  # milliseconds between two pictures of play
_FRAMES = 50  # from A to B


class BlendPage(QWidget):
    """What is made of two or three grains.

    Attributes
    ----------
    picked : signal (str, str)
        Letter, and name of the grain that was dropped; empty: the one selected on the shelf.
    share_moved, share_settled : signal (float)
        Between A (0) and B (1).
    strength_moved, strength_settled : signal (float)
        Of C + s (A - B).
    ghosts_changed : signal (bool)
    changed : signal
        Which of A, B and C there are, or whether the way from A to B is being played.
    """

    picked = Signal(str, str)
    share_moved = Signal(float)
    share_settled = Signal(float)
    strength_moved = Signal(float)
    strength_settled = Signal(float)
    ghosts_changed = Signal(bool)
    changed = Signal()

    def __init__(self, icons: Icons) -> None:
        super().__init__()
        self.slots = {
            letter: GrainSlot(
                letter,
                tr("Drop a grain here as {letter}, or click to use the selected one", letter=letter),
            )
            for letter in LETTERS
        }
        self.share = ValueSlider(tr("From A to B"), icons, tr("0 is A, 1 is B"), lock=False)
        self.share.set_range(0.0, 1.0, 0.5, decimals=2)
        self.strength = ValueSlider(
            tr("Strength s"), icons, tr("How much of the difference is added"), lock=False
        )
        self.strength.set_range(-2.0, 2.0, 0.0, decimals=2)
        self.strength.set_value(1.0)
        self.told = QCheckBox(tr("Follow the factors"))
        self.told.setChecked(True)
        self.told.setToolTip(
            tr(
                "The factors of C change by the difference between A and B; a plain sum of latent "
                "vectors is always rougher"
            )
        )
        self.ghosts = QCheckBox(tr("Show A and B as ghosts"))
        self.play, self.animation = QToolButton(), QPushButton(tr("Save animation…"))
        self.animation.setToolTip(
            tr(
                "Save the interpolation from A to B as GIF, numbered pictures or MP4, in steps of "
                "equal change"
            )
        )
        self.play.setToolTip(tr("Play the interpolation from A to B and back"))
        self.play.setAccessibleName(tr("Play"))
        self.play.setIconSize(QSize(20, 20))
        self._icons = icons
        icons.set(self.play, "ph.play-fill")
        self.strip = [GrainSlot("", tr("Show this step"), 52) for _ in STRIP]
        self.terms = {letter: GrainSlot("", letter, 52) for letter in (*LETTERS, "=")}
        self.apply = QPushButton(tr("Show the sum"))
        self._hint = label("", "hint", wrap=True)
        self._lay_out()
        self._beat = QTimer(self)
        self._beat.setInterval(_FRAME)
        self._beat.timeout.connect(self._step)
        self._direction = 1
        self._filled: set[str] = set()
        self._knows_meanings = False
        self._connect()
        self.set_ready(set(), False)

    def _lay_out(self) -> None:
        layout = QVBoxLayout(self)
        layout.setContentsMargins(14, 10, 14, 10)
        layout.setSpacing(8)
        slots = QHBoxLayout()
        slots.setSpacing(10)
        for slot in self.slots.values():
            slots.addWidget(slot)
        slots.addStretch(1)
        layout.addLayout(slots)
        layout.addWidget(self._hint)
        layout.addWidget(rule())
        line = QHBoxLayout()
        line.addWidget(self.share, 1)
        line.addWidget(self.play)
        layout.addLayout(line)
        strip = QHBoxLayout()
        strip.setSpacing(0)
        for slot in self.strip:
            slot.setFixedWidth(66)
            strip.addWidget(slot)
        strip.addStretch(1)
        layout.addLayout(strip)
        options = QHBoxLayout()
        options.addWidget(self.ghosts)
        options.addStretch(1)
        options.addWidget(self.animation)
        layout.addLayout(options)
        layout.addWidget(rule())
        layout.addWidget(label(tr("Arithmetic: C + s (A − B)"), "heading"))
        equation = QHBoxLayout()
        equation.setSpacing(0)
        for sign, key in (("", "C"), ("+ s (", "A"), ("−", "B"), (") =", "=")):
            if sign:
                text = QLabel(sign)
                text.setAlignment(Qt.AlignmentFlag.AlignCenter)
                equation.addWidget(text)
            self.terms[key].setFixedWidth(66)
            self.terms[key].setAcceptDrops(False)
            equation.addWidget(self.terms[key])
        equation.addStretch(1)
        layout.addLayout(equation)
        layout.addWidget(self.strength)
        foot = QHBoxLayout()
        foot.addWidget(self.told)
        foot.addStretch(1)
        foot.addWidget(self.apply)
        layout.addLayout(foot)
        layout.addStretch(1)

    def _connect(self) -> None:
        for letter, slot in self.slots.items():
            slot.clicked.connect(lambda letter=letter: self.picked.emit(letter, ""))
            slot.dropped.connect(lambda name, letter=letter: self.picked.emit(letter, name))
        for slot, share in zip(self.strip, STRIP, strict=True):
            slot.setAcceptDrops(False)
            slot.clicked.connect(lambda share=share: self._jump(share))
        self.share.moved.connect(self.share_moved)
        self.share.settled.connect(self.share_settled)
        self.strength.moved.connect(self.strength_moved)
        self.strength.settled.connect(self.strength_settled)
        self.told.toggled.connect(self._told_changed)
        self.ghosts.toggled.connect(self.ghosts_changed)

    def set_ready(self, filled: set[str], knows_meanings: bool) -> None:
        """Tell which of A, B and C are there; what cannot be done yet is greyed."""
        self._filled, self._knows_meanings = set(filled), knows_meanings
        for part in (self.share, self.ghosts):
            part.setEnabled(self.can_interpolate)
        self.strength.setEnabled(self.can_add)
        self.told.setEnabled(knows_meanings and set(LETTERS) <= filled)
        missing = [letter for letter in LETTERS if letter not in filled]
        self._hint.setText(
            tr(
                "Select a grain below and click {letters}, or drag it there.",
                letters=tr(" or ").join(missing),
            )
            if missing
            else ""
        )
        self._hint.setVisible(bool(missing))
        if not self.can_interpolate:
            self.stop()
        self.changed.emit()

    @property
    def can_interpolate(self) -> bool:
        """Whether A and B are there."""
        return {"A", "B"} <= self._filled

    @property
    def can_add(self) -> bool:
        """Whether A, B and C are there, and the meanings where the factors are to follow."""
        return set(LETTERS) <= self._filled and (self._knows_meanings or not self.told.isChecked())

    def set_grain(self, letter: str, name: str, picture: QPixmap | None) -> None:
        """Show which grain a letter stands for."""
        self.slots[letter].set_grain(name, picture)
        self.terms[letter].set_grain(letter, picture)

    def set_sum(self, picture: QPixmap | None) -> None:
        """Show what the equation gives."""
        self.terms["="].set_grain(tr("sum"), picture)

    def set_step(self, place: int, picture: QPixmap | None) -> None:
        """Show a step between A and B."""
        self.strip[place].set_grain(f"{STRIP[place]:g}", picture)

    def stop(self) -> None:
        """Stop playing without taking what is shown: something else was done."""
        if self._beat.isActive():
            self._beat.stop()
            self._show_playing()

    @property
    def is_playing(self) -> bool:
        """Whether the way from A to B is being played."""
        return self._beat.isActive()

    def add(self) -> None:
        """Show what the equation gives."""
        self.strength_settled.emit(self.strength.value)

    def _told_changed(self) -> None:
        if self.can_add:
            self.add()

    def _jump(self, share: float) -> None:
        if self.share.isEnabled():
            self.share.set_value(share)
            self.share_settled.emit(share)

    def play_way(self, on: bool) -> None:
        """Play the way from A to B and back, or stop and take what is shown."""
        if on and self.can_interpolate:
            self._beat.start()
            self._show_playing()
        elif self._beat.isActive():
            self.stop()
            self.share_settled.emit(self.share.value)

    def _show_playing(self) -> None:
        on = self.is_playing
        self._icons.set(self.play, "ph.pause-fill" if on else "ph.play-fill", "accent" if on else "muted")
        self.changed.emit()

    def _step(self) -> None:
        share = self.share.value + self._direction / _FRAMES
        if not 0.0 <= share <= 1.0:
            self._direction = -self._direction
            share = min(max(share, 0.0), 1.0)
        self.share.set_value(share)
        self.share_moved.emit(share)
