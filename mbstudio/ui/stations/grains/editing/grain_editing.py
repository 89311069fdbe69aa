"""What the person does to chosen grains by hand."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import EditError, MbstudioError
from mbstudio.core.grains.editing.editable import EditOutcome
from mbstudio.core.grains.editing.records import (
    Delete,
    Edit,
    Exclude,
    FillHoles,
    Grow,
    Include,
    Merge,
    Shrink,
    Smooth,
)
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.label_writing import write_label_image
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.studio import Studio


class GrainEditing(QObject):
    """Makes edits of the chosen grains, each one step of undo, and saves labels.

    Parameters
    ----------
    studio : Studio
    """

    def __init__(self, studio: Studio) -> None:
        super().__init__(studio)
        self._studio, self._space = studio, studio.workspace

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
        self.tell(outcome, tr("Merged into grain {label}.", label=labels[0]))
        self._space.select(labels[0])

    def delete(self) -> None:
        """Take the chosen grains away."""
        count = len(self.chosen)
        self.make(
            Delete(labels=self.chosen),
            plural(count, mark("Delete a grain"), mark("Delete {count} grains")),
            plural(
                count,
                mark("Deleted a grain. Undo brings it back."),
                mark("Deleted {count} grains. Undo brings them back."),
            ),
        )

    def toggle_excluded(self) -> None:
        """Exclude the chosen grains; if all of them are excluded, include them again."""
        labels, count = self.chosen, len(self.chosen)
        if self._are_excluded(labels):
            self.make(
                Include(labels=labels),
                plural(count, mark("Include a grain"), mark("Include {count} grains")),
                plural(count, mark("A grain takes part again."), mark("{count} grains take part again.")),
            )
            return
        self.make(
            Exclude(labels=labels),
            plural(count, mark("Exclude a grain"), mark("Exclude {count} grains")),
            plural(
                count,
                mark("A grain is left out of fits, populations, learning and export."),
                mark("{count} grains are left out of fits, populations, learning and export."),
            ),
        )

    def words_of_exclusion(self) -> str:
        """Return what excluding or including the chosen grains is called now."""
        labels = self.chosen
        if not labels:
            return tr("Exclude or include grains")
        if self._are_excluded(labels):
            return plural(len(labels), mark("Include grain"), mark("Include {count} grains"))
        return plural(len(labels), mark("Exclude grain"), mark("Exclude {count} grains"))

    def grow(self) -> None:
        """Add a voxel all around the chosen grains."""
        self.make(Grow(labels=self.chosen), tr("Grow grains"))

    def shrink(self) -> None:
        """Take a voxel all around from the chosen grains."""
        self.make(Shrink(labels=self.chosen), tr("Shrink grains"))

    def smooth(self) -> None:
        """Smooth the outlines of the chosen grains."""
        self.make(Smooth(labels=self.chosen), tr("Smooth grains"))

    def fill_holes(self) -> None:
        """Fill the holes of the chosen grains."""
        self.make(FillHoles(labels=self.chosen), tr("Fill holes of grains"))

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

    def make(self, edit: Edit, title: str, told: str = "") -> EditOutcome[GrainSet] | None:
        """Make an edit, say what came of it, and return that; None if it cannot be made, which is said."""
        try:
            outcome = self._space.edit_grains(edit, title)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return None
        self.tell(outcome, told)
        return outcome

    def tell(self, outcome: EditOutcome[GrainSet], told: str) -> None:
        """Say what came of an edit."""
        words = " ".join(filter(None, (told, *outcome.notes)))
        if words:
            self._studio.say("warning" if outcome.notes else "success", words)
