"""Connects the settings of the panel with what the slices show of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QObject

from mbstudio.core.errors import MbstudioError
from mbstudio.core.grains.preview.slice_foreground import grey_histogram
from mbstudio.core.scan import Scan
from mbstudio.ui.language import tr
from mbstudio.ui.latest_request_worker import LatestRequestWorker
from mbstudio.ui.stations.grains.learning.slice_preview import SlicePreview
from mbstudio.ui.stations.grains.learning.stroke_painting import StrokePainting
from mbstudio.ui.stations.grains.panel import GrainPanel
from mbstudio.ui.studio import Studio


class PreviewLink(QObject):
    """Shows the threshold while it moves, classes while strokes are painted, the splitting on demand.

    Parameters
    ----------
    studio : Studio
    panel : GrainPanel
    preview : SlicePreview
    painting : StrokePainting
    is_open : callable
        Whether the station is open.
    """

    def __init__(
        self,
        studio: Studio,
        panel: GrainPanel,
        preview: SlicePreview,
        painting: StrokePainting,
        is_open: Callable[[], bool],
    ) -> None:
        super().__init__(studio)
        self._studio, self._panel, self._preview = studio, panel, preview
        self._painting, self._is_open = painting, is_open
        self._counted: object = None
        self.counter = LatestRequestWorker("grey values", self)
        self.counter.done.connect(self._count_arrived)
        panel.threshold_kind.currentIndexChanged.connect(self._kind_changed)
        for field in (panel.threshold, panel.smoothing):
            field.valueChanged.connect(self._show_threshold)
        panel.ranges.textEdited.connect(self._show_threshold)
        panel.tone.currentIndexChanged.connect(self._show_threshold)
        panel.splitting.value_changed.connect(self._splitting_moved)
        panel.smallest.valueChanged.connect(self._splitting_moved)
        preview.failed.connect(lambda why: studio.say("warning", why))
        preview.settled.connect(self._tell)
        studio.workspace.scan_changed.connect(self._scan_changed)
        studio.workspace.grains_changed.connect(self._grains_changed)

    def enter(self) -> None:
        """Show what the settings stand for."""
        self._kind_changed()
        self._count()

    def leave(self) -> None:
        """Show the slices as they are."""
        self._painting.set_active(False)
        self._preview.clear()

    def preview_splitting(self) -> None:
        """Part the grains about the crossing of the slices; the same again takes the colours away."""
        if self._preview.mode == "splitting":
            self._preview.clear()
            self._kind_changed()
            return
        self._part()

    def _part(self) -> None:
        try:
            settings = self._panel.settings()
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return
        classifier = self._studio.workspace.state.classifier
        if settings.by_classifier and classifier is None:
            self._studio.say(
                "warning", tr("Paint strokes of grain and of void in the slices first, or load a classifier.")
            )
            return
        self._preview.show_splitting(settings, classifier)

    def _kind_changed(self, *_: object) -> None:
        if not self._is_open():
            return
        kind = self._panel.threshold_kind.currentData()
        self._painting.set_active(kind == "classifier")
        if kind != "classifier":
            self._preview.clear()
            self._show_threshold()

    def _show_threshold(self, *_: object) -> None:
        """Show a threshold or ranges that were stated; an automatic one is known only of the whole scan."""
        if not self._is_open() or self._studio.workspace.scan is None:
            return
        if self._preview.mode == "splitting":
            self._part()
            return
        if self._panel.threshold_kind.currentData() not in ("threshold", "ranges"):
            return
        try:
            settings = self._panel.settings()
        except MbstudioError:
            return  # ranges that are being typed; Find grains says what is wrong with them
        self._preview.show_threshold(settings)

    def _splitting_moved(self, *_: object) -> None:
        if self._is_open() and self._preview.mode == "splitting":
            self._part()

    def _tell(self) -> None:
        region = self._preview.region
        if region is not None:
            self._studio.give_hint(
                tr(
                    "{count} grains in the region about the crossing of the slices, found in it alone.",
                    count=region.count,
                )
            )

    def _grains_changed(self) -> None:
        # What was found is outlined now.
        if self._preview.mode in ("threshold", "splitting"):
            self._preview.clear()

    def _scan_changed(self) -> None:
        self._counted = None
        if self._is_open():
            self._count()

    def _count(self) -> None:
        scan = self._studio.workspace.scan
        if scan is not None and scan is not self._counted:
            self._counted = scan
            self.counter.ask(lambda: grey_histogram(scan), scan)

    def _count_arrived(self, scan: Scan, found: tuple[np.ndarray, np.ndarray]) -> None:
        if scan is self._studio.workspace.scan:
            self._panel.show_greys(*found)

    def close(self) -> None:
        """End the worker."""
        self.counter.close()
