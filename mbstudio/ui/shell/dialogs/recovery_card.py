"""A card on the welcome page: work that a crash has left, to be brought back or removed."""

from __future__ import annotations

from datetime import UTC, datetime

from PySide6.QtWidgets import QFrame, QHBoxLayout, QVBoxLayout

from mbstudio.core.project import AutosaveNote
from mbstudio.ui.language import mark, tr
from mbstudio.ui.widgets.forms import label, primary_button, quiet_button


class RecoveryCard(QFrame):
    """What was left, and two buttons: `restore` and `remove`."""

    def __init__(self, note: AutosaveNote) -> None:
        super().__init__()
        self.setObjectName("card")
        self.restore = primary_button(tr("Restore"))
        self.restore.setAccessibleName(tr("Restore {title}", title=note.title))
        self.remove = quiet_button(tr("Remove"))
        self.remove.setAccessibleName(tr("Delete the unsaved work on {title}", title=note.title))
        self.remove.setToolTip(tr("Delete this work permanently"))
        words = QVBoxLayout()
        words.setSpacing(2)
        words.addWidget(label(tr("Unsaved work: {title}", title=note.title), "heading"))
        place = f" {note.path.parent}." if note.path is not None else ""
        words.addWidget(label(f"{described(note)}, {age(note.saved)}.{place}", "hint", wrap=True))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(16, 12, 12, 12)
        layout.setSpacing(8)
        layout.addLayout(words, 1)
        layout.addWidget(self.remove)
        layout.addWidget(self.restore)


def described(note: AutosaveNote) -> str:
    """Return what an autosave holds, in words."""
    counted = (
        (note.grains, mark("{count:,} grain"), mark("{count:,} grains")),
        (note.fits, mark("{count:,} avatar"), mark("{count:,} avatars")),
        (note.clones, mark("{count:,} clone"), mark("{count:,} clones")),
    )
    parts = [tr(one if count == 1 else many, count=count) for count, one, many in counted if count]
    return ", ".join(parts) or tr("a scan and its settings")


def age(saved: datetime, now: datetime | None = None) -> str:
    """Return how long ago something was written, in words."""
    minutes = ((now or datetime.now(UTC)) - saved).total_seconds() / 60
    if minutes < 1.5:
        return tr("a minute ago")
    if minutes < 90:
        return tr("{minutes:.0f} minutes ago", minutes=minutes)
    hours = minutes / 60
    if hours < 36:
        return tr("{hours:.0f} hours ago", hours=hours)
    return tr("on {moment:%d %B %Y} at {moment:%H:%M}", moment=saved.astimezone())
