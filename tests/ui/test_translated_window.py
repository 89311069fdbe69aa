"""In a window whose translation puts every text into brackets, nothing that a person reads stands outside."""

from __future__ import annotations

import platform
import re
from html import unescape
from itertools import product
from pathlib import Path

import pytest
from PySide6.QtCore import QAbstractListModel, QCoreApplication, Qt, QTranslator
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSpinBox,
    QComboBox,
    QGroupBox,
    QHeaderView,
    QLabel,
    QLineEdit,
    QMenu,
    QPlainTextEdit,
    QProgressBar,
    QTabBar,
    QTextEdit,
    QWidget,
)

from mbstudio.core.dem.target import targets
from mbstudio.core.populations.sieving import SERIES_NAMES
from mbstudio.core.vae.generate.generator import generate
from mbstudio.core.vae.models.presets import PRESETS, find_preset

BRACKETED = re.compile(r"⟦[^⟦⟧]*⟧")
WORD = re.compile(r"[^\W\d_²³]{3,}")

NAMES = {
    "MetaBall", "Studio", "Python", "Linux", "LIGGGHTS", "LAMMPS", "MercuryDPM", "YADE", "PFC", "STL", "CSV",
    "PNG", "SVG", "PDF", "CSF",
}  # fmt: skip
"""Of programs, files and factors: they are the same in every language."""
VALUES = {"sphericity=0.75..0.8", "uint8", "uint16", "uint32", "int16", "int32", "float32", "float64"}
"""That the program reads as they stand."""
VERSION = re.compile(r"^[\w-]+ \d+(\.\w+)+\S*$", re.MULTILINE)


class Brackets(QTranslator):
    """Puts every text of the window into brackets; leaves Qt's own alone."""

    def isEmpty(self):
        return False

    def translate(self, context, source, disambiguation=None, n=-1):
        return f"⟦{source}⟧" if context == "" else None


@pytest.fixture
def brackets(qapp):
    translator = Brackets()
    assert QCoreApplication.installTranslator(translator)
    yield
    assert QCoreApplication.removeTranslator(translator)


@pytest.fixture
def window(brackets, window):
    return window


def bare(text, allowed=()):
    """Return the words of a text that stand outside of brackets."""
    text = VERSION.sub(" ", unescape(re.sub(r"<[^>]*>", " ", text)).replace("&", ""))
    while BRACKETED.search(text):
        text = BRACKETED.sub(" ", text)
    for name in sorted(allowed, key=len, reverse=True):
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", " ", text)
    return [word for word in WORD.findall(text) if word not in NAMES]


def keys_of(window):
    """Return the shortcuts as tips and lists show them: the names of keys are Qt's to translate."""
    formats = QKeySequence.SequenceFormat
    return {
        keys.toString(form)
        for command in window.commands
        for keys in window.commands.action(command.id).shortcuts()
        for form in (formats.NativeText, formats.PortableText)
    }


def words_of_the_library():
    """Return what the library calls sieves, presets, targets and their options: its words are English."""
    found = set(SERIES_NAMES.values())
    for preset in map(find_preset, PRESETS):
        found |= {preset.title, preset.summary}
    for target in targets().values():
        found |= {target.title, *(option.meaning for option in target.options.values())}
    return found


def entries(menu):
    """Return the actions of a menu and of the menus in it."""
    found = []
    for action in menu.actions():
        if action.isSeparator():
            continue
        found.append(action)
        if isinstance(action.menu(), QMenu):
            found += entries(action.menu())
    return found


def test_a_word_outside_of_brackets_is_found(brackets):
    assert QCoreApplication.translate("", "Pause") == "⟦Pause⟧"
    assert QCoreApplication.translate("QDialog", "Pause") == "Pause"
    assert bare("⟦Undo: ⟦Fit grain {n}⟧⟧ (Ctrl+Z), 12.5 µm", {"Ctrl+Z"}) == []
    assert bare("⟦Fit⟧ <b>grain</b>&nbsp;⟦3⟧ in STL") == ["grain"]


def test_commands_and_menus_are_translated(window, tmp_path):
    scan = tmp_path / "heap_of_sand.tif"
    scan.touch()
    window.workspace.remember(scan)
    keys = keys_of(window)
    left = []
    for command in window.commands:
        action = window.commands.action(command.id)
        texts = (command.title, command.tip, action.text(), action.toolTip(), action.statusTip())
        left += [(command.id, text) for text in texts if bare(text, keys)]
    assert not left
    found = entries(window.menuBar())
    assert len(found) > 60
    assert [action.text() for action in found if bare(action.text())] == [scan.name]
    assert all("⟦" in action.text() for action in found if action.text() != scan.name)


