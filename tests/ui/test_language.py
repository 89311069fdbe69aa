"""The words of the window can be translated."""

from __future__ import annotations

import ast
import re
import string
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import PySide6
import pytest
from PySide6.QtCore import QCoreApplication, QLocale, QTranslator

import mbstudio.scene.layers
import mbstudio.ui
from mbstudio.core.metrics import factor_table
from mbstudio.core.metrics.factor_table import AXES, FACTORS, LATENT_MEANINGS
from mbstudio.ui import language
from mbstudio.ui.language import install_translation, mark, tr

TOOLS = Path(PySide6.__file__).parent
WINDOW = Path(mbstudio.ui.__file__).parent
LAYERS = Path(mbstudio.scene.layers.__file__).parent
TABLES = (Path(factor_table.__file__), *sorted(LAYERS.glob("*.py")))
"""Modules of engine and scene whose texts the window shows in the person's language."""


def compile_translation(folder: Path, words: dict[str, str]) -> None:
    """Write a German translation of these words with Qt's tool."""
    messages = "".join(
        f"<message><source>{escape(source)}</source><translation>{escape(text)}</translation></message>"
        for source, text in words.items()
    )
    source = folder / "mbstudio_de.ts"
    source.write_text(
        '<?xml version="1.0" encoding="utf-8"?><!DOCTYPE TS><TS version="2.1" language="de_DE">'
        f"<context><name></name>{messages}</context></TS>",
        encoding="utf-8",
    )
    tool = TOOLS / ("lrelease.exe" if sys.platform == "win32" else "lrelease")
    subprocess.run([tool, source, "-qm", source.with_suffix(".qm")], check=True, capture_output=True)


@pytest.fixture
def translators(qapp, monkeypatch):
    """Translators that are installed end with the test."""
    installed = []

    def install(translator):
        installed.append(translator)
        return QCoreApplication.installTranslator(translator)

    monkeypatch.setattr(qapp, "installTranslator", install, raising=False)
    yield qapp
    for translator in installed:
        QCoreApplication.removeTranslator(translator)
        translator.deleteLater()


def test_without_a_translation_a_text_is_itself():
    assert tr("Pause") == "Pause"
    assert tr("{n} grains, {error:+.1f} %", n=3, error=2.25) == "3 grains, +2.2 %"
    assert tr("100 % {sure}") == "100 % {sure}", "braces mean nothing where no value is given"
    assert mark("Pause") == "Pause"


def test_a_translation_that_lies_beside_the_program_is_taken(translators, tmp_path, monkeypatch):
    compile_translation(tmp_path, {"Pause": "Anhalten", "{n} grains": "Körner: {n}"})
    monkeypatch.setattr(language, "FOLDER", tmp_path)
    assert not install_translation(translators, QLocale("fi_FI"))
    assert install_translation(translators, QLocale("de_AT"))
    assert tr("Pause") == "Anhalten"
    assert tr("{n} grains", n=5) == "Körner: 5"
    assert tr("Stop") == "Stop", "what is not translated stays English"


def test_qts_own_tool_collects_the_texts(tmp_path):
    source = tmp_path / "panel.py"
    source.write_text(
        "NAMES = {'a': mark('A title')}\n"
        "class Panel(QWidget):\n"
        "    def say(self):\n"
        "        return tr('{n} grains ' 'in all', n=3)\n"
    )
    collected = tmp_path / "mbstudio_de.ts"
    tool = TOOLS / ("lupdate.exe" if sys.platform == "win32" else "lupdate")
    alias = ["-tr-function-alias", "QT_TR_NOOP+=mark"]
    subprocess.run([tool, *alias, source, "-ts", collected], check=True, capture_output=True)
    text = collected.read_text(encoding="utf-8")
    assert "<name></name>" in text, "the context that tr asks for"
    assert "<source>A title</source>" in text
    assert "<source>{n} grains in all</source>" in text


def test_a_translator_is_kept_as_long_as_the_application(translators, tmp_path, monkeypatch):
    compile_translation(tmp_path, {"Pause": "Anhalten"})
    monkeypatch.setattr(language, "FOLDER", tmp_path)
    assert install_translation(translators, QLocale("de_DE"))
    assert translators.findChildren(QTranslator)


def sources():
    """Return the parsed modules whose texts the window shows, by their names."""
    root = WINDOW.parent
    return {str(path.relative_to(root)): ast.parse(path.read_text(encoding="utf-8")) for path in modules()}


def modules():
    return [*(path for path in sorted(WINDOW.rglob("*.py")) if path.name != "language.py"), *TABLES]


