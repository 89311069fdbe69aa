"""The commands that correct grains."""

from __future__ import annotations

from collections.abc import Callable

from mbstudio.ui.commands import Command
from mbstudio.ui.language import tr
from mbstudio.ui.stations.grains.editing.grain_editing import GrainEditing
from mbstudio.ui.workspace import Workspace


def edit_commands(space: Workspace, editing: GrainEditing, is_open: Callable[[], bool]) -> list[Command]:
    """Return the commands of station Grains that change grains by hand; their keys count only there."""

    def has_grains() -> bool:
        return is_open() and space.state.grains is not None

    def has_choice() -> bool:
        return is_open() and bool(space.chosen)

    return [
        *_of_chosen(space, editing, has_choice),
        *_tools(editing, has_grains),
        *_outlines(editing, has_choice),
        Command(
            id="grains.save_labels",
            title=tr("Save labels…"),
            run=editing.ask_label_file,
            menu="Grains",
            icon="ph.floppy-disk",
            tip=tr("Save the label of every voxel as TIFF, NRRD or MHA"),
            enabled=has_grains,
            separated=True,
        ),
    ]


def _of_chosen(space: Workspace, editing: GrainEditing, has_choice: Callable[[], bool]) -> list[Command]:
    return [
        Command(
            id="grains.merge",
            title=tr("Merge grains"),
            run=editing.merge,
            menu="Grains",
            shortcut="M",
            icon="ph.intersect",
            tip=tr("Make the chosen grains one"),
            enabled=lambda: has_choice() and len(space.chosen) > 1,
            separated=True,
        ),
        Command(
            id="grains.delete",
            title=tr("Delete grains"),
            run=editing.delete,
            menu="Grains",
            shortcut="Del",
            icon="ph.trash",
            tip=tr("Take the chosen grains away"),
            enabled=has_choice,
        ),
        Command(
            id="grains.exclude",
            title=tr("Exclude or include grains"),
            run=editing.toggle_excluded,
            menu="Grains",
            shortcut="X",
            tip=tr(
                "Leave the chosen grains out of fits, populations, learning and export, or take them in again"
            ),
            enabled=has_choice,
        ),
    ]


def _tools(editing: GrainEditing, has_grains: Callable[[], bool]) -> list[Command]:
    return [
        Command(
            id="grains.split",
            title=tr("Split a grain by seeds"),
            run=lambda _on: editing.take_up("seeds"),
            menu="Grains",
            shortcut="S",
            icon="ph.scissors",
            tip=tr(
                "Click a seed in each part of a grain in the slices; the split is shown before it is taken"
            ),
            enabled=has_grains,
            checked=lambda: editing.tool == "seeds",
        ),
        Command(
            id="grains.accept_split",
            title=tr("Take the split"),
            run=editing.accept,
            menu="Grains",
            shortcut="Return; Enter",
            tip=tr("Take the split that the slices show"),
            enabled=lambda: editing.can_accept,
        ),
        Command(
            id="grains.paint",
            title=tr("Paint"),
            run=lambda _on: editing.take_up("paint"),
            menu="Grains",
            shortcut="B",
            icon="ph.paint-brush",
            tip=tr(
                "Paint the selected grain in the slices with a round brush; a new grain if none is selected"
            ),
            enabled=has_grains,
            checked=lambda: editing.tool == "paint",
        ),
        Command(
            id="grains.erase",
            title=tr("Erase"),
            run=lambda _on: editing.take_up("erase"),
            menu="Grains",
            shortcut="E",
            icon="ph.eraser",
            tip=tr("Erase from the selected grain in the slices with a round brush"),
            enabled=has_grains,
            checked=lambda: editing.tool == "erase",
        ),
        Command(
            id="grains.put_down",
            title=tr("End the tool"),
            run=editing.stop,
            menu="Grains",
            shortcut="Esc",
            tip=tr("Put the tool down; a split that was not taken is given up"),
            enabled=lambda: editing.can_be_put_down,
        ),
    ]


def _outlines(editing: GrainEditing, has_choice: Callable[[], bool]) -> list[Command]:
    given = (
        ("grow", tr("Grow grains by a voxel"), editing.grow, tr("Add the void all around the chosen grains")),
        (
            "shrink",
            tr("Shrink grains by a voxel"),
            editing.shrink,
            tr("Take a voxel all around off the chosen grains"),
        ),
        ("smooth", tr("Smooth grains"), editing.smooth, tr("Smooth the outlines of the chosen grains")),
        (
            "fill_holes",
            tr("Fill holes"),
            editing.fill_holes,
            tr("Give the chosen grains the void that they enclose"),
        ),
    )
    return [
        Command(
            id=f"grains.{name}", title=title, run=run, menu="Grains", tip=tip, enabled=has_choice,
            separated=name == "grow",
        )
        for name, title, run, tip in given
    ]  # fmt: skip