def test_what_is_said_and_remembered_is_translated(window, with_grains, idle, qtbot, tmp_path):
    titles = []
    window.queue.started.connect(lambda task: titles.append(task.title))
    said = []
    window.messages.shown.connect(lambda *_: said.append(window.messages.text))

    window.stations.fit.link.use_n(6)
    window.workspace.select(1)
    assert window.commands.run("fit.grain")
    idle()
    assert window.workspace.state.fits
    window.stations.populations.link.save_figure(tmp_path / "figure.bmp")
    window.pictures.copy()
    window.pictures.save(tmp_path / "view.png")
    window.stations.scan.link.tell_missing_scan("")
    window.stations.latent.link.pick("A")
    chosen = window.stations.export.panel.chosen()
    window.stations.export.work.export(chosen, "stl", tmp_path / "dem", {"unit": "mm", "options": {}})
    window.stations.populations.work.write_report(tmp_path / "report.html")
    idle()
    window.project_work.save(tmp_path / "sand.mbs")
    idle()
    window.view_tools.measure("angle")
    hint = window.statusBar().currentMessage()

    assert len(said) >= 9
    known = {"stl", *re.findall(r"[\w./]+", str(tmp_path))}
    assert not [text for text in [*said, hint] if bare(text, known)]
    assert len(titles) >= 6
    assert not [title for title in titles if bare(title)]
    past = window.workspace.project.history.all_titles
    assert len(past) == 2
    assert not [title for title in past if bare(title)]
    assert "⟦Fit grain 1⟧" in window.commands.action("edit.undo").text()
    assert window.windowTitle().startswith("⟦")


QT_OWN = re.compile("qt_|Scroll(Left|Right)Button")
"""Names of buttons that Qt makes and translates itself."""


def texts_of(widget):
    """Return all that a widget shows or says, and where."""
    found = {
        "window title": widget.windowTitle(),
        "tool tip": widget.toolTip(),
        "status tip": widget.statusTip(),
        "what is this": widget.whatsThis(),
        "accessible name": widget.accessibleName(),
        "accessible description": widget.accessibleDescription(),
    }
    if isinstance(widget, QLabel | QAbstractButton):
        found["text"] = widget.text()
    elif isinstance(widget, QGroupBox):
        found["title"] = widget.title()
    elif isinstance(widget, QComboBox):
        for place in range(widget.count()):
            found[f"item {place}"] = widget.itemText(place)
            found[f"tip of item {place}"] = widget.itemData(place, Qt.ItemDataRole.ToolTipRole)
    elif isinstance(widget, QLineEdit | QTextEdit | QPlainTextEdit):
        found["placeholder"] = widget.placeholderText()
    elif isinstance(widget, QAbstractSpinBox):
        found["special value"] = widget.specialValueText()
        found["prefix"] = getattr(widget, "prefix", str)()
        found["suffix"] = getattr(widget, "suffix", str)()
    elif isinstance(widget, QTabBar):
        for place in range(widget.count()):
            found[f"tab {place}"] = widget.tabText(place)
            found[f"tip of tab {place}"] = widget.tabToolTip(place)
    elif isinstance(widget, QProgressBar):
        found["format"] = widget.format()
    elif isinstance(widget, QHeaderView) and widget.model() is not None:
        for place in range(widget.count()):
            for role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.ToolTipRole):
                found[f"heading {place}, {role.name}"] = widget.model().headerData(
                    place, widget.orientation(), role
                )
    elif isinstance(widget, QAbstractItemView) and widget.model() is not None:
        model = widget.model()
        columns = 1 if isinstance(model, QAbstractListModel) else model.columnCount()
        for row, column in product(range(min(40, model.rowCount())), range(columns)):
            for role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.ToolTipRole):
                found[f"row {row}, column {column}, {role.name}"] = model.index(row, column).data(role)
    return found


def left_out(window, known=()):
    """Return class, place and text of all that is not in brackets, each once, in a line each."""
    allowed = keys_of(window) | words_of_the_library() | VALUES | set(known)
    left = set()
    for widget in [window, *window.findChildren(QWidget)]:
        if QT_OWN.match(widget.objectName()):
            continue
        for place, text in texts_of(widget).items():
            if isinstance(text, str) and bare(text, allowed):
                left.add(f"{type(widget).__name__}, {place}: {text!r}")
    return sorted(left)


def test_no_widget_of_the_empty_window_stands_outside(window, idle):
    for station in [station.id for station in window.stations]:
        window.enter(station)
        idle()
    window.shell.open_preferences()
    window.shell.open_shortcuts()
    window.shell.start_tour()
    window.about()
    window.command_palette.open()
    window.stations.scan.link.ask_about_scan(Path("heap.raw"), "", raw=True)
    window.stations.fit.show_sweep(True)
    for shown in ("panel.history", "panel.log", "panel.bodies"):
        window.commands.run(shown)
    left = left_out(window, {"heap.raw", platform.platform()})
    assert not left, "\n".join(left)


def test_no_widget_of_a_window_at_work_stands_outside(window, with_grains, shaping, learner, idle, rest):
    window.workspace.select(1)
    window.workspace.change_fit_settings(n=6)
    assert window.commands.run("fit.grain")
    idle()
    clones = generate(learner, 6, 3)
    window.workspace.use_clones(clones)
    rest()
    for station in [station.id for station in window.stations]:
        window.enter(station)
        rest()
    window.stations.latent.work.keep()
    for shown in ("panel.history", "panel.log", "panel.bodies"):
        window.commands.run(shown)
    rest()
    grains = [*learner.parents.names, *clones.clones.names, "kept 1", "grain_00001"]
    left = left_out(window, grains)
    assert not left, "\n".join(left)
