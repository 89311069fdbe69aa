"""The card of suspicious grains in the panel: how many are left, what the present one looks like, and why."""

from __future__ import annotations

from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.grains.suspicion.tour import SuspicionTour
from mbstudio.ui.stations.grains.suspicion.work import SuspicionWork
from mbstudio.ui.widgets.forms import label, quiet_button
from mbstudio.ui.workspace import Workspace


class SuspicionCard(QWidget):
    """Tells of the suspicious grains.

    Parameters
    ----------
    workspace : Workspace
    work : SuspicionWork
    tour : SuspicionTour

    Attributes
    ----------
    look_button, back_button, next_button, accept_button : QPushButton
    """

    def __init__(self, workspace: Workspace, work: SuspicionWork, tour: SuspicionTour) -> None:
        super().__init__()
        self._workspace, self._work, self._tour = workspace, work, tour
        self.count = label("", "hint", wrap=True)
        self.proposal = label("", "key", wrap=True)
        self.reasons = label("", "hint", wrap=True)
        self.look_button = quiet_button(tr("Look for suspicious grains"))
        self.back_button, self.next_button = QPushButton(tr("Back")), QPushButton(tr("Next"))
        self.accept_button = QPushButton(tr("Accept"))
        self._buttons = QWidget()
        line = QHBoxLayout(self._buttons)
        line.setContentsMargins(0, 0, 0, 0)
        line.setSpacing(8)
        for button in (self.back_button, self.next_button, self.accept_button):
            line.addWidget(button, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 8, 0, 0)
        layout.setSpacing(6)
        layout.addWidget(label(tr("Suspicious grains"), "heading"))
        for part in (self.count, self.proposal, self.reasons, self._buttons, self.look_button):
            layout.addWidget(part)
        tour.changed.connect(self.refresh)
        workspace.grains_changed.connect(self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show what is known now."""
        suspects, missing = self._tour.suspects, len(self._work.missing)
        self.count.setText(self._words(len(suspects), missing))
        self.look_button.setVisible(bool(missing) and not self._work.is_running)
        self._buttons.setVisible(bool(suspects))
        at = self._tour.current if self._tour.is_at_suspect else None
        for part, text in (
            (self.proposal, "" if at is None else self._tour.proposal(at)),
            (self.reasons, "" if at is None else _as_sentence(at.reasons)),
        ):
            part.setText(text)
            part.setVisible(bool(text))

    def _words(self, count: int, missing: int) -> str:
        if self._work.is_running:
            share = tr("{share:.0%} of the grains looked at.", share=self._work.fraction)
            found = plural(
                count, mark("{count} is suspicious so far."), mark("{count} are suspicious so far.")
            )
            return f"{share} {found}"
        grains = self._workspace.state.grains
        if grains is not None and missing == len(grains):
            return tr("Grains that are probably several, or parts of one, so that you see them first (N).")
        left = plural(
            count,
            mark("{count} grain is still to be looked at."),
            mark("{count} grains are still to be looked at."),
        )
        if not missing:
            return left
        unknown = plural(
            missing,
            mark("{count} grain was not scored since it changed."),
            mark("{count} grains were not scored since they changed."),
        )
        return f"{left} {unknown}"


def _as_sentence(reasons: str) -> str:
    words = reasons.replace("; ", ", ")
    return f"{words[:1].upper()}{words[1:]}." if words else ""
