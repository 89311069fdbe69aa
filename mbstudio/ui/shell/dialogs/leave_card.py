"""The question whether unsaved work is saved before it goes."""

from __future__ import annotations

from mbstudio.ui.language import tr
from mbstudio.ui.shell.dialogs.question_card import CANCEL, QuestionCard


class LeaveCard(QuestionCard):
    """Save, Discard or Cancel: answers 'save', 'discard' and 'cancel'."""

    def __init__(self) -> None:
        super().__init__([("save", tr("&Save")), ("discard", tr("&Discard"))])
        self.save, self.discard, self.cancel = (self.buttons[name] for name in ("save", "discard", CANCEL))
