"""Correcting grains with a tool in the flat slices: splits and new grains are shown before they are taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.errors import EditError, MbstudioError
from mbstudio.core.grains.editing.editable import EditOutcome
from mbstudio.core.grains.editing.records import Edit, Erase, Fill, NewGrain, Paint, Split, SplitAlong
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.scene.theme import label_colours
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.grains.editing.grain_editing import GrainEditing
from mbstudio.ui.stations.grains.editing.strokes import Voxel, grain_under, simplified
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.pane_trail import Brush
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.workers import Task

LARGEST_RADIUS = 64.0
KEEPING = ("paint", "erase", "fill")
"""Tools that stay in the hand after each edit."""
_AT_ONCE = 300_000  # voxels that an edit may look at before it is left to a thread
_LEVEL_STEP = 0.02  # of the grey window
_HINTS = {
    "seeds": mark(
        "Click a seed in each part of a grain. Enter takes the split that is shown, Esc gives it up."
    ),
    "line": mark("Draw a line across a grain. Enter takes the split that is shown, Esc gives it up."),
    "new": mark(
        "Click what is no grain yet. [ and ] change its grey value; Enter takes the grain that is shown, "
        "Esc gives it up."
    ),
    "paint": mark("Paint the selected grain in a slice; void only. [ and ] change the radius. Esc ends."),
    "erase": mark("Erase from the selected grain in a slice. [ and ] change the radius. Esc ends."),
    "fill": mark("Click void that the selected grain encloses in a slice. Esc ends."),
}


@dataclass(frozen=True, eq=False)
class Proposal:
    """An edit that is shown and not taken.

    Attributes
    ----------
    edit : Edit
    begun : GrainSet
        What it is made of.
    title, told : str
        Of the step of undo, and what is said once it is taken.
    outcome : EditOutcome or None
        None as long as it is being made.
    """

    edit: Edit
    begun: GrainSet
    title: str
    told: str
    outcome: EditOutcome[GrainSet] | None = None


class SliceEditing(QObject):
    """What the left button does in the flat slices while a tool is in the hand.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    editing : GrainEditing

    Attributes
    ----------
    changed : signal
        Another tool, or another brush.
    tool : str
        "seeds", "line", "new", "paint", "erase", "fill", or nothing.
    seeds : list of (z, y, x)
        Where the grain that is being split was clicked.
    radius : float
        Of the brush, in voxels of the smallest edge.
    in_space : bool
        Whether the brush is a ball and not a disk in the slice.
    level : float or None
        Grey value that bounds a new grain; None for one that is told from what is around it.
    """

    changed = Signal()

    def __init__(self, studio: Studio, view: SceneView, editing: GrainEditing) -> None:
        super().__init__(studio)
        self._studio, self._view, self._space = studio, view, studio.workspace
        self._editing = editing
        self.tool = ""
        self.seeds: list[Voxel] = []
        self.radius, self.in_space = 4.0, False
        self.level: float | None = None
        self._stroke: list[Voxel] = []
        self._axis = 0
        self._clicked: Voxel | None = None
        self._proposal: Proposal | None = None
        self._takes_next = False
        self._split_label: int | None = None
        self._space.grains_changed.connect(self._grains_changed)
        self._space.selection_changed.connect(self._show_brush)

    # ---- taking tools up and putting them down ---------------------------------------------------

    def take_up(self, tool: str) -> None:
        """Let the left button in the slices belong to a tool; the same one again puts it down."""
        if tool == self.tool:
            self.stop()
            return
        self.stop()
        self.tool, self._view.slice_tool = tool, self
        self._studio.give_hint(tr(_HINTS[tool]))
        self._show_brush()
        self._view.mark_voxels(())
        self.changed.emit()
        self._studio.refresh()

    def stop(self) -> None:
        """Put the tool down, and give up what was not taken."""
        if not self.tool:
            return
        self._withdraw()
        self.tool, self._view.slice_tool, self._view.brush = "", None, None
        self._studio.give_hint("")
        self._view.mark_voxels(())
        self.changed.emit()
        self._studio.refresh()

    @property
    def can_be_put_down(self) -> bool:
        """Whether there is a tool, and no message that the key closes first."""
        return bool(self.tool) and not self._studio.messages.text

    def set_radius(self, radius: float) -> None:
        """Let the brush have another radius, in voxels."""
        self.radius = float(np.clip(radius, 0.5, LARGEST_RADIUS))
        self._brush_changed()

    def set_in_space(self, in_space: bool) -> None:
        """Paint with a ball, or with a disk in the slice alone."""
        self.in_space = in_space
        self._brush_changed()

    def set_level(self, level: float | None) -> None:
        """Bound a new grain by another grey value, the one that is shown too."""
        self.level = level
        if self.tool == "new" and self._clicked is not None:
            self._propose_new(self._clicked)
        self.changed.emit()

    def go_further(self, step: int) -> None:
        """Make the brush larger or smaller by a voxel; for new grains, change the grey value."""
        if self.tool != "new":
            by = 1.0 if self.radius + step > 2 else 0.5
            self.set_radius(self.radius + by * step)
            return
        slices = self._view.scene.layers.slices.planes
        level = self._shown_level()
        if slices is not None and level is not None:
            low, high = slices.window
            self.set_level(level + step * _LEVEL_STEP * (high - low))

    def _shown_level(self) -> float | None:
        if self.level is not None or self._proposal is None or self._proposal.outcome is None:
            return self.level
        edit = self._proposal.outcome.edit
        return edit.threshold if isinstance(edit, NewGrain) else None

    def _brush_changed(self) -> None:
        self._show_brush()
        self.changed.emit()

    def _show_brush(self) -> None:
        """Let the slices show what the tool draws with."""
        grains, tokens = self._space.state.grains, self._studio.theme.tokens
        brush = None
        if self.tool == "line":
            brush = Brush(tokens.accent)
        elif self.tool in ("paint", "erase") and grains is not None:
            label = self._space.selected
            colour = tokens.accent if label is None else _colour_of(label)
            radius = self.radius * min(grains.voxel_size.zyx)
            brush = Brush(tokens.danger if self.tool == "erase" else colour, radius)
        if brush != self._view.brush and (self.tool or self._view.slice_tool is None):
            self._view.brush = brush
            self._view.slices_changed.emit()

    def _grains_changed(self) -> None:
        if self.tool in KEEPING and self._space.state.grains is not None:
            self._stroke = []
        else:
            self.stop()

    # ---- the mouse in a slice --------------------------------------------------------------------

    def stroke(self, voxel: Voxel, axis: int, begun: bool) -> None:
        """Take a place of the mouse in a slice."""
        if begun:
            self._stroke, self._axis = [], axis
        if voxel not in self._stroke[-1:]:
            self._stroke.append(voxel)
        if begun and self.tool == "seeds":
            self._add_seed(voxel)
        elif begun and self.tool == "new":
            self._propose_new(voxel)
        elif begun and self.tool == "fill":
            self._fill(voxel)

    def end_stroke(self) -> None:
        """Paint, erase or part a grain where the mouse has been."""
        places, self._stroke = self._stroke, []
        if places and self.tool == "line":
            self._propose_line(places)
        elif places and self.tool in ("paint", "erase"):
            self._paint(places)

    def _paint(self, places: list[Voxel]) -> None:
        label = self._space.selected
        if label is None and self.tool == "erase":
            self._studio.say("warning", tr("Select the grain to erase from."))
            return
        centres = tuple((float(z), float(y), float(x)) for z, y, x in places)
        labels = () if label is None else (label,)
        axis = None if self.in_space else self._axis
        edit: Edit = Erase(labels=labels, centres=centres, radius=self.radius, axis=axis)
        title = tr("Erase")
        if self.tool == "paint":
            edit, title = Paint(labels=labels, centres=centres, radius=self.radius, axis=axis), tr("Paint")
        outcome = self._editing.make(edit, title)
        if outcome is not None and label is None and outcome.new:
            self._space.select(min(outcome.new))

    def _fill(self, voxel: Voxel) -> None:
        label = self._space.selected
        if label is None:
            self._studio.say("warning", tr("Select the grain to fill first."))
            return
        edit = Fill(labels=(label,), at=voxel, axis=self._axis)
        self._editing.make(edit, tr("Fill"), tr("Filled grain {label} in this slice.", label=label))

    # ---- what is shown before it is taken ---------------------------------------------------------

    @property
    def can_accept(self) -> bool:
        """Whether something is shown, or being made, that can be taken."""
        return self._proposal is not None

    def accept(self) -> None:
        """Take what is shown; if it is still being made, as soon as it is there."""
        proposal = self._proposal
        if proposal is None:
            return
        if proposal.outcome is None:
            self._takes_next = True
            return
        self._proposal = None  # what the slices show is what they will show
        try:
            self._space.take_edit(proposal.outcome, proposal.begun, proposal.title)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            self.stop()
            return
        self._editing.tell(proposal.outcome, proposal.told)
        if isinstance(proposal.edit, NewGrain) and proposal.outcome.new:
            self._space.select(max(proposal.outcome.new))

    def _propose(self, edit: Edit, title: str, told: str, voxels: int) -> None:
        """Show what would become of an edit that looks at so many voxels."""
        scan = self._space.scan
        try:
            begun = self._space.project.grains_to_edit(scan)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return
        wanted = Proposal(edit, begun, title, told)
        self._proposal, self._takes_next = wanted, False
        if voxels <= _AT_ONCE:
            try:
                outcome = begun.edit(edit, scan)
            except EditError as error:
                self._refuse(wanted, error)
            else:
                self._show(wanted, outcome)
            return

        def attempt(_: object) -> EditOutcome[GrainSet] | EditError:
            try:
                return begun.edit(edit, scan)
            except EditError as error:
                return error  # what cannot be made is no failure of the program

        def done(found: EditOutcome[GrainSet] | EditError) -> None:
            if isinstance(found, EditError):
                self._refuse(wanted, found)
            else:
                self._show(wanted, found)

        task = Task(tr("Trying the correction"), attempt)
        task.succeeded.connect(done)
        self._studio.queue.submit(task, lane="preview", key="correction")
        self._studio.refresh()

    def _show(self, wanted: Proposal, outcome: EditOutcome[GrainSet]) -> None:
        if self._proposal is not wanted:
            return
        self._proposal = Proposal(wanted.edit, wanted.begun, wanted.title, wanted.told, outcome)
        self._view.outline(outcome.grains)
        self._studio.refresh()
        self.changed.emit()
        if self._takes_next:
            self.accept()

    def _refuse(self, wanted: Proposal, error: Exception) -> None:
        if self._proposal is not wanted:
            return
        self._proposal = None
        if self.tool == "seeds" and self.seeds:
            self.seeds.pop()
            self._view.mark_voxels(self.seeds)
        self._view.outline(self._space.state.grains)
        self._studio.say("warning", str(error))
        self._studio.refresh()

    def _withdraw(self) -> None:
        """Forget what was begun and not taken."""
        shown = self._proposal is not None
        self.seeds, self._stroke, self._proposal, self._split_label = [], [], None, None
        self._clicked, self._takes_next, self.level = None, False, None
        if shown:
            self._view.outline(self._space.state.grains)

    def _add_seed(self, voxel: Voxel) -> None:
        grains = self._grains_here()
        if grains is None:
            return
        label = int(grains.label_volume[voxel])
        if not label:
            self._studio.say("warning", tr("There is no grain at this place: click inside one."))
            return
        if self._split_label not in (None, label):
            self.seeds = []  # another grain is to be split
        self._split_label, self._proposal = label, None
        self.seeds.append(voxel)
        self._view.mark_voxels(self.seeds)
        self._space.select(label)
        if len(self.seeds) < 2:
            self._view.outline(grains)
            self._studio.refresh()
            return
        self._propose(
            Split(labels=(label,), seeds=tuple(self.seeds), by_grey=self._space.scan is not None),
            tr("Split grain {label}", label=label),
            tr("Split grain {label} into {count}.", label=label, count=len(self.seeds)),
            _voxels_about(grains, label),
        )

    def _propose_line(self, places: list[Voxel]) -> None:
        grains = self._grains_here()
        if grains is None:
            return
        label = grain_under(grains.label_volume, places, self._space.selected)
        if label is None:
            self._studio.say("warning", tr("There is no grain under the line: draw it across one."))
            return
        corners = tuple((float(z), float(y), float(x)) for z, y, x in simplified(places))
        self._space.select(label)
        self._propose(
            SplitAlong(labels=(label,), points=corners, axis=self._axis),
            tr("Split grain {label}", label=label),
            tr("Split grain {label} along the line.", label=label),
            _voxels_about(grains, label),
        )

    def _propose_new(self, voxel: Voxel) -> None:
        if self._grains_here() is None:
            return
        if self._space.scan is None:
            self._studio.say("warning", tr("A new grain needs the scan: open it first, or paint the grain."))
            return
        self._clicked = voxel
        self._view.mark_voxels([voxel])
        # How far it reaches is not known before.
        self._propose(
            NewGrain(at=voxel, threshold=self.level),
            tr("New grain"),
            tr("Made a new grain."),
            int(np.prod(self._space.scan.shape)),
        )

    def _grains_here(self) -> GrainSet | None:
        """Return the grains if they lie in what the slices show."""
        grains, scan = self._space.state.grains, self._space.sliced
        there = grains is not None and scan is not None and grains.label_volume.shape == scan.shape
        return grains if there else None


def _voxels_about(grains: GrainSet, label: int) -> int:
    row = grains.table.loc[grains.table["label"] == label].iloc[0]
    return int((row.z1 - row.z0) * (row.y1 - row.y0) * (row.x1 - row.x0))


def _colour_of(label: int) -> str:
    red, green, blue = label_colours(label)[label].tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"
