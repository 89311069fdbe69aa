"""The commands of the shell: files, undo, stations, panels, theme and help."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, tr
from mbstudio.ui.shell.project_files import ProjectFiles
from mbstudio.ui.shell.shell import Shell
from mbstudio.ui.shell.undo import Undo
from mbstudio.ui.stations.registry import Stations
from mbstudio.ui.studio import Studio
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.pictures import Pictures
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.view.slice_views import SliceViews

_FIRST_MENUS = (mark("File"), mark("Edit"))
_LAST_MENUS = (mark("View"), mark("Tools"), mark("Help"))


def menu_names(stations: Stations) -> list[str]:
    """Return the menus in their order, as commands name them; shown through `tr`."""
    return [*_FIRST_MENUS, *(station.menu for station in stations if station.menu), *_LAST_MENUS]


def in_menu_order(commands: list[Command], stations: Stations) -> list[Command]:
    """Return commands as menus show them: those of one menu together, in the order that they are given."""
    menus = menu_names(stations)
    return sorted(commands, key=lambda command: menus.index(command.menu))


def station_commands(stations: Stations) -> list[Command]:
    """Return what goes to each station."""
    return [
        Command(
            id=f"station.{station.id}",
            title=tr("Go to {station}", station=tr(station.title)),
            run=partial(stations.enter, station.id),
            menu="View",
            shortcut=stations.shortcut_of(station),
            icon=station.icon,
            tip=tr(station.tip),
        )
        for station in stations
    ]


def file_commands(
    studio: Studio,
    files: ProjectFiles,
    shell: Shell,
    view: SceneView,
    pictures: Pictures,
    close: Callable[[], object],
) -> list[Command]:
    """Return projects, pictures and what a crash has left, for the menu File."""
    return [
        *_project_commands(files, studio),
        Command(
            id="view.screenshot",
            title=tr("Save picture of the view…"),
            run=pictures.ask_file,
            menu="File",
            shortcut="Ctrl+Shift+C",
            icon="ph.camera",
            tip=tr("Save the 3-D view as PNG"),
            enabled=lambda: view.has_content,
            separated=True,
        ),
        Command(
            id="window.quit",
            title=tr("Quit"),
            run=close,
            menu="File",
            shortcut="Ctrl+Q",
            tip=tr("Close the window"),
            separated=True,
        ),
        Command(
            id="project.restore",
            title=tr("Restore unsaved work"),
            run=lambda: shell.restore(),
            menu="File",
            icon="ph.clock-counter-clockwise",
            tip=tr("Restore the work that was open when the program crashed"),
            enabled=lambda: bool(shell.autosaves.leftovers),
        ),
    ]


def _project_commands(files: ProjectFiles, studio: Studio) -> list[Command]:
    space = studio.workspace
    return [
        Command(
            id="project.new",
            title=tr("New project"),
            run=files.new_project,
            menu="File",
            shortcut="Ctrl+N",
            icon="ph.file",
            tip=tr("Start with an empty project"),
            separated=True,
        ),
        Command(
            id="project.open",
            title=tr("Open project…"),
            run=files.ask_project,
            menu="File",
            shortcut="Ctrl+Shift+O",
            icon="ph.folder-simple",
            tip=tr("Open a project file (*.mbs)"),
        ),
        Command(
            id="project.save",
            title=tr("Save project"),
            run=files.save,
            menu="File",
            shortcut="Ctrl+S",
            icon="ph.floppy-disk",
            tip=tr("Save the project to its file"),
            enabled=lambda: space.is_modified and space.can_be_saved,
        ),
        Command(
            id="project.save_as",
            title=tr("Save project as…"),
            run=files.save_as,
            menu="File",
            shortcut="Ctrl+Shift+S",
            tip=tr("Save the project to another file"),
            enabled=lambda: space.can_be_saved,
        ),
    ]


def edit_commands(studio: Studio, undo: Undo, shell: Shell) -> list[Command]:
    """Return undo, tasks, messages, history and preferences, for the menu Edit."""
    return [
        Command(
            id="edit.undo",
            title=tr("Undo"),
            run=undo.undo,
            menu="Edit",
            shortcut="Ctrl+Z",
            icon="ph.arrow-counter-clockwise",
            tip=tr("Undo the last change"),
            enabled=lambda: undo.undo_title is not None,
        ),
        Command(
            id="edit.redo",
            title=tr("Redo"),
            run=undo.redo,
            menu="Edit",
            shortcut="Ctrl+Shift+Z",
            icon="ph.arrow-clockwise",
            tip=tr("Redo the change that was undone last"),
            enabled=lambda: undo.redo_title is not None,
        ),
        Command(
            id="work.cancel",
            title=tr("Cancel the running task"),
            run=partial(_cancel_task, studio),
            menu="Edit",
            shortcut="Ctrl+.",
            icon="ph.x-circle",
            tip=tr("Stop the task shown in the status bar"),
            enabled=lambda: studio.queue.running() is not None,
            separated=True,
        ),
        Command(
            id="message.dismiss",
            title=tr("Close the message"),
            run=studio.messages.dismiss,
            menu="Edit",
            shortcut="Esc",
            tip=tr("Close the message above the view"),
            enabled=lambda: bool(studio.messages.text),
        ),
        shell.history_frame.command(
            tr("History"),
            tr("Show all changes; click one to return to it"),
            shortcut="Ctrl+H",
            icon="ph.clock-counter-clockwise",
            show=shell.show_history,
            menu="Edit",
        ),
        Command(
            id="window.preferences",
            title=tr("Preferences…"),
            run=shell.open_preferences,
            menu="Edit",
            shortcut="Ctrl+,",
            icon="ph.gear",
            tip=tr("Theme, processes, autosave"),
            separated=True,
        ),
    ]


def _cancel_task(studio: Studio) -> None:
    task = studio.queue.running()
    if task is not None:
        task.cancel()


def panel_commands(
    studio: Studio, shell: Shell, slice_views: SliceViews, reset_layout: Callable[[], object]
) -> list[Command]:
    """Return slices, layout, theme, gallery and log, for the menu View."""
    return [
        slice_views.frame.command(
            tr("Slice views"),
            tr("Show or hide the three slices as flat pictures, at stations Scan and Grains"),
            shortcut="Ctrl+Shift+L",
            icon="ph.columns",
            enabled=lambda: slice_views.is_offered,
            show=slice_views.show,
        ),
        Command(
            id="panel.reset",
            title=tr("Reset layout"),
            run=reset_layout,
            menu="View",
            tip=tr("Reset the size and place of all panels"),
        ),
        *_theme_commands(studio),
        shell.gallery_link.frame.command(
            tr("Gallery"),
            tr("Show or hide the pictures of all grains, avatars and clones"),
            shortcut="Ctrl+I",
            icon="ph.squares-four",
            show=shell.show_gallery,
        ),
        shell.log_frame.command(
            tr("Messages and log"),
            tr("Show or hide all messages so far"),
            shortcut="Ctrl+Shift+M",
            icon="ph.list-bullets",
            show=shell.show_log,
        ),
    ]


def _theme_commands(studio: Studio) -> list[Command]:
    theme: Theme = studio.theme

    def choose(choice: str, _checked: bool = True) -> None:
        theme.choose(choice)
        studio.commands.refresh()

    def is_chosen(choice: str) -> bool:
        return theme.choice == choice

    return [
        Command(
            id=f"theme.{choice}",
            title=title,
            run=partial(choose, choice),
            menu="View",
            icon=icon,
            tip=tip,
            checked=partial(is_chosen, choice),
            separated=choice == "system",
        )
        for choice, title, icon, tip in (
            (
                "system",
                tr("Theme: as the system"),
                "ph.circle-half",
                tr("Follow the system's light or dark theme"),
            ),
            ("light", tr("Theme: light"), "ph.sun", tr("Dark text on light")),
            ("dark", tr("Theme: dark"), "ph.moon", tr("Light text on dark")),
        )
    ]


def help_commands(
    shell: Shell, open_palette: Callable[[], object], about: Callable[[], object]
) -> list[Command]:
    """Return the menu Help."""
    return [
        Command(
            id="help.guide",
            title=tr("Guide to this station"),
            run=lambda: shell.open_guide(),
            menu="Help",
            shortcut="F1",
            icon="ph.question",
            tip=tr("Open the user guide at the section on this station"),
        ),
        Command(
            id="help.shortcuts",
            title=tr("Keyboard shortcuts"),
            run=shell.open_shortcuts,
            menu="Help",
            shortcut="?",
            icon="ph.keyboard",
            tip=tr("Show all shortcuts on one sheet"),
        ),
        Command(
            id="help.tour",
            title=tr("Tour in five steps"),
            run=shell.start_tour,
            menu="Help",
            icon="ph.map-trifold",
            tip=tr("Show where everything is"),
        ),
        Command(
            id="help.palette",
            title=tr("Command palette"),
            run=open_palette,
            menu="Help",
            shortcut="Ctrl+Shift+P; Ctrl+K",
            icon="ph.command",
            tip=tr("Find any command by typing"),
        ),
        Command(
            id="help.about",
            title=tr("About MetaBall Studio"),
            run=about,
            menu="Help",
            icon="ph.info",
            tip=tr("Versions, graphics and licence"),
        ),
    ]
