"""What the person does to grains by hand: chosen ones at once, or with a tool in the slices."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import EditError, MbstudioError
from mbstudio.core.grains.editing.editable import EditOutcome
from mbstudio.core.grains.editing.records import (
    Delete,
    Edit,
    Erase,
    Exclude,
    FillHoles,
    Grow,
    Include,
    Merge,
    Paint,
    Shrink,
    Smooth,
    Split,
)
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.label_writing import write_label_image
from mbstudio.ui.language import tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView

Voxel = tuple[int, int, int]


class GrainEditing(QObject):
    """Makes edits of the chosen grains, each one step of undo, and takes strokes in the slices.

    Parameters
    ----------
    studio : Studio
    view : SceneView

    Attributes
    ----------
    tool : str
        What the left button does in the slices: "seeds", "paint", "erase", or nothing.
    seeds : list of (z, y, x)
        Where the grain that is being split was clicked.
    radius : float
        Of the brush, in voxels.
    in_space : bool
        Whether the brush is a ball and not a disk in the slice.
    """

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self._studio, self._view, self._space = studio, view, studio.workspace
        self.tool = ""
        self.seeds: list[Voxel] = []
        self.radius, self.in_space = 4.0, False
        self._stroke: list[Voxel] = []
        self._axis = 0
        self._preview: EditOutcome[GrainSet] | None = None
        self._split_label: int | None = None
        self._space.grains_changed.connect(self.stop)

    # ---- chosen grains -------------------------------------------------------------------------

    @property
    def chosen(self) -> tuple[int, ...]:
        """Labels of the chosen grains, that which is looked at first."""
        space = self._space
        rest = sorted(space.chosen - {space.selected})
        return tuple(rest) if space.selected is None else (space.selected, *rest)

    def merge(self, *, apart: bool = False) -> None:
        """Make the chosen grains one; where they do not touch, offer to close the gap."""
        labels = self.chosen
        edit = Merge(labels=labels, apart=apart)
        try:
            outcome = self._space.edit_grains(edit, tr("Merge {count} grains", count=len(labels)))
        except EditError as error:
            if apart or "do not touch" not in str(error):
                self._studio.say("error", str(error))
                return
            told = tr("The chosen grains do not touch.")
            self._studio.say("warning", told, tr("Close the gap"), lambda: self.merge(apart=True))
            return
        self._tell(outcome, tr("Merged into grain {label}.", label=labels[0]))
        self._space.select(labels[0])

    def delete(self) -> None:
        """Take the chosen grains away."""
        count = len(self.chosen)
        self._make(
            Delete(labels=self.chosen),
            tr("Delete {count} grains", count=count) if count > 1 else tr("Delete a grain"),
            tr("Deleted {count} grains. Undo brings them back.", count=count)
            if count > 1
            else tr("Deleted a grain. Undo brings it back."),
        )

    def toggle_excluded(self) -> None:
        """Exclude the chosen grains; if all of them are excluded, include them again."""
        labels, count = self.chosen, len(self.chosen)
        if self._are_excluded(labels):
            self._make(
                Include(labels=labels),
                tr("Include {count} grains", count=count) if count > 1 else tr("Include a grain"),
                tr("{count} grains take part again.", count=count)
                if count > 1
                else tr("A grain takes part again."),
            )
            return
        self._make(
            Exclude(labels=labels),
            tr("Exclude {count} grains", count=count) if count > 1 else tr("Exclude a grain"),
            tr("{count} grains are left out of fits, populations, learning and export.", count=count)
            if count > 1
            else tr("A grain is left out of fits, populations, learning and export."),
        )

    def grow(self) -> None:
        """Add a voxel all around the chosen grains."""
        self._make(Grow(labels=self.chosen), tr("Grow grains"))

    def shrink(self) -> None:
        """Take a voxel all around from the chosen grains."""
        self._make(Shrink(labels=self.chosen), tr("Shrink grains"))

    def smooth(self) -> None:
        """Smooth the outlines of the chosen grains."""
        self._make(Smooth(labels=self.chosen), tr("Smooth grains"))

    def fill_holes(self) -> None:
        """Fill the holes of the chosen grains."""
        self._make(FillHoles(labels=self.chosen), tr("Fill holes of grains"))

    # ---- tools in the slices -------------------------------------------------------------------

    def take_up(self, tool: str) -> None:
        """Let the left button in the slices belong to a tool; the same one again puts it down."""
        if tool == self.tool:
            self.stop()
            return
        self.stop()
        self.tool, self._view.slice_tool = tool, self
        hints = {
            "seeds": tr(
                "Click a seed in each part of a grain. Enter takes the split that is shown, Esc gives it up."
            ),
            "paint": tr("Paint the selected grain in a slice; void only. Esc ends."),
            "erase": tr("Erase from the selected grain in a slice. Esc ends."),
        }
        self._studio.give_hint(hints[tool])
        self._view.mark_voxels(())
        self._studio.refresh()

    def stop(self) -> None:
        """Put the tool down, and give up a split that was not taken."""
        shown = self._preview is not None
        self.seeds, self._stroke, self._preview, self._split_label = [], [], None, None
        if not self.tool:
            return
        keeps = self.tool in ("paint", "erase") and self._is_painting
        if keeps:
            return
        self.tool, self._view.slice_tool = "", None
        self._studio.give_hint("")
        self._view.mark_voxels(())
        if shown:
            self._view.outline(self._space.state.grains)
        self._studio.refresh()

    _is_painting = False

    def stroke(self, voxel: Voxel, axis: int, begun: bool) -> None:
        """Take a place of the mouse in a slice."""
        if self.tool == "seeds":
            if begun:
                self._add_seed(voxel)
            return
        if begun:
            self._stroke, self._axis = [], axis
        if voxel not in self._stroke[-1:]:
            self._stroke.append(voxel)

    def end_stroke(self) -> None:
        """Paint or erase where the mouse has been."""
        centres, label = (
            tuple((float(z), float(y), float(x)) for z, y, x in self._stroke),
            self._space.selected,
        )
        self._stroke = []
        if self.tool not in ("paint", "erase") or not centres:
            return
        if label is None and self.tool == "erase":
            self._studio.say("warning", tr("Select the grain to erase from."))
            return
        labels = () if label is None else (label,)
        axis = None if self.in_space else self._axis
        edit: Edit = Erase(labels=labels, centres=centres, radius=self.radius, axis=axis)
        title = tr("Erase")
        if self.tool == "paint":
            edit, title = Paint(labels=labels, centres=centres, radius=self.radius, axis=axis), tr("Paint")
        self._is_painting = True
        try:
            outcome = self._make(edit, title)
        finally:
            self._is_painting = False
        if outcome is not None and label is None and outcome.new:
            self._space.select(min(outcome.new))

    def accept(self) -> None:
        """Take the split that is shown."""
        outcome, seeds = self._preview, len(self.seeds)
        if outcome is None:
            return
        label = self._split_label
        self._make(
            replace(outcome.edit, anchors=()),
            tr("Split grain {label}", label=label),
            tr("Split grain {label} into {count}.", label=label, count=seeds),
        )

    @property
    def can_accept(self) -> bool:
        """Whether a split is shown that can be taken."""
        return self._preview is not None

    @property
    def can_be_put_down(self) -> bool:
        """Whether there is a tool, and no message that the key closes first."""
        return bool(self.tool) and not self._studio.messages.text

    def _add_seed(self, voxel: Voxel) -> None:
        grains = self._space.state.grains
        if grains is None or grains.label_volume.shape != self._shape:
            return
        label = int(grains.label_volume[voxel])
        if not label:
            self._studio.say("warning", tr("There is no grain at this place: click inside one."))
            return
        if self._split_label not in (None, label):
            self.seeds = []  # another grain is to be split
        self._split_label = label
        self.seeds.append(voxel)
        self._view.mark_voxels(self.seeds)
        self._preview = None
        if len(self.seeds) > 1:
            edit = Split(labels=(label,), seeds=tuple(self.seeds), by_grey=self._space.scan is not None)
            try:
                self._preview = grains.edit(edit, self._space.scan)
            except EditError as error:
                self.seeds.pop()
                self._studio.say("warning", str(error))
                self._view.mark_voxels(self.seeds)
        self._view.outline(grains if self._preview is None else self._preview.grains)
        self._space.select(label)
        self._studio.refresh()

    @property
    def _shape(self) -> tuple[int, ...] | None:
        scan = self._space.sliced
        return None if scan is None else scan.shape

    # ---- labels as a file ------------------------------------------------------------------------

    def ask_label_file(self) -> None:
        """Let the person choose where the labels are saved as an image."""
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Save labels"),
            self._studio.path_for("labels.tif"),
            tr("Label images (*.tif *.nrrd *.mha)"),
        )
        if name:
            self.save_labels(Path(name))

    def save_labels(self, path: Path) -> None:
        """Save the labels as an image."""
        grains, scan = self._space.state.grains, self._space.scan
        if grains is None:
            return
        try:
            write_label_image(path, grains, scan.grid if scan is not None else None)
        except (MbstudioError, OSError) as error:
            self._studio.say("error", str(error))
            return
        self._studio.say("success", tr("The labels were saved as {name}.", name=path.name))

    # ---- inside ----------------------------------------------------------------------------------

    def _are_excluded(self, labels: tuple[int, ...]) -> bool:
        grains = self._space.state.grains
        return grains is not None and grains.excluded_labels.issuperset(labels)

    def _make(self, edit: Edit, title: str, told: str = "") -> EditOutcome[GrainSet] | None:
        try:
            outcome = self._space.edit_grains(edit, title)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return None
        self._tell(outcome, told)
        return outcome

    def _tell(self, outcome: EditOutcome[GrainSet], told: str) -> None:
        words = " ".join(filter(None, (told, *outcome.notes)))
        if words:
            self._studio.say("warning" if outcome.notes else "success", words)
