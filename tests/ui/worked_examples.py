"""What the examples of CONTRIBUTING.md add, in the window of a copy of mbstudio that has them.

Only tests/test_contributing.py runs this file: mbstudio itself has none of it.
"""

from __future__ import annotations

from PySide6.QtWidgets import QToolButton

from mbstudio.core.imaging import fit
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.scan.readers import SUFFIXES


def in_menu(window, menu):
    """Return the ids of the commands of a menu of the menu bar."""
    (found,) = (action for action in window.menuBar().actions() if action.text() == f"&{menu}")
    return [action.objectName() for action in found.menu().actions()]


def test_a_station(window):
    buttons = {button.text(): button for button in window.rail.findChildren(QToolButton)}
    buttons["Notes"].click()
    station = window.stations.notes
    assert window.stations.current is station
    assert station.panel.isVisible()
    assert not window.docks["notes"].isHidden()
    assert window.view.is_shown("slices")
    assert window.statusBar().currentMessage() == "Write on the right what you see."
    assert {"notes.clear", "panel.notes"} <= {command.id for command in window.commands}
    assert "notes.clear" in in_menu(window, "Notes")
    assert not window.commands.run("notes.clear")
    station.page.setPlainText("Dry sand.")
    assert window.commands.run("notes.clear")
    assert station.page.toPlainText() == ""
    assert window.commands.run("panel.notes")
    assert window.docks["notes"].isHidden()
    assert window.commands.run("station.scan")
    assert not station.panel.isVisible()
    assert window.statusBar().currentMessage() == ""


def test_an_undoable_command(window, two_grains):
    assert "fit.forget" in in_menu(window, "Fit")
    assert not window.commands.run("fit.forget")
    avatar = fit(two_grains.grain(1), 6, seed=0)
    window.workspace.replace_project(Project(ProjectState(grains=two_grains, fits={1: avatar})))
    assert window.commands.run("fit.forget")
    assert not window.workspace.state.fits
    assert window.commands.action("edit.undo").text() == "Undo: Remove all avatars"
    assert window.commands.run("edit.undo")
    assert list(window.workspace.state.fits) == [1]


def test_what_was_added_is_offered(window):
    """The window offers the reader's files, the target and the preset as well."""
    assert {".mrc", ".rec"} <= set(SUFFIXES)
    assert window.stations.export.panel.target.findText("OFF meshes") >= 0
    assert window.stations.style.panel.learn.preset.findText("Main forms") >= 0