def calls(tree):
    """Return the calls of tr and mark."""
    names = ("tr", "mark")
    found = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    return [node for node in found if isinstance(node.func, ast.Name) and node.func.id in names]


def is_literal(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def is_taken(node):
    """Return whether a text is taken from a table or a name, not put together."""
    if isinstance(node, ast.IfExp):
        return is_taken(node.body) and is_taken(node.orelse)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        return node.func.attr not in ("format", "join", "replace")
    return isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.Call)


def fault_of(call):
    """Return what is wrong with a call of tr or mark; empty if nothing is."""
    name = call.func.id
    if len(call.args) != 1:
        return "takes one text"
    (text,), values = call.args, [keyword.arg for keyword in call.keywords]
    if None in values or "text" in values:
        return "takes each value by its name, and none called text"
    if name == "mark" and (values or not is_literal(text)):
        return "marks a text that is written out"
    if not is_literal(text):
        return "" if is_taken(text) else "translates what is put together: write the text out"
    try:
        fields = [field for _, field, _, _ in string.Formatter().parse(text.value) if field is not None]
    except ValueError as error:
        return f"cannot be filled in: {error}"
    if not all(field.isidentifier() for field in fields):
        return "has a field that is no name"
    if name == "tr" and set(fields) != set(values):
        return f"has the fields {sorted(set(fields))} and the values {sorted(values)}"
    return ""


@pytest.mark.parametrize(
    ("source", "sound"),
    [
        ("tr('Pause')", True),
        ("tr('{n} ' 'grains', n=3)", True),
        ("tr('{error:+.2f} %', error=e)", True),
        ("tr(TITLES[name])", True),
        ("tr(title_of(name), n=3)", True),
        ("tr(SHORT.get(name, name))", True),
        ("tr(one if n == 1 else many, n=n)", True),
        ("mark('{n} grains')", True),
        ("tr(f'{n} grains')", False),
        ("tr('{} grains'.format(n))", False),
        ("tr(' '.join(words))", False),
        ("tr('Pause' if running else title)", False),
        ("tr('Fit ' + name)", False),
        ("tr('Fit %s' % name)", False),
        ("tr('{n} grains')", False),
        ("tr('{n} grains', count=n)", False),
        ("tr('{n} grains', n=n, of=m)", False),
        ("tr('{} grains', n=n)", False),
        ("tr('{a.n} grains', a=a)", False),
        ("tr('{n grains', n=n)", False),
        ("tr('{n} grains', **values)", False),
        ("tr('Pause', 'now')", False),
        ("tr('{text}', text=words)", False),
        ("mark(title)", False),
    ],
)
def test_a_faulty_call_is_found(source, sound):
    (call,) = calls(ast.parse(source))
    assert (fault_of(call) == "") is sound


def test_texts_are_written_out_and_get_the_values_that_they_name():
    trees = sources()
    assert len(trees) > 90
    assert sum(len(calls(tree)) for tree in trees.values()) > 400
    faults = [
        f"{name}:{call.lineno}: {call.func.id} {fault}"
        for name, tree in trees.items()
        for call in calls(tree)
        if (fault := fault_of(call))
    ]
    assert not faults, "\n".join(faults)


EVERY = -1
SHOWN = {
    "setText": 0, "setToolTip": 0, "setStatusTip": 0, "setWhatsThis": 0, "setWindowTitle": 0, "setTitle": 0,
    "setPlaceholderText": 0, "setAccessibleName": 0, "setAccessibleDescription": 0, "setSuffix": 0,
    "setPrefix": 0, "setSpecialValueText": 0, "setFormat": 0, "setHorizontalHeaderLabels": 0,
    "setHeaderLabels": 0, "addItem": 0, "addItems": 0, "addMenu": 0, "addTab": EVERY, "insertItem": 1,
    "setTabText": 1, "setTabToolTip": 1, "setItemText": 1, "showMessage": 0, "drawText": EVERY,
    "QLabel": 0, "QPushButton": 0, "QCheckBox": 0, "QRadioButton": 0, "QGroupBox": 0, "QAction": 0,
    "QDockWidget": 0, "QMenu": 0, "QToolBar": 0, "QListWidgetItem": 0, "QTableWidgetItem": 0, "label": 0,
    "primary_button": 0, "quiet_button": 0, "row": EVERY, "Task": 0, "say": EVERY, "progress": 1, "report": 1,
    "change": 0, "add_fits": 1, "Operation": 2, "getOpenFileName": EVERY, "getSaveFileName": EVERY,
    "getOpenFileNames": EVERY, "getExistingDirectory": EVERY,
}  # fmt: skip
"""What shows or says a text, and at which place it stands."""
NO_WORDS = {"MetaBall Studio", "sphericity=0.75..0.8\nD50=0.4 mm", "error", "warning", "success", "info"}
"""The program's name, what a person types, levels of messages."""


