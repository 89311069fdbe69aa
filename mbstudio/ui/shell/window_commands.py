"""The window's commands: the one place where each has its title, shortcut and condition."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.shell.shell_commands import dock_commands, edit_commands, help_commands, recovery_commands
from mbstudio.ui.stations.latent.commands import latent_commands
from mbstudio.ui.stations.populations.commands import population_commands
from mbstudio.ui.stations.style.commands import style_commands
from mbstudio.ui.view.tool_commands import tool_commands
from mbstudio.ui.view.view_commands import view_commands

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

MENUS = (
    mark("File"), mark("Edit"), mark("Grains"), mark("Fit"), mark("Populations"), mark("Style"),
    mark("Latent"), mark("View"), mark("Tools"), mark("Help"),
)  # fmt: skip
"""As commands name them; shown through `tr`."""


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
            tr("Open scan…"),
            window.files.ask_scan,
            "File",
            "Ctrl+O",
            "ph.folder-open",
            tr("Open a TIFF stack, RAW, NPY, NRRD or MetaImage file"),
        ),
        Command(
            "scan.open_folder",
            tr("Open folder of slices…"),
            window.files.ask_scan_folder,
            "File",
            "",
            "ph.folders",
            tr("Open a folder of TIFF or PNG slices"),
        ),
        Command(
            "scan.sample",
            tr("Open the sample scan"),
            window.files.open_sample,
            "File",
            "",
            "ph.sparkle",
            tr("A synthetic scan of grains in contact, made by mbstudio"),
        ),
        Command(
            "project.new",
            tr("New project"),
            window.files.new_project,
            "File",
            "Ctrl+N",
            "ph.file",
            tr("Begin with an empty project"),
            separated=True,
        ),
        Command(
            "project.open",
            tr("Open project…"),
            window.files.ask_project,
            "File",
            "Ctrl+Shift+O",
            "ph.folder-simple",
            tr("Open a project file (*.mbs)"),
        ),
        Command(
            "project.save",
            tr("Save project"),
            window.files.save,
            "File",
            "Ctrl+S",
            "ph.floppy-disk",
            tr("Write the project to its file"),
            lambda: space.is_modified and space.can_be_saved,
        ),
        Command(
            "project.save_as",
            tr("Save project as…"),
            window.files.save_as,
            "File",
            "Ctrl+Shift+S",
            "",
            tr("Write the project to another file"),
            lambda: space.can_be_saved,
        ),
        Command(
            "view.screenshot",
            tr("Save picture of the view…"),
            window.files.ask_screenshot,
            "File",
            "Ctrl+Shift+C",
            "ph.camera",
            tr("Save the 3-D view as PNG"),
            lambda: window.has_view,
            separated=True,
        ),
        Command(
            "window.quit",
            tr("Quit"),
            window.close,
            "File",
            "Ctrl+Q",
            "",
            tr("Close the window"),
            separated=True,
        ),
    ]


def _edit(window: MainWindow) -> list[Command]:
    return [
        Command(
            "edit.undo",
            tr("Undo"),
            window.undo,
            "Edit",
            "Ctrl+Z",
            "ph.arrow-counter-clockwise",
            tr("Take the last change back"),
            lambda: window.shaping.history()[0] is not None,
        ),
        Command(
            "edit.redo",
            tr("Redo"),
            window.redo,
            "Edit",
            "Ctrl+Shift+Z",
            "ph.arrow-clockwise",
            tr("Make the last undone change again"),
            lambda: window.shaping.history()[1] is not None,
        ),
        Command(
            "work.cancel",
            tr("Cancel the running task"),
            window.cancel_task,
            "Edit",
            "Ctrl+.",
            "ph.x-circle",
            tr("Stop what is shown in the status bar"),
            lambda: window.queue.running() is not None,
            separated=True,
        ),
        Command(
            "message.dismiss",
            tr("Close the message"),
            window.messages.dismiss,
            "Edit",
            "Esc",
            "",
            tr("Take the message above the view away"),
            lambda: bool(window.messages.text),
        ),
    ]


def _grains(window: MainWindow) -> list[Command]:
    space = window.workspace
    return [
        Command(
            "grains.find",
            tr("Find grains"),
            window.find_grains,
            "Grains",
            "Ctrl+G",
            "ph.magnifying-glass",
            tr("Tell the grains of the scan apart"),
            lambda: window.may_find_grains,
        ),
        Command(
            "grains.load",
            tr("Load labels…"),
            window.files.ask_labels,
            "Grains",
            "",
            "ph.folder-open",
            tr("Take a label image made elsewhere"),
            lambda: window.may_find_grains,
        ),
        Command(
            "grains.next",
            tr("Next grain"),
            partial(window.step_grain, 1),
            "Grains",
            "Ctrl+Down",
            "ph.caret-down",
            tr("Choose the next row of the table"),
            lambda: space.state.grains is not None,
            separated=True,
        ),
        Command(
            "grains.previous",
            tr("Previous grain"),
            partial(window.step_grain, -1),
            "Grains",
            "Ctrl+Up",
            "ph.caret-up",
            tr("Choose the row above"),
            lambda: space.state.grains is not None,
        ),
        Command(
            "grains.unselect",
            tr("Choose no grain"),
            partial(space.select, None),
            "Grains",
            "Ctrl+D",
            "",
            tr("Show all grains in their colours"),
            lambda: space.selected is not None,
        ),
    ]


def _fit(window: MainWindow) -> list[Command]:
    space, fits = window.workspace, window.fits
    return [
        Command(
            "fit.grain",
            tr("Fit grain"),
            window.fit_grain,
            "Fit",
            "Ctrl+F",
            "ph.play-circle",
            tr("Fit an avatar to the chosen grain"),
            lambda: space.selected is not None and not fits.is_running,
        ),
        Command(
            "fit.all",
            tr("Fit all grains"),
            window.fit_all,
            "Fit",
            "Ctrl+Shift+F",
            "ph.fast-forward-circle",
            tr("Fit every grain inside the scan that has no avatar yet"),
            lambda: bool(fits.unfitted()) and not window.is_fitting_all,
        ),
        Command(
            "fit.pause",
            tr("Pause or resume the fit"),
            fits.pause,
            "Fit",
            "Ctrl+Space",
            "ph.pause-circle",
            tr("Halt the search, or let it go on"),
            lambda: fits.is_running,
            separated=True,
        ),
        Command(
            "fit.stop",
            tr("Stop the fit and keep the avatar"),
            fits.stop,
            "Fit",
            "",
            "ph.stop-circle",
            tr("End the search with the avatar as it stands"),
            lambda: fits.is_running,
        ),
        Command(
            "fit.more",
            tr("More generations"),
            window.more_generations,
            "Fit",
            "",
            "ph.plus-circle",
            tr("Let the last search go on"),
            lambda: fits.can_go_on(space.selected),
        ),
        Command(
            "fit.sweep",
            tr("Sweep over n"),
            window.show_sweep,
            "Fit",
            "Ctrl+Shift+N",
            "ph.chart-line",
            tr("Loss and errors of the chosen grains against n, at station Fit"),
            lambda: space.state.grains is not None,
            checked=lambda: not window.sweep_dock.isHidden(),
        ),
        Command(
            "export.run",
            tr("Export avatars"),
            window.export,
            "Fit",
            "Ctrl+E",
            "ph.export",
            tr("Write the avatars for the DEM engine chosen at station Export"),
            lambda: window.panels_export.is_ready,
            separated=True,
        ),
    ]


def _help(window: MainWindow) -> list[Command]:
    return [
        Command(
            "help.palette",
            tr("Command palette"),
            window.open_palette,
            "Help",
            "Ctrl+Shift+P; Ctrl+K",
            "ph.command",
            tr("Find any command by typing"),
        ),
        Command(
            "help.about",
            tr("About MetaBall Studio"),
            window.about,
            "Help",
            "",
            "ph.info",
            tr("Versions, graphics and licence"),
        ),
    ]
