"""Shows in the flat slices what settings would give, off the main thread and for what is seen alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32, Int, UInt8
from PySide6.QtCore import QObject, Signal

from mbstudio.core.errors import MbstudioError
from mbstudio.core.grains.classifying import Stroke, VoxelClassifier
from mbstudio.core.grains.classifying.grey_levels import GreyLevels
from mbstudio.core.grains.classifying.stroke import KINDS
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.grains.editing.stroke_voxels import find_under_stroke
from mbstudio.core.grains.preview.region_splitting import SplitRegion, split_region
from mbstudio.core.grains.preview.slice_foreground import SliceForeground
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.scan import Scan
from mbstudio.scene.layers.slices import AXES, Axis
from mbstudio.scene.theme import label_colours
from mbstudio.ui.latest_request_worker import LatestRequestWorker
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView

KIND_COLOURS: Mapping[str, tuple[int, int, int]] = {
    "void": (0, 188, 180),
    "grain": (250, 170, 40),
    "mineral": (70, 130, 255),
    "border": (235, 60, 160),
}
"""Colours of strokes and probabilities, told apart on any grey."""
_MASK = (250, 170, 40)
_MASK_ALPHA, _REGION_ALPHA, _CLASS_ALPHA, _STROKE_ALPHA = 95, 120, 120, 235

Tints = dict[Axis, UInt8[np.ndarray, "h w 4"]]
Cuts = dict[Axis, int]


@dataclass(frozen=True, eq=False)
class _Found:
    """What a worker found: of which wish, and the tints, or the region."""

    tints: Tints
    region: SplitRegion | None = None
    known: Any = None


class SlicePreview(QObject):
    """Lays colours over the flat slices.

    Parameters
    ----------
    studio : Studio
    view : SceneView

    Attributes
    ----------
    mode : str
        What is shown: "threshold", "classes", "splitting", or nothing.
    settled : signal
        What was asked last is shown, or could not be found.
    failed : signal (str)
        Why not.
    region : SplitRegion or None
        The grains of the region that is shown.
    """

    settled = Signal()
    failed = Signal(str)

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self._view, self._space = view, studio.workspace
        self.mode = ""
        self.region: SplitRegion | None = None
        self._settings = SegmentationSettings()
        self._classifier: VoxelClassifier | None = None
        self._base: Tints = {}
        self._cuts: Cuts = {}
        self._foreground: SliceForeground | None = None
        self._levels: GreyLevels | None = None
        self._strokes: tuple[Stroke, ...] = ()
        self._painted: dict[Stroke, tuple[Box, np.ndarray] | None] = {}
        self.worker = LatestRequestWorker("preview", self)
        self.worker.done.connect(self._arrived)
        self.worker.failed.connect(self._failed)
        view.slices_changed.connect(self._slices_moved)
        self._space.scan_changed.connect(self._forget)

    # ---- what is asked -----------------------------------------------------------------------------

    def show_threshold(self, settings: SegmentationSettings) -> None:
        """Show what a threshold or ranges take for grain."""
        self.mode, self._settings, self.region = "threshold", settings, None
        self._ask()

    def show_classes(self, classifier: VoxelClassifier | None) -> None:
        """Show how probable each kind is by a classifier; strokes alone without one."""
        self.mode, self._classifier, self.region = "classes", classifier, None
        if classifier is None:
            self._base = {}
            self._draw()
            self.settled.emit()
            return
        self._ask()

    def show_splitting(self, settings: SegmentationSettings, classifier: VoxelClassifier | None) -> None:
        """Show how the grains about the crossing of the slices are parted."""
        self.mode, self._settings, self._classifier = "splitting", settings, classifier
        self._ask()

    def show_strokes(self, strokes: tuple[Stroke, ...]) -> None:
        """Show strokes above all else."""
        self._strokes = strokes
        self._draw()

    def clear(self) -> None:
        """Show the slices as they are."""
        self.mode, self.region, self._base = "", None, {}
        self._draw()

    def levels_of(self, scan: Scan) -> GreyLevels:
        """Return the grey levels of a scan, kept from before where it is the same; for workers."""
        known = self._levels
        if known is None or known.voxels is not scan.voxels:
            known = GreyLevels.of(scan)
            self._levels = known
        return known

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    # ---- in the worker -----------------------------------------------------------------------------

    def _ask(self) -> None:
        scan, cuts = self._space.scan, self._present_cuts()
        if scan is None or cuts is None:
            return
        self._cuts = cuts
        settings, classifier = self._settings, self._classifier
        works: dict[str, Callable[[], _Found]] = {
            "threshold": lambda: self._find_masks(scan, cuts, settings),
            "classes": lambda: self._find_classes(scan, cuts, classifier),
            "splitting": lambda: self._find_region(scan, cuts, settings, classifier),
        }
        self.worker.ask(works[self.mode], (self.mode, scan))

    def _find_masks(self, scan: Scan, cuts: Cuts, settings: SegmentationSettings) -> _Found:
        known = self._foreground
        if known is None or known.scan is not scan:
            known = SliceForeground.of(scan)
        tints = {
            axis: _tinted(known.mask("zyx".index(axis), index, settings), _MASK, _MASK_ALPHA)
            for axis, index in cuts.items()
        }
        return _Found(tints, known=known)

    def _find_classes(self, scan: Scan, cuts: Cuts, classifier: VoxelClassifier | None) -> _Found:
        assert classifier is not None
        levels = self.levels_of(scan)
        tints: Tints = {}
        for axis, index in cuts.items():
            number = "zyx".index(axis)
            box = tuple(
                slice(index, index + 1) if place == number else slice(0, count)
                for place, count in enumerate(scan.shape)
            )
            shares = classifier.probabilities(levels, (box[0], box[1], box[2]))
            tints[axis] = _class_picture(np.take(shares, 0, number))
        return _Found(tints)

    def _find_region(
        self, scan: Scan, cuts: Cuts, settings: SegmentationSettings, classifier: VoxelClassifier | None
    ) -> _Found:
        place = (cuts["z"], cuts["y"], cuts["x"])
        region = split_region(scan, place, settings, classifier if settings.by_classifier else None)
        return _Found(_region_tints(region, scan.shape, cuts), region)

    # ---- in the main thread ------------------------------------------------------------------------

    def _arrived(self, token: Any, found: _Found) -> None:
        mode, scan = token
        if isinstance(found.known, SliceForeground):
            self._foreground = found.known
        if mode != self.mode or scan is not self._space.scan:
            return
        self._base, self.region = found.tints, found.region
        self._draw()
        self.settled.emit()

    def _failed(self, token: Any, error: Exception) -> None:
        if token[0] != self.mode or token[1] is not self._space.scan:
            return
        self._base, self.region = {}, None
        self._draw()
        if not isinstance(error, MbstudioError):
            raise error
        self.failed.emit(str(error))
        self.settled.emit()

    def _slices_moved(self) -> None:
        cuts, scan = self._present_cuts(), self._space.scan
        if cuts is None or cuts == self._cuts or scan is None:
            return
        self._cuts = cuts
        inside = self.region is not None and all(
            part.start <= cuts[axis] < part.stop
            for axis, part in zip(reversed(AXES), self.region.box, strict=True)
        )
        if self.mode == "splitting" and inside and self.region is not None:
            self._base = _region_tints(self.region, scan.shape, cuts)
        elif self.mode and not (self.mode == "classes" and self._classifier is None):
            self._base = {}
            self._ask()
        self._draw()

    def _present_cuts(self) -> Cuts | None:
        planes = self._view.scene.layers.slices.planes
        return None if planes is None or self._space.scan is None else dict(planes.index)

    def _forget(self) -> None:
        self._foreground = self._levels = None
        self._painted.clear()
        self.clear()

    def _draw(self) -> None:
        """Lay strokes over what was found, and hand it to the slices."""
        scan, cuts = self._space.scan, self._present_cuts()
        if scan is None or cuts is None:
            self._view.tint({})
            return
        tints = dict(self._base)
        for axis in AXES if self._strokes else ():
            picture = self._stroke_picture(axis, cuts[axis], scan)
            if picture is not None:
                below = tints.get(axis)
                if below is not None:
                    picture = np.where(picture[..., 3:] > 0, picture, below)
                tints[axis] = picture
        self._view.tint(tints)

    def _stroke_picture(self, axis: Axis, index: int, scan: Scan) -> UInt8[np.ndarray, "h w 4"] | None:
        """Return the strokes that a slice cuts, the last on top."""
        number = "zyx".index(axis)
        kept = [count for place, count in enumerate(scan.shape) if place != number]
        picture: np.ndarray | None = None
        for stroke in self._strokes:
            found = self._under(stroke, scan)
            if found is None or not found[0][number].start <= index < found[0][number].stop:
                continue
            box, under = found
            flat = np.take(under, index - box[number].start, number)
            if not flat.any():
                continue
            if picture is None:
                picture = np.zeros((*kept, 4), np.uint8)
            rows, columns = (part for place, part in enumerate(box) if place != number)
            colour = (*KIND_COLOURS[stroke.kind], _STROKE_ALPHA) if stroke.kind else (0, 0, 0, 0)
            picture[rows, columns][flat] = colour
        return picture

    def _under(self, stroke: Stroke, scan: Scan) -> tuple[Box, np.ndarray] | None:
        if stroke not in self._painted:
            self._painted[stroke] = find_under_stroke(
                scan.shape, scan.voxel_size, stroke.centres, stroke.radius, stroke.axis
            )
        return self._painted[stroke]


def _tinted(mask: np.ndarray, colour: tuple[int, int, int], alpha: int) -> UInt8[np.ndarray, "h w 4"]:
    picture = np.zeros((*mask.shape, 4), np.uint8)
    picture[mask] = (*colour, alpha)
    return picture


def _class_picture(shares: Float32[np.ndarray, "h w k"]) -> UInt8[np.ndarray, "h w 4"]:
    """Return the colour of the most probable kind, the stronger the more probable it is."""
    best = shares.argmax(axis=-1)
    picture = np.zeros((*best.shape, 4), np.uint8)
    picture[..., :3] = np.array([KIND_COLOURS[kind] for kind in KINDS], np.uint8)[best]
    sure = np.clip(2.0 * shares.max(axis=-1) - 1.0, 0.0, 1.0)
    picture[..., 3] = np.rint(_CLASS_ALPHA * sure)
    return picture


def _region_tints(region: SplitRegion, shape: tuple[int, int, int], cuts: Cuts) -> Tints:
    """Return the parted grains of a region in the slices that cut it."""
    colours = label_colours(region.count)
    tints: Tints = {}
    for axis, index in cuts.items():
        number = "zyx".index(axis)
        part = region.box[number]
        if not part.start <= index < part.stop:
            continue
        labels: Int[np.ndarray, "a b"] = np.take(region.labels, index - part.start, number)
        picture = np.zeros((*(count for place, count in enumerate(shape) if place != number), 4), np.uint8)
        rows, columns = (side for place, side in enumerate(region.box) if place != number)
        picture[rows, columns, :3] = colours[labels]
        picture[rows, columns, 3] = np.where(labels > 0, _REGION_ALPHA, 0)
        tints[axis] = picture
    return tints