def plain(node):
    """Return the texts that an argument shows without tr."""
    if isinstance(node, ast.JoinedStr):
        return ["".join(part.value for part in node.values if isinstance(part, ast.Constant))]
    if is_literal(node):
        return [node.value]
    parts = {
        ast.IfExp: ("body", "orelse"),
        ast.BinOp: ("left", "right"),
        ast.List: ("elts",),
        ast.Tuple: ("elts",),
    }
    found = []
    for field in parts.get(type(node), ()):
        below = getattr(node, field)
        for part in below if isinstance(below, list) else [below]:
            found += plain(part)
    return found


def untranslated(tree):
    """Return line and text of the words that are shown without tr."""
    found = []
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = getattr(call.func, "attr", getattr(call.func, "id", ""))
        place = SHOWN.get(name)
        if name == "emit" and getattr(call.func.value, "attr", "") in ("said", "refused"):
            place = EVERY
        given = call.args if place == EVERY else call.args[place : place + 1] if place is not None else []
        found += [
            (call.lineno, text)
            for argument in given
            for text in plain(argument)
            if re.search(r"[^\W\d_]{3,}", text) and text not in NO_WORDS
        ]
    return found


def test_no_word_is_shown_without_its_translation():
    module = """
label("Loss", "hint")
button.setText("Pause" if runs else tr("Resume"))
self.said.emit("error", f"{n} grains")
task = Task("Fitting " + name, work)
box.addItem(f"{value:.2f} mm", "data")
tip.setToolTip(tr("A tip"))
"""
    found = [text for _, text in untranslated(ast.parse(module))]
    assert sorted(found) == [" grains", "Fitting ", "Loss", "Pause"]
    left = [
        f"{name}:{line}: {text!r}" for name, tree in sources().items() for line, text in untranslated(tree)
    ]
    assert not left, "\n".join(left)


def early(tree):
    """Return the calls of tr that run when the module is imported: before there is a translation."""
    found, waiting = [], [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "tr":
            found.append(node)
        if isinstance(node, ast.Lambda):
            waiting.append(node.args)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            waiting += [node.args, *node.decorator_list]
        else:
            waiting += ast.iter_child_nodes(node)
    return found


def test_nothing_is_translated_when_a_module_is_imported():
    module = "A = tr('a')\nclass B:\n  c = [tr('c')]\n  def d(self, e=tr('e')):\n    return tr('f')\n"
    assert sorted(call.args[0].value for call in early(ast.parse(module))) == ["a", "c", "e"]
    assert not early(ast.parse("A = lambda: tr('a')\nB = mark('b')"))
    found = [f"{name}:{call.lineno}" for name, tree in sources().items() for call in early(tree)]
    assert not found, found


def test_every_text_of_the_table_of_factors_is_marked():
    """What is not marked there would stay English in a translated window."""
    marked = {call.args[0].value for call in calls(ast.parse(TABLES[0].read_text(encoding="utf-8")))}
    texts = {text for factor in FACTORS.values() for text in (factor.title, factor.meaning)}
    for meaning in LATENT_MEANINGS.values():
        texts |= {meaning.title, meaning.plain, meaning.short, meaning.less, meaning.more, meaning.meaning}
    texts |= {text for axes in AXES.values() for text in (axes.title, axes.meaning)}
    assert {text for text in texts if re.search(r"[^\W\d_]{2,}", text)} - {"CSF"} <= marked
    assert not [f for f in FACTORS.values() if re.search(r"[^\W\d_]{3,}", f.formula)], "a formula with words"


def test_qts_own_tool_collects_every_text_of_the_window(tmp_path):
    # It does not look into f-strings, and must understand whatever else the modules write.
    written = {
        call.args[0].value for tree in sources().values() for call in calls(tree) if is_literal(call.args[0])
    }
    collected = tmp_path / "mbstudio_de.ts"
    tool = TOOLS / ("lupdate.exe" if sys.platform == "win32" else "lupdate")
    alias = ["-tr-function-alias", "QT_TR_NOOP+=mark", "-locations", "none"]
    subprocess.run([tool, *alias, *modules(), "-ts", collected], check=True, capture_output=True)
    contexts = ElementTree.parse(collected).getroot().findall("context")
    assert [context.findtext("name") for context in contexts] == [""]
    assert {message.findtext("source") for message in contexts[0].findall("message")} == written
