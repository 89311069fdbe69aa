"""The words of the window can be translated."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.sax.saxutils import escape

import PySide6
import pytest
from PySide6.QtCore import QCoreApplication, QLocale, QTranslator

from mbstudio.ui import language
from mbstudio.ui.language import install_translation, mark, tr

TOOLS = Path(PySide6.__file__).parent


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
