"""Going through the suspicious grains: to the next, to the one before, accept."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QAbstractSpinBox, QApplication, QComboBox, QLineEdit, QPlainTextEdit

from mbstudio.core.grains.editing.records import Accept
from mbstudio.core.grains.suspicion.suspects import Suspect, ranked
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.grains.suspicion.work import SuspicionWork
from mbstudio.ui.studio import Studio

_FIELDS = (QAbstractSpinBox, QComboBox, QLineEdit, QPlainTextEdit)


class SuspicionTour(QObject):
    """Chooses one suspicious grain after the other.

    Parameters
    ----------
    studio : Studio
    work : SuspicionWork

    Attributes
    ----------
    changed : signal
        Another grain is looked at, or other grains are suspicious.
    arrived : signal
        The person went to a suspicious grain: it is to be brought before the eyes.
    """

    changed = Signal()
    arrived = Signal()

    def __init__(self, studio: Studio, work: SuspicionWork) -> None:
        super().__init__(studio)
        self._studio, self._space, self._work = studio, studio.workspace, work
        self._place: tuple[float, int] | None = None  # of the suspect visited last, in the order of the tour
        self._waiting: int = 0  # step that is to be made once something was found
        studio.offers.suspects_changed.connect(self._suspects_changed)
        self._space.selection_changed.connect(self._selection_changed)
        self._space.project_replaced.connect(self._forget)

    @property
    def suspects(self) -> list[Suspect]:
        """The suspicious grains that are still to be looked at, in their order."""
        grains = self._space.state.grains
        accepted = frozenset() if grains is None else grains.accepted_labels
        return ranked(self._studio.offers.suspects.values(), accepted)

    @property
    def current(self) -> Suspect | None:
        """What is known of the grain that is looked at; None if it was not scored yet."""
        selected = self._space.selected
        return None if selected is None else self._studio.offers.suspects.get(selected)

    @property
    def is_at_suspect(self) -> bool:
        """Whether the grain that is looked at is suspicious, and was not accepted."""
        one, grains = self.current, self._space.state.grains
        return (
            one is not None
            and grains is not None
            and one.is_suspicious
            and one.label not in grains.accepted_labels
        )

    # ---- going on ------------------------------------------------------------------------------

    def step(self, step: int) -> None:
        """Go to the next suspicious grain (1), or back (-1); look for them first if that was not done."""
        suspects = self.suspects
        if not suspects and self._work.missing:
            self._waiting = step
            self._work.look()
            self._studio.give_hint(tr("Looking for suspicious grains …"))
            return
        if not suspects:
            self._studio.say("info", tr("No grain is suspicious any more."))
            return
        self._go(suspects, step)

    def accept(self) -> None:
        """Accept the grain that is looked at and go to the next; it is not shown again until it changes."""
        one = self.current
        if one is None:
            return
        self._space.edit_grains(Accept(labels=(one.label,)), tr("Accept grain {label}", label=one.label))
        if self.suspects:
            self._go(self.suspects, 1)
        else:
            self._studio.say("success", tr("That was the last suspicious grain."))

    def accept_chosen(self) -> None:
        """Accept all chosen grains."""
        labels = tuple(sorted(self._space.chosen))
        if len(labels) == 1 and self.current is not None:
            self.accept()
        elif labels:
            title = plural(len(labels), mark("Accept a grain"), mark("Accept {count} grains"))
            self._space.edit_grains(Accept(labels=labels), title)

    @property
    def can_accept_by_key(self) -> bool:
        """Whether Enter accepts: at a suspicious grain, unless the person is writing into a field."""
        return self.is_at_suspect and not isinstance(QApplication.focusWidget(), _FIELDS)

    def _go(self, suspects: list[Suspect], step: int) -> None:
        order = [(-one.score, one.label) for one in suspects]
        selected = self._space.selected
        here = next(
            (place for place, one in zip(order, suspects, strict=True) if one.label == selected), None
        )
        place = here or self._place
        if place is None:
            number = 0 if step > 0 else len(order) - 1
        elif step > 0:
            number = next((k for k, other in enumerate(order) if other > place), 0)
        else:
            before = [k for k, other in enumerate(order) if other < place]
            number = before[-1] if before else len(order) - 1
        self._place = order[number]
        one = suspects[number]
        # With a part of a grain goes the rest of it, so that one key merges them.
        self._space.choose((one.label, one.neighbour) if one.kind == "split" else (one.label,), one.label)
        self.arrived.emit()
        self._studio.give_hint(self.proposal(one))

    # ---- in words --------------------------------------------------------------------------------

    def proposal(self, one: Suspect) -> str:
        """Return what a grain looks like, and what to do about it."""
        if one.kind == "merged":
            return tr("Grain {label} looks like several grains: split it (S).", label=one.label)
        return tr(
            "Grain {label} looks like a part of grain {other}: merge them (M).",
            label=one.label,
            other=one.neighbour,
        )

    # ---- keeping in step -------------------------------------------------------------------------

    def _suspects_changed(self) -> None:
        if self._waiting and self.suspects:
            step, self._waiting = self._waiting, 0
            self._go(self.suspects, step)
        elif self._waiting and not self._work.is_running:
            self._waiting = 0
            self._studio.give_hint("")
        self.changed.emit()
        self._studio.refresh()

    def _selection_changed(self) -> None:
        self._waiting = 0  # the person has gone elsewhere meanwhile
        self.changed.emit()

    def _forget(self) -> None:
        self._place, self._waiting = None, 0
