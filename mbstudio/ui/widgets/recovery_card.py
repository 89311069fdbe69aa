"""A card on the welcome page: work that a crash has left, to be brought back or removed."""

from __future__ import annotations

from datetime import UTC, datetime

from PySide6.QtWidgets import QFrame, QHBoxLayout, QVBoxLayout

from mbstudio.core.project import AutosaveNote
from mbstudio.ui.widgets.forms import label, primary_button, quiet_button


class RecoveryCard(QFrame):
    """What was left, and two buttons: `restore` and `remove`."""

    def __init__(self, note: AutosaveNote) -> None:
        super().__init__()
        self.setObjectName("card")
        self.restore = primary_button("Restore")
        self.restore.setAccessibleName(f"Restore {note.title}")
        self.remove = quiet_button("Remove")
        self.remove.setAccessibleName(f"Remove the unsaved work on {note.title}")
        self.remove.setToolTip("Remove this work for good")
        words = QVBoxLayout()
        words.setSpacing(2)
        words.addWidget(label(f"Unsaved work: {note.title}", "heading"))
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
    counted = ((note.grains, "grain"), (note.fits, "avatar"), (note.clones, "clone"))
    parts = [f"{count:,} {name}{'s' if count != 1 else ''}" for count, name in counted if count]
    return ", ".join(parts) or "a scan and its settings"


def age(saved: datetime, now: datetime | None = None) -> str:
    """Return how long ago something was written, in words."""
    minutes = ((now or datetime.now(UTC)) - saved).total_seconds() / 60
    if minutes < 1.5:
        return "a minute ago"
    if minutes < 90:
        return f"{minutes:.0f} minutes ago"
    hours = minutes / 60
    return f"{hours:.0f} hours ago" if hours < 36 else saved.astimezone().strftime("on %d %B %Y at %H:%M")
