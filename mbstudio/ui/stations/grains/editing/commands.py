"""The commands that correct grains."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.grains.editing.grain_editing import GrainEditing
from mbstudio.ui.stations.grains.editing.slice_editing import SliceEditing
from mbstudio.ui.workspace import Workspace


def edit_commands(
    space: Workspace,
    editing: GrainEditing,
    tools: SliceEditing,
    is_open: Callable[[], bool],
    shows_grains: Callable[[], bool],
) -> list[Command]:
    """Return the commands that change grains by hand.

    Parameters
    ----------
    space : Workspace
    editing : GrainEditing
    tools : SliceEditing
    is_open : callable
        Whether station Grains is open: tools in the slices count only there.
    shows_grains : callable
        Whether the open station shows all grains: there what concerns the chosen ones can be done.
    """

    def has_grains() -> bool:
        return is_open() and space.state.grains is not None

    def has_choice() -> bool:
        return shows_grains() and bool(space.chosen)

    return [
        *_of_chosen(space, editing, has_choice),
        *_tools(tools, has_grains),
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
            words=lambda: (
                tr("Merge {count} grains", count=len(space.chosen))
                if len(space.chosen) > 1
                else tr("Merge grains")
            ),
            is_about_grains=True,
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
            words=lambda: plural(len(space.chosen) or 1, mark("Delete grain"), mark("Delete {count} grains")),
            is_about_grains=True,
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
            words=editing.words_of_exclusion,
            is_about_grains=True,
        ),
    ]


def _tools(tools: SliceEditing, has_grains: Callable[[], bool]) -> list[Command]:
    given = (
        (
            "split", "seeds", tr("Split a grain by seeds"), "S", "ph.scissors",
            tr("Click a seed in each part of a grain in the slices; the split is shown before it is taken"),
        ),
        (
            "split_line", "line", tr("Split a grain along a line"), "Shift+S", "ph.line-segment",
            tr("Draw a line across a grain in a slice; the split is shown before it is taken"),
        ),
        (
            "new_grain", "new", tr("New grain by a click"), "W", "ph.magic-wand",
            tr("Click what is no grain yet: it grows within its grey values, and is shown before it counts"),
        ),
        (
            "paint", "paint", tr("Paint"), "B", "ph.paint-brush",
            tr("Paint the selected grain in the slices with a round brush; a new grain if none is selected"),
        ),
        (
            "erase", "erase", tr("Erase"), "E", "ph.eraser",
            tr("Erase from the selected grain in the slices with a round brush"),
        ),
        (
            "fill", "fill", tr("Fill by a click"), "F", "ph.paint-bucket",
            tr("Click void that the selected grain encloses in a slice"),
        ),
    )  # fmt: skip
    return [
        *(
            Command(
                id=f"grains.{name}",
                title=title,
                run=partial(_take_up, tools, tool),
                menu="Grains",
                shortcut=keys,
                icon=icon,
                tip=tip,
                enabled=has_grains,
                checked=partial(_is_in_hand, tools, tool),
                is_about_grains=tool == "seeds",
            )
            for name, tool, title, keys, icon, tip in given
        ),
        *_of_tool(tools),
    ]


def _take_up(tools: SliceEditing, tool: str, _on: bool = True) -> None:
    tools.take_up(tool)


def _is_in_hand(tools: SliceEditing, tool: str) -> bool:
    return tools.tool == tool


def _of_tool(tools: SliceEditing) -> list[Command]:
    return [
        Command(
            id="grains.accept_split",
            title=tr("Take what is shown"),
            run=tools.accept,
            menu="Grains",
            tip=tr("Take the split or the new grain that the slices show"),
            enabled=lambda: tools.can_accept,
        ),
        Command(
            id="grains.larger_brush",
            title=tr("Larger brush"),
            run=lambda: tools.go_further(1),
            menu="Grains",
            shortcut="]",
            tip=tr("Make the brush larger; with “New grain”, raise the grey value"),
            enabled=lambda: tools.tool in ("paint", "erase", "new"),
        ),
        Command(
            id="grains.smaller_brush",
            title=tr("Smaller brush"),
            run=lambda: tools.go_further(-1),
            menu="Grains",
            shortcut="[",
            tip=tr("Make the brush smaller; with “New grain”, lower the grey value"),
            enabled=lambda: tools.tool in ("paint", "erase", "new"),
        ),
        Command(
            id="grains.brush_in_space",
            title=tr("Paint in space"),
            run=tools.set_in_space,
            menu="Grains",
            shortcut="Shift+B",
            tip=tr("Paint with a ball, and not with a disk in the slice"),
            enabled=lambda: tools.tool in ("paint", "erase"),
            checked=lambda: tools.in_space,
        ),
        Command(
            id="grains.put_down",
            title=tr("End the tool"),
            run=tools.stop,
            menu="Grains",
            shortcut="Esc",
            tip=tr("Put the tool down; what was not taken is given up"),
            enabled=lambda: tools.can_be_put_down,
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
            separated=name == "grow", is_about_grains=True,
        )
        for name, title, run, tip in given
    ]  # fmt: skip
