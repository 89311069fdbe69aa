"""Takes strokes in the slices, each one step of undo, and learns from them as they come."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import MbstudioError
from mbstudio.core.grains.classifying import Stroke, VoxelClassifier, load_classifier
from mbstudio.core.grains.classifying.stroke import TITLES
from mbstudio.ui.language import tr
from mbstudio.ui.latest_request_worker import LatestRequestWorker
from mbstudio.ui.stations.grains.learning.slice_preview import KIND_COLOURS, SlicePreview
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.pane_trail import Brush
from mbstudio.ui.view.scene_view import SceneView

Voxel = tuple[int, int, int]


class StrokePainting(QObject):
    """Paints strokes of grain, void, second mineral and border.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    preview : SlicePreview

    Attributes
    ----------
    radius : float
        Of the brush, in voxels.
    told : str
        How it stands with learning.
    is_active : bool
        Whether strokes are shown and learned from.
    changed : signal
        Another kind is painted, or `told` is another.
    taken_up : signal
        The left button is about to be taken: all other tools are to be put down.
    """

    changed = Signal()
    taken_up = Signal()

    def __init__(self, studio: Studio, view: SceneView, preview: SlicePreview) -> None:
        super().__init__(studio)
        self._studio, self._view, self._preview, self._space = studio, view, preview, studio.workspace
        self._kind: str | None = None
        self.radius = 1.5
        self.told = ""
        self.is_active = False
        self._places: list[Voxel] = []
        self._axis = 0
        self._learned_from: tuple[Stroke, ...] | None = None
        self.worker = LatestRequestWorker("learn", self)
        self.worker.done.connect(self._learned)
        self.worker.failed.connect(self._failed)
        self._space.learning_changed.connect(self._strokes_changed)
        self._space.scan_changed.connect(self.put_down)

    # ---- the tool ------------------------------------------------------------------------------

    @property
    def kind(self) -> str | None:
        """What the left button paints in the slices; empty takes strokes away, None where it does not."""
        return self._kind if self._view.slice_tool is self else None

    @property
    def can_be_put_down(self) -> bool:
        """Whether a kind is painted, and no message that the key closes first."""
        return self.kind is not None and not self._studio.messages.text

    def take_up(self, kind: str) -> None:
        """Let the left button in the slices paint a kind; the same one again puts it down."""
        if self._space.scan is None:
            return
        if kind == self.kind:
            self.put_down()
            return
        self.taken_up.emit()
        self._kind, self._view.slice_tool = kind, self
        self._show_brush()
        self._studio.give_hint(
            tr("Paint a few strokes in the slices: {kind}. Esc ends.", kind=tr(TITLES[kind]))
        )
        self._view.mark_voxels(())
        self._told_changed()

    def put_down(self) -> None:
        """Give the left button back."""
        self._places = []
        if self.kind is None:
            return
        self._kind = self._view.slice_tool = self._view.brush = None
        self._studio.give_hint("")
        self._view.mark_voxels(())
        self._told_changed()

    def set_radius(self, radius: float) -> None:
        """Take a brush of another radius, in voxels."""
        self.radius = float(radius)
        if self.kind is not None:
            self._show_brush()
            self._view.slices_changed.emit()

    def _show_brush(self) -> None:
        """Let the brush be seen under the mouse."""
        scan, kind = self._space.scan, self._kind or ""
        colour = "#{:02x}{:02x}{:02x}".format(*KIND_COLOURS.get(kind, (255, 255, 255)))
        edge = min(scan.voxel_size.zyx) if scan is not None else 1.0
        self._view.brush = Brush(colour, self.radius * edge)

    def stroke(self, voxel: Voxel, axis: int, begun: bool) -> None:
        """Take the next place of a stroke, and show it."""
        if begun:
            self._places, self._axis = [], axis
        if voxel in self._places[-1:]:
            return
        self._places.append(voxel)
        self._preview.show_strokes((*self._space.state.strokes, self._present_stroke()))

    def end_stroke(self) -> None:
        """Keep the stroke as one step of undo."""
        if self.kind is None or not self._places:
            return
        stroke, kind, self._places = self._present_stroke(), self.kind, []
        title = tr("Paint: {kind}", kind=tr(TITLES[kind])) if kind else tr("Take strokes away")
        self._space.change(title, strokes=(*self._space.state.strokes, stroke))

    def _present_stroke(self) -> Stroke:
        centres = tuple((float(z), float(y), float(x)) for z, y, x in self._places)
        return Stroke(self.kind or "", centres, self.radius, self._axis)

    # ---- learning ------------------------------------------------------------------------------

    def set_active(self, active: bool) -> None:
        """Show strokes and what was learned, or put them away."""
        if active == self.is_active:
            return
        self.is_active = active
        if active:
            self._strokes_changed()
            return
        self.put_down()
        self._preview.show_strokes(())
        if self._preview.mode == "classes":
            self._preview.clear()

    @property
    def is_learning(self) -> bool:
        """Whether what was painted is still being learned."""
        return not self.worker.is_idle

    def clear(self) -> None:
        """Take all strokes away, as one step of undo."""
        if self._space.state.strokes:
            self._space.change(tr("Take all strokes away"), strokes=())

    def _strokes_changed(self) -> None:
        """Learn from what is painted now, unless it was learned from already."""
        if not self.is_active:
            return
        strokes, scan = self._space.state.strokes, self._space.scan
        self._preview.show_strokes(strokes)
        if scan is None or not strokes:
            self._learned_from = None
            self.told = ""
            self._show_classes()
            return
        if self._learned_from == strokes:
            self._show_classes()
            return
        preview, voxels = self._preview, scan

        def learn() -> VoxelClassifier:
            return VoxelClassifier.learned(voxels, strokes, levels=preview.levels_of(voxels))

        self.told = tr("Learning…")
        self._told_changed()
        self.worker.ask(learn, (scan, strokes))

    def _learned(self, token: Any, classifier: VoxelClassifier) -> None:
        scan, strokes = token
        if scan is not self._space.scan or strokes != self._space.state.strokes:
            return
        self._learned_from = strokes
        self.told = tr(
            "{count:,} voxels painted. Trees tell {share:.0f} % of them that did not learn them.",
            count=sum(classifier.voxels),
            share=100 * classifier.accuracy,
        )
        self._space.amend(classifier=classifier)
        self._show_classes()

    def _failed(self, token: Any, error: Exception) -> None:
        if not isinstance(error, MbstudioError):
            raise error
        scan, strokes = token
        if scan is not self._space.scan or strokes != self._space.state.strokes:
            return
        self.told = str(error)
        self._told_changed()

    def _show_classes(self) -> None:
        if self.is_active:
            self._preview.show_classes(self._space.state.classifier)
        self._told_changed()

    def _told_changed(self) -> None:
        self.changed.emit()
        self._studio.refresh()

    def close(self) -> None:
        """End the worker."""
        self.worker.close()

    # ---- files ---------------------------------------------------------------------------------

    def ask_file_to_load(self) -> None:
        """Let the person choose a classifier."""
        name, _ = QFileDialog.getOpenFileName(
            self._studio.host, tr("Load classifier"), self._studio.path_for(),
            tr("Classifiers (*.mbclf);;All files (*)"),
        )  # fmt: skip
        if name:
            self.load(Path(name))

    def load(self, path: Path) -> None:
        """Take a classifier from a file in place of the strokes, as one step of undo."""
        try:
            classifier = load_classifier(path)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return
        self._learned_from = ()
        self._space.change(tr("Load classifier"), classifier=classifier, strokes=())
        self._studio.say("success", tr("The classifier {name} is used now.", name=path.name))

    def ask_file_to_save(self) -> None:
        """Let the person choose where the classifier is saved."""
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host, tr("Save classifier"), self._studio.path_for("sand.mbclf"),
            tr("Classifiers (*.mbclf)"),
        )  # fmt: skip
        if name:
            self.save(Path(name))

    def save(self, path: Path) -> None:
        """Save the classifier to a file."""
        classifier = self._space.state.classifier
        if classifier is None:
            return
        try:
            classifier.save(path)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return
        self._studio.say("success", tr("The classifier was saved as {name}.", name=path.name))
