"""What is handed around in place of the window, and what it asks of the window."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from PySide6.QtWidgets import QPushButton, QWidget

import mbstudio.ui
from mbstudio.ui.commands import Command, CommandTable
from mbstudio.ui.icons import Icons

UI = Path(mbstudio.ui.__file__).parent


def test_the_studio_speaks_to_the_window(window):
    studio = window.studio
    studio.say("warning", "A message.")
    assert (window.messages.level, window.messages.text) == ("warning", "A message.")
    studio.enter("export")
    assert window.stations.current.id == "export"
    studio.give_hint("A hint")
    assert window.statusBar().currentMessage() == "A hint"
    studio.give_hint("")
    assert window.statusBar().currentMessage() == ""
    assert Path(studio.path_for("sand.mbs")).name == "sand.mbs"


def test_what_a_station_offers_reaches_the_others(window):
    offers, panel = window.studio.offers, window.stations.export.panel
    heard = []
    offers.kept_chosen.connect(lambda: heard.append(offers.kept_name))
    offers.choose_kept("kept 3")
    offers.choose_kept("kept 3")
    assert heard == ["kept 3"], "nobody is told what is the same"
    offers.choose_export("all")
    assert panel.selection.currentData() == "all"


def test_a_button_follows_its_command(qapp, theme):
    host = QWidget()
    table = CommandTable(Icons(theme, host), host)
    ready, runs = [False], []
    table.add([
        Command(id="a.b", title="Do it", run=lambda: runs.append(1), menu="A", shortcut="Ctrl+J",
                tip="Does it", enabled=lambda: ready[0]),
    ])  # fmt: skip
    plain, telling = QPushButton(host), QPushButton(host)
    telling.setToolTip("Does it here")
    for button in (plain, telling):
        table.bind(button, "a.b")
    table.refresh()
    assert not plain.isEnabled()
    assert plain.toolTip() == "Does it (Ctrl+J)"
    assert telling.toolTip() == "Does it here"
    ready[0] = True
    table.refresh()
    assert plain.isEnabled()
    plain.click()
    telling.click()
    assert len(runs) == 2
    with pytest.raises(ValueError, match="two commands"):
        table.add([Command(id="a.b", title="Again", run=print, menu="A")])
    host.deleteLater()


def imported(path: Path) -> set[str]:
    """Return the modules that a file imports, also those that only its types need."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name for name in found if name.startswith("mbstudio.ui")}


def test_the_shell_knows_no_station_and_no_station_another():
    faults = []
    for path in UI.rglob("*.py"):
        parts = path.relative_to(UI).parts
        part = parts[0] if len(parts) > 1 else ""
        for module in imported(path):
            below = module.split(".")[2:]
            if below[:1] == ["stations"] and part not in ("shell", "stations"):
                faults.append(f"{path}: {module}")
            if part == "shell" and len(below) > 2 and below[0] == "stations" and below[1] != "gallery":
                faults.append(f"{path}: {module}")
            same = len(parts) > 2 and below[1:2] == [parts[1]]
            if (
                part == "stations"
                and len(parts) > 2
                and len(below) > 2
                and below[0] == "stations"
                and not same
            ):
                faults.append(f"{path}: {module}")
    assert not faults, "\n".join(faults)


def test_no_code_outside_a_station_asks_which_one_is_open():
    ids = {"scan", "grains", "fit", "populations", "style", "latent", "export"}
    found = []
    for path in [*UI.glob("*.py"), *(UI / "view").rglob("*.py"), *(UI / "shell").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Compare):
                sides = [node.left, *node.comparators]
                words = {side.value for side in sides if isinstance(side, ast.Constant)}
                about = ast.unparse(node)
                if words & ids and "station" in about:
                    found.append(f"{path.name}:{node.lineno}: {about}")
    assert not found, "\n".join(found)
