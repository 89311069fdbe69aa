"""Undo and redo at station Latent: steps of shaping, and the kept grains between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64

from mbstudio.core.project import ProjectState
from mbstudio.core.vae.shaping.latent_recipe import BEYOND, Operation
from mbstudio.ui.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Stance:
    """A point of the latent space and the way to it.

    Attributes
    ----------
    latent : float array, shape (d,)
    operations : tuple of Operation
    held : bool
        Whether the last operation led beyond the parents' range; it was held there unless it was allowed.
    change : ProjectState or None
        What the project became where this step changed its kept grains, not the latent vector.
    words : str
        Title of that change.
    """

    latent: Float64[np.ndarray, " d"]
    operations: tuple[Operation, ...]
    held: bool = False
    change: ProjectState | None = None
    words: str = ""

    @property
    def title(self) -> str:
        """What led here, in words."""
        return self.words or (self.operations[-1].words if self.operations else "")

    @property
    def is_beyond(self) -> bool:
        """Whether it lies beyond the parents' range because that was allowed."""
        return self.held and bool(self.operations) and bool(self.operations[-1].given.get(BEYOND))


class ShapingHistory:
    """Where one stood at station Latent, in order.

    A change of the kept grains is a change of the project, and undone as such: where the project has
    changed otherwise since, or it was taken back at another station, the step is passed over.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._entries: list[Stance] = []
        self._place = 0

    def begin(self, stance: Stance | None) -> None:
        """Forget everything and stand here; None: nowhere."""
        self._entries, self._place = ([] if stance is None else [stance]), 0

    @property
    def stance(self) -> Stance | None:
        """Where one stands."""
        return self._entries[self._place] if self._entries else None

    @property
    def undo_title(self) -> str | None:
        """What undo takes back; None where there is nothing."""
        place = self._undone()
        return None if place is None else self._entries[place].title

    @property
    def redo_title(self) -> str | None:
        """What redo makes again; None where there is nothing."""
        place = self._redone()
        return None if place is None else self._entries[place].title

    def push(self, stance: Stance) -> None:
        """Stand somewhere else; what was taken back can no longer be made again."""
        self._entries = [*self._entries[: self._place + 1], stance]
        self._place = len(self._entries) - 1

    def change(self, title: str, **changes: Any) -> None:
        """Change the project as a step of this history."""
        self._workspace.change(title, **changes)
        if self.stance is not None:
            self.push(replace(self.stance, change=self._workspace.state, words=title))

    def undo(self) -> bool:
        """Go back one step; return whether there was one."""
        place = self._undone()
        if place is None:
            return False
        self._place = place - 1
        if self._entries[place].change is not None:
            self._workspace.undo()
        return True

    def redo(self) -> bool:
        """Go forth again; return whether there was where to."""
        place = self._redone()
        if place is None:
            return False
        self._place = place
        if self._entries[place].change is not None:
            self._workspace.redo()
        return True

    def before_last(self, kind: str) -> Stance | None:
        """Return where one stood before the last operation if it was of this kind, else where one stands."""
        stance = self.stance
        if stance is None or not stance.operations[1:] or stance.operations[-1].kind != kind:
            return stance
        before = (past for past in reversed(self._entries[: self._place]))
        return next((past for past in before if past.operations == stance.operations[:-1]), stance)

    def _undone(self) -> int | None:
        for place in range(self._place, 0, -1):
            change = self._entries[place].change
            if change is None or change is self._workspace.state:
                return place
        return None

    def _redone(self) -> int | None:
        history = self._workspace.project.history
        for place in range(self._place + 1, len(self._entries)):
            entry = self._entries[place]
            if entry.change is None or history.redo_title == entry.words:
                return place
        return None
