"""The examples of CONTRIBUTING.md that add to the window do what their text says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mbstudio.core.imaging import fit
from mbstudio.core.project import Project, ProjectState
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.stations import registry
from mbstudio.ui.stations.fit.station import FitStation
from tests.ui.conftest import delete_later_now

PAGE = Path(__file__).parents[2] / "CONTRIBUTING.md"


def example(heading: str) -> dict[str, object]:
    """Run the code below a heading and return its names."""
    text = PAGE.read_text(encoding="utf-8").partition(f"### {heading}\n")[2].partition("\n### ")[0]
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, object] = {"__name__": "example"}
    exec(compile(code, heading, "exec"), names)
    return names


@pytest.fixture
def make_window(qtbot, settings, theme):
    made = []

    def make():
        window = MainWindow(settings, theme)
        window.project_files.asks = False
        window.show()
        qtbot.waitExposed(window)
        made.append(window)
        return window

    yield make
    for window in made:
        window.close()
        window.deleteLater()
    delete_later_now()


def test_the_example_of_a_station(make_window, monkeypatch):
    station_class = example("A station of the window")["NotesStation"]
    monkeypatch.setattr(registry, "STATIONS", [*registry.STATIONS, station_class])
    window = make_window()
    assert window.commands.run("station.notes")
    assert not window.docks["notes"].isHidden()
    assert window.view.is_shown("slices")
    station = window.stations.notes
    assert not window.commands.run("notes.clear")
    station.page.setPlainText("Dry sand.")
    assert window.commands.run("notes.clear")
    assert station.page.toPlainText() == ""
    assert window.commands.run("panel.notes")
    assert window.docks["notes"].isHidden()


def test_the_example_of_an_undoable_command(make_window, monkeypatch, two_grains):
    forget_avatars = example("An undoable command")["forget_avatars"]
    commands = FitStation.commands

    def more(station):
        return [*commands(station), forget_avatars(station.studio.workspace)]

    monkeypatch.setattr(FitStation, "commands", more)
    window = make_window()
    assert not window.commands.run("fit.forget")
    avatar = fit(two_grains.grain(1), 6, seed=0)
    window.workspace.replace_project(Project(ProjectState(grains=two_grains, fits={1: avatar})))
    assert window.commands.run("fit.forget")
    assert not window.workspace.state.fits
    assert window.commands.action("edit.undo").text() == "Undo: Remove all avatars"
    assert window.commands.run("edit.undo")
    assert list(window.workspace.state.fits) == [1]
