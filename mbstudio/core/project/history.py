"""Undo and redo: the states that a project has been in."""

from __future__ import annotations

from mbstudio.core.errors import ProjectError
from mbstudio.core.project.state import ProjectState


class History:
    """States in the order in which they came, each with the title of the change that led to it.

    States are frozen and share what did not change, so that a state costs no more than what is
    new in it.

    Parameters
    ----------
    state : ProjectState
        Where the history begins.
    limit : int
        How many changes can be undone at most; older ones are forgotten.
    """

    def __init__(self, state: ProjectState, limit: int = 1000) -> None:
        if limit < 1:
            raise ValueError(f"The history must hold at least 1 change, not {limit}.")
        self._entries: list[tuple[str, ProjectState]] = [("", state)]
        self._position = 0
        self._limit = limit

    @property
    def state(self) -> ProjectState:
        """The state that holds now."""
        return self._entries[self._position][1]

    @property
    def states(self) -> list[ProjectState]:
        """All states, oldest first, those that were undone among them."""
        return [state for _, state in self._entries]

    @property
    def titles(self) -> list[str]:
        """Titles of the changes that can be undone, oldest first."""
        return [title for title, _ in self._entries[1 : self._position + 1]]

    @property
    def all_titles(self) -> list[str]:
        """Titles of all changes, oldest first, those that were undone among them."""
        return [title for title, _ in self._entries[1:]]

    @property
    def earlier_titles(self) -> list[str]:
        """Titles of changes before all that can be undone, oldest first: made before the file was opened."""
        return list(self._entries[0][1].log)

    @property
    def position(self) -> int:
        """How many of `all_titles` hold now; the rest was undone."""
        return self._position

    @property
    def can_undo(self) -> bool:
        return self._position > 0

    @property
    def can_redo(self) -> bool:
        return self._position < len(self._entries) - 1

    @property
    def undo_title(self) -> str:
        """Title of the change that :meth:`undo` takes back; empty if there is none."""
        return self._entries[self._position][0] if self.can_undo else ""

    @property
    def redo_title(self) -> str:
        """Title of the change that :meth:`redo` makes again; empty if there is none."""
        return self._entries[self._position + 1][0] if self.can_redo else ""

    def push(self, state: ProjectState, title: str) -> None:
        """Add the state that a change led to; what was undone before can no longer be redone."""
        del self._entries[self._position + 1 :]
        self._entries.append((title, state))
        del self._entries[: max(len(self._entries) - 1 - self._limit, 0)]
        self._position = len(self._entries) - 1

    def amend(self, state: ProjectState) -> None:
        """Put another state in the place of the present one, as part of the change that led to it."""
        self._entries[self._position] = (self._entries[self._position][0], state)

    def undo(self) -> ProjectState:
        """Go back one change and return the state before it.

        Raises
        ------
        ProjectError
            If there is nothing to undo.
        """
        if not self.can_undo:
            raise ProjectError("There is nothing to undo.")
        self._position -= 1
        return self.state

    def redo(self) -> ProjectState:
        """Make the change that was undone last again and return the state after it.

        Raises
        ------
        ProjectError
            If there is nothing to redo.
        """
        if not self.can_redo:
            raise ProjectError("There is nothing to redo.")
        self._position += 1
        return self.state

    def go_to(self, position: int) -> ProjectState:
        """Undo or redo until so many of the changes hold, and return the state then.

        Raises
        ------
        ProjectError
            If there are not so many changes.
        """
        if not 0 <= position < len(self._entries):
            raise ProjectError(f"There are {len(self._entries) - 1} changes, not {position}.")
        self._position = position
        return self.state
