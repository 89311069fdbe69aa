"""What station Export shows in the view: all avatars, or one with what stands for it in the export."""

from __future__ import annotations

from mbstudio.ui.view.display import Display
from mbstudio.ui.workspace import Workspace

_PREVIEW: frozenset[str] = frozenset(("shape", "envelope"))


class ExportDisplay(Display):
    """All avatars where their grains lie; in place of them one with what stands for it in the export.

    Attributes
    ----------
    preview : object
        What of an export is looked at; None: nothing by itself.
    has_envelope : bool
        Whether the avatar itself is shown over what stands for it.
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(
            workspace,
            ("slices", "grains", "avatars", "shape", "envelope"),
            ("avatars", "shape", "envelope"),
            kept_built=("avatars",),
        )
        self.preview: object = None
        self.has_envelope = False

    def offers(self, layer: str) -> bool:
        if layer == "envelope":
            return self.preview is not None and self.has_envelope
        return super().offers(layer) and (self.preview is not None) == (layer == "shape")

    @property
    def looked_at(self) -> object:
        return self.preview

    def layers_now(self, tray: bool) -> set[str]:
        if self.preview is not None:
            return self.shown & _PREVIEW
        return (self.shown if self._workspace.state.fits else self.overview()) - _PREVIEW
