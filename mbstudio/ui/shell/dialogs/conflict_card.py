"""The question what becomes of work whose project file another program uses or has written."""

from __future__ import annotations

from mbstudio.core.errors import ProjectChangedError, ProjectError
from mbstudio.ui.language import tr
from mbstudio.ui.shell.dialogs.question_card import QuestionCard


class ConflictCard(QuestionCard):
    """Save a copy, merge, or open the file anew: answers 'copy', 'merge', 'reload' and 'cancel'."""

    def __init__(self) -> None:
        super().__init__(
            [("copy", tr("Save a &copy…")), ("merge", tr("&Merge")), ("reload", tr("&Open anew"))]
        )
        self.buttons["merge"].setToolTip(tr("Keep the avatars and kept grains of both"))
        self.buttons["reload"].setToolTip(tr("Give up what was changed here"))

    def ask_about(self, name: str, error: ProjectError) -> None:
        """Ask about a project of this name that could not be saved."""
        changed = isinstance(error, ProjectChangedError)
        # What is in use may still change: there is nothing to merge with yet.
        for answer in ("merge", "reload"):
            self.buttons[answer].setVisible(changed)
        if changed:
            question = tr("“{project}” was written by another program since it was opened.", project=name)
            told = tr(
                "Nothing was replaced. Merging keeps the avatars and kept grains of both; opening it anew "
                "gives up what was changed here."
            )
        else:
            question = tr("“{project}” is in use by another program.", project=name)
            told = str(error)
        self.ask(question, told)
