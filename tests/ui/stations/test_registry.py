"""A station is one class and one line in the registry: the window takes the rest from it."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel

from mbstudio.ui.commands import Command
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.stations import registry
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.stations.station import Station
from mbstudio.ui.view.display import Display
from mbstudio.ui.widgets.dock_frame import DockFrame
from tests.ui.conftest import delete_later_now


class Shaker:
    """A history of its own: one step that can be taken back and made again."""

    def __init__(self):
        self.shaken = True

    @property
    def undo_title(self):
        return "Shake" if self.shaken else None

    @property
    def redo_title(self):
        return None if self.shaken else "Shake"

    def undo(self):
        self.shaken = False

    def redo(self):
        self.shaken = True


class SieveStation(Station):
    """A station that this test adds."""

    id, title, tip, icon, guide, menu = "sieve", "Sieve", "Shake grains", "ph.funnel", "Export", "Sieving"
    borrowed = ("table",)

    def __init__(self, studio, view):
        super().__init__(studio, view)
        self.panel = Panel("Sieve", "Grains by their size.")
        self.display = Display(studio.workspace, ("slices", "avatars"), ("avatars",), shows_slices=True)
        self.docks = (DockFrame("pile", "Pile", QLabel("A pile"), "right", studio.icons),)
        self.own, self.seen = Shaker(), []

    def commands(self):
        shake = Command(
            id="sieve.shake", title="Shake", run=lambda: self.seen.append("shake"), menu="Sieving"
        )
        return [shake, self.docks[0].command("Pile", "Show or hide the pile")]

    def wire(self):
        self.seen.append("wire")

    def enter(self):
        self.seen.append("enter")

    def leave(self):
        self.seen.append("leave")

    def close(self):
        self.seen.append("close")

    @property
    def history(self):
        return self.own


@pytest.fixture
def sieving(qtbot, settings, theme, monkeypatch, two_grains):
    """A window with one more station."""
    monkeypatch.setattr(registry, "STATIONS", [*registry.STATIONS, SieveStation])
    window = MainWindow(settings, theme)
    window.project_files.asks = False
    window.show()
    qtbot.waitExposed(window)
    window.workspace.change("Find grains", grains=two_grains)
    yield window
    window.close()
    window.deleteLater()
    delete_later_now()


def layers(window):
    """Names of the layers that can be switched now."""
    shown = (command.id for command in window.commands if command.id.startswith("layer."))
    return {name.removeprefix("layer.") for name in shown if window.commands.action(name).isVisible()}


def test_a_station_in_the_registry_has_everything(sieving):
    window, station = sieving, sieving.stations.sieve
    assert [one.id for one in window.stations][-1] == "sieve"
    assert station.seen == ["wire"]
    assert window.docks["pile"].isHidden()
    button = window.rail._buttons["sieve"]
    assert (button.text(), button.toolTip()) == ("Sieve", "Shake grains (Ctrl+9)")
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)
    assert station.is_open
    assert window.stations.current is station
    assert station.panel.isVisible()
    assert not window.docks["pile"].isHidden()
    assert not window.docks["table"].isHidden(), "it borrows the table of station Grains"
    assert window.docks["curve"].isHidden()
    assert layers(window) == {"slices", "avatars"}
    assert window.view.is_shown("avatars")
    assert not window.view.is_shown("slices")
    assert window.commands.run("sieve.shake")
    assert window.commands.run("panel.pile")
    assert window.docks["pile"].isHidden()
    window.enter("scan")
    assert not station.is_open
    assert station.seen == ["wire", "enter", "shake", "leave"]
    assert window.commands.run("station.sieve")
    assert window.docks["pile"].isHidden(), "what was hidden at a station stays hidden there"
    window.close()
    assert station.seen[-1] == "close"


def test_a_station_has_its_menu_before_view(sieving):
    titles = [action.text().replace("&", "") for action in sieving.menuBar().actions()]
    assert titles[-5:] == ["Packing", "Sieving", "View", "Tools", "Help"]


def test_undo_is_the_stations_where_it_has_a_history_else_the_projects(sieving):
    window, station = sieving, sieving.stations.sieve
    action = window.commands.action("edit.undo")
    window.enter("grains")
    assert action.text() == "Undo: Find grains"
    window.enter("sieve")
    assert action.text() == "Undo: Shake"
    assert window.commands.run("edit.undo")
    assert not station.own.shaken
    assert window.workspace.state.grains is not None, "the project is not touched"
    window.refresh()
    window.commands.bring_up_to_date()
    assert not action.isEnabled()
    assert window.commands.action("edit.redo").text() == "Redo: Shake"
    assert window.commands.run("edit.redo")
    assert station.own.shaken
    window.enter("grains")
    assert window.commands.run("edit.undo")
    assert window.workspace.state.grains is None


def test_an_unknown_station_is_no_attribute(sieving):
    with pytest.raises(AttributeError, match="no station “mill”"):
        _ = sieving.stations.mill


def test_a_hint_of_one_station_does_not_stay_at_the_next(window):
    window.enter("grains")
    window.studio.give_hint("Grain 3 looks like several grains.")
    assert window.statusBar().currentMessage()
    window.enter("fit")
    assert window.statusBar().currentMessage() == ""
