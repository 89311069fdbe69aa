"""The window's commands: the one place where each has its title, shortcut and condition."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.latent_commands import latent_commands
from mbstudio.ui.population_commands import population_commands
from mbstudio.ui.shell_commands import dock_commands, edit_commands, help_commands, recovery_commands
from mbstudio.ui.style_commands import style_commands
from mbstudio.ui.tool_commands import tool_commands
from mbstudio.ui.view_commands import view_commands

if TYPE_CHECKING:
    from mbstudio.ui.main_window import MainWindow

MENUS = ("File", "Edit", "Grains", "Fit", "Populations", "Style", "Latent", "View", "Help")


def window_commands(window: MainWindow) -> list[Command]:
    """Return every command of the window."""
    return [
        *_file(window),
        *recovery_commands(window),
        *_edit(window),
        *edit_commands(window),
        *_grains(window),
        *_fit(window),
        *population_commands(window),
        *style_commands(window),
        *latent_commands(window),
        *view_commands(window),
        *tool_commands(window),
        *dock_commands(window),
        *help_commands(window),
        *_help(window),
    ]


def _file(window: MainWindow) -> list[Command]:
    space = window.workspace
    return [
        Command(
            "scan.open",
            "Open scan…",
            window.files.ask_scan,
            "File",
            "Ctrl+O",
            "ph.folder-open",
            "Open a TIFF stack, RAW, NPY, NRRD or MetaImage file",
        ),
        Command(
            "scan.open_folder",
            "Open folder of slices…",
            window.files.ask_scan_folder,
            "File",
            "",
            "ph.folders",
            "Open a folder of TIFF or PNG slices",
        ),
        Command(
            "scan.sample",
            "Open the sample scan",
            window.files.open_sample,
            "File",
            "",
            "ph.sparkle",
            "A synthetic scan of grains in contact, made by mbstudio",
        ),
        Command(
            "project.new",
            "New project",
            window.files.new_project,
            "File",
            "Ctrl+N",
            "ph.file",
            "Begin with an empty project",
            separated=True,
        ),
        Command(
            "project.open",
            "Open project…",
            window.files.ask_project,
            "File",
            "Ctrl+Shift+O",
            "ph.folder-simple",
            "Open a project file (*.mbs)",
        ),
        Command(
            "project.save",
            "Save project",
            window.files.save,
            "File",
            "Ctrl+S",
            "ph.floppy-disk",
            "Write the project to its file",
            lambda: space.is_modified and space.can_be_saved,
        ),
        Command(
            "project.save_as",
            "Save project as…",
            window.files.save_as,
            "File",
            "Ctrl+Shift+S",
            "",
            "Write the project to another file",
            lambda: space.can_be_saved,
        ),
        Command(
            "view.screenshot",
            "Save picture of the view…",
            window.files.ask_screenshot,
            "File",
            "Ctrl+Shift+C",
            "ph.camera",
            "Save the 3-D view as PNG",
            lambda: window.has_view,
            separated=True,
        ),
        Command(
            "window.quit", "Quit", window.close, "File", "Ctrl+Q", "", "Close the window", separated=True
        ),
    ]


def _edit(window: MainWindow) -> list[Command]:
    return [
        Command(
            "edit.undo",
            "Undo",
            window.undo,
            "Edit",
            "Ctrl+Z",
            "ph.arrow-counter-clockwise",
            "Take the last change back",
            lambda: window.shaping.history()[0] is not None,
        ),
        Command(
            "edit.redo",
            "Redo",
            window.redo,
            "Edit",
            "Ctrl+Shift+Z",
            "ph.arrow-clockwise",
            "Make the last undone change again",
            lambda: window.shaping.history()[1] is not None,
        ),
        Command(
            "work.cancel",
            "Cancel the running task",
            window.cancel_task,
            "Edit",
            "Ctrl+.",
            "ph.x-circle",
            "Stop what is shown in the status bar",
            lambda: window.queue.running() is not None,
            separated=True,
        ),
        Command(
            "message.dismiss",
            "Close the message",
            window.messages.dismiss,
            "Edit",
            "Esc",
            "",
            "Take the message above the view away",
            lambda: bool(window.messages.text),
        ),
    ]


def _grains(window: MainWindow) -> list[Command]:
    space = window.workspace
    return [
        Command(
            "grains.find",
            "Find grains",
            window.find_grains,
            "Grains",
            "Ctrl+G",
            "ph.magnifying-glass",
            "Tell the grains of the scan apart",
            lambda: window.may_find_grains,
        ),
        Command(
            "grains.load",
            "Load labels…",
            window.files.ask_labels,
            "Grains",
            "",
            "ph.folder-open",
            "Take a label image made elsewhere",
            lambda: window.may_find_grains,
        ),
        Command(
            "grains.next",
            "Next grain",
            partial(window.step_grain, 1),
            "Grains",
            "Ctrl+Down",
            "ph.caret-down",
            "Choose the next row of the table",
            lambda: space.state.grains is not None,
            separated=True,
        ),
        Command(
            "grains.previous",
            "Previous grain",
            partial(window.step_grain, -1),
            "Grains",
            "Ctrl+Up",
            "ph.caret-up",
            "Choose the row above",
            lambda: space.state.grains is not None,
        ),
        Command(
            "grains.unselect",
            "Choose no grain",
            partial(space.select, None),
            "Grains",
            "Ctrl+D",
            "",
            "Show all grains in their colours",
            lambda: space.selected is not None,
        ),
    ]


def _fit(window: MainWindow) -> list[Command]:
    space, fits = window.workspace, window.fits
    return [
        Command(
            "fit.grain",
            "Fit grain",
            window.fit_grain,
            "Fit",
            "Ctrl+F",
            "ph.play-circle",
            "Fit an avatar to the chosen grain",
            lambda: space.selected is not None and not fits.is_running,
        ),
        Command(
            "fit.all",
            "Fit all grains",
            window.fit_all,
            "Fit",
            "Ctrl+Shift+F",
            "ph.fast-forward-circle",
            "Fit every grain inside the scan that has no avatar yet",
            lambda: bool(fits.unfitted()) and not window.is_fitting_all,
        ),
        Command(
            "fit.pause",
            "Pause or resume the fit",
            fits.pause,
            "Fit",
            "Ctrl+Space",
            "ph.pause-circle",
            "Halt the search, or let it go on",
            lambda: fits.is_running,
            separated=True,
        ),
        Command(
            "fit.stop",
            "Stop the fit and keep the avatar",
            fits.stop,
            "Fit",
            "",
            "ph.stop-circle",
            "End the search with the avatar as it stands",
            lambda: fits.is_running,
        ),
        Command(
            "fit.more",
            "More generations",
            window.more_generations,
            "Fit",
            "",
            "ph.plus-circle",
            "Let the last search go on",
            lambda: fits.can_go_on(space.selected),
        ),
        Command(
            "fit.sweep",
            "Sweep over n",
            window.show_sweep,
            "Fit",
            "Ctrl+Shift+N",
            "ph.chart-line",
            "Loss and errors of the chosen grains against n, at station Fit",
            lambda: space.state.grains is not None,
            checked=lambda: not window.sweep_dock.isHidden(),
        ),
        Command(
            "export.run",
            "Export avatars",
            window.export,
            "Fit",
            "Ctrl+E",
            "ph.export",
            "Write the avatars for the DEM engine chosen at station Export",
            lambda: window.panels_export.is_ready,
            separated=True,
        ),
    ]


def _help(window: MainWindow) -> list[Command]:
    return [
        Command(
            "help.palette",
            "Command palette",
            window.open_palette,
            "Help",
            "Ctrl+Shift+P; Ctrl+K",
            "ph.command",
            "Find any command by typing",
        ),
        Command(
            "help.about",
            "About MetaBall Studio",
            window.about,
            "Help",
            "",
            "ph.info",
            "Versions, graphics and licence",
        ),
    ]
