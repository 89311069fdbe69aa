"""What station Packing shows in the view: the packing, before there is one the grains."""

from __future__ import annotations

from mbstudio.ui.view.display import Display
from mbstudio.ui.workspace import Workspace


class PackingDisplay(Display):
    """The grains of a packing in their mould.

    Attributes
    ----------
    content : object
        What is shown, by its identity: the camera moves when it changes. None before there is a packing.
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace, ("packing",), ("packing",), own_space=True)
        self.content: object = None

    @property
    def has_content(self) -> bool:
        return self.content is not None or super().has_content

    @property
    def shows_tray(self) -> bool:
        return self.content is None and super().shows_tray

    @property
    def looked_at(self) -> object:
        return self.content

    def layers_now(self, tray: bool) -> set[str]:
        return self.shown if self.content is not None else self.overview()
