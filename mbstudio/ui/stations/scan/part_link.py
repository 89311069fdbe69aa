"""Keeps the box in slices and view in step with the part that is being chosen."""

from __future__ import annotations

from PySide6.QtCore import QObject

from mbstudio.ui.language import tr
from mbstudio.ui.stations.scan.panel import ScanPanel
from mbstudio.ui.stations.scan.part_draft import PartDraft
from mbstudio.ui.stations.scan.work import ScanWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView


class PartLink(QObject):
    """What happens while a part of the scan is being chosen.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    work : ScanWork
    panel : ScanPanel
    draft : PartDraft
    """

    def __init__(
        self, studio: Studio, view: SceneView, work: ScanWork, panel: ScanPanel, draft: PartDraft
    ) -> None:
        super().__init__(studio)
        self._studio, self._view, self._work, self._panel, self._draft = studio, view, work, panel, draft
        self._is_open = False
        draft.changed.connect(self._show)
        view.part_dragged.connect(draft.set_ends)
        panel.part_form.cancelled.connect(draft.end)
        studio.workspace.scan_changed.connect(draft.end)

    def choose(self) -> None:
        """Let the person choose a part of the scan."""
        scan = self._studio.workspace.scan
        if scan is not None:
            self._studio.enter("scan")
            self._draft.begin(scan)

    def take(self) -> None:
        """Go on with the part alone."""
        draft = self._draft
        if draft.scan is not None and draft.is_possible and draft.is_change:
            self._work.take_part(draft.scan, draft.region.block, draft.bin)

    def show(self) -> None:
        """Show the box: the person has come to the station."""
        self._is_open = True
        self._show()

    def hide(self) -> None:
        """Show no box: the person goes elsewhere."""
        self._is_open = False
        self._show()

    def _show(self) -> None:
        shown = self._is_open and self._draft.scan is not None
        self._view.mark_part(self._draft.ends if shown else None)
        if shown:
            self._panel.show_part_form()
        if self._is_open:
            self._studio.give_hint(
                tr("Drag the edges and corners of the box in the slices.") if shown else ""
            )
        self._studio.refresh()
        self._studio.commands.bring_up_to_date()  # the buttons of the form follow the box at once
