"""Leaving a project with unsaved work: a card asks, and nothing is blocked meanwhile."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QFileDialog

from mbstudio.core.project import Project
from tests.ui.conftest import PATIENCE


@pytest.fixture
def unsaved(window, idle, tmp_path, qtbot):
    """The window with a small scan that no project file holds."""
    path = tmp_path / "box.npy"
    np.save(path, np.zeros((8, 8, 8), np.uint8))
    window.stations.scan.work.open(path, "14 um")
    idle()
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow, timeout=PATIENCE)
    window.project_files.asks = True
    yield window
    window.project_files.asks = False


def test_closing_asks_without_blocking_and_esc_calls_it_off(unsaved, qtbot):
    window, card = unsaved, unsaved.project_files.leaving
    window.stations.grains.table.setFocus()
    assert window.close() is False
    assert window.isVisible()
    assert card.isVisible()
    assert "Save the changes to “Untitled project”?" in card.text
    assert QApplication.activeModalWidget() is None
    assert QApplication.focusWidget() is card.save
    # Work goes on beside the question.
    window.workspace.change_fit_settings(n=33)
    assert window.commands.run("edit.undo")
    window.messages.say("warning", "Something else.")
    window.refresh()
    qtbot.keyClick(card.save, Qt.Key.Key_Escape)
    assert card.isHidden()
    assert card.text == ""
    assert window.isVisible()
    assert window.messages.text == "Something else.", "Esc was the card's"


def test_the_keyboard_reaches_every_answer(unsaved, qtbot):
    window, card = unsaved, unsaved.project_files.leaving
    window.close()
    reached = [QApplication.focusWidget()]
    for _ in range(2):
        qtbot.keyClick(reached[-1], Qt.Key.Key_Tab)
        reached.append(QApplication.focusWidget())
    assert reached == [card.save, card.discard, card.cancel]
    qtbot.keyClick(card.discard, Qt.Key.Key_Return)
    assert not window.isVisible()


def test_saving_writes_the_project_and_then_closes(unsaved, qtbot, tmp_path, monkeypatch):
    window, path = unsaved, tmp_path / "kept.mbs"
    names = ["", str(path)]
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *args: (names.pop(0), ""))
    window.close()
    window.project_files.leaving.save.click()
    assert window.isVisible(), "no file was chosen"
    window.close()
    qtbot.keyClick(window.project_files.leaving.save, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: not window.isVisible(), timeout=PATIENCE)
    with Project.open(path) as saved:
        assert saved.state.scan is not None


def test_the_last_question_counts(unsaved, idle):
    """Closing is asked for, then a new project instead: the window stays."""
    window, card = unsaved, unsaved.project_files.leaving
    window.close()
    assert window.commands.run("project.new")
    card.discard.click()
    idle()
    assert window.isVisible()
    assert window.workspace.state.scan is None
    window.close()
    assert not window.isVisible(), "there is nothing to ask about any more"
