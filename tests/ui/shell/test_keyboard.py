"""Work without a mouse: keys alone, sent to what has the focus."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractSpinBox, QApplication, QLineEdit

from mbstudio.core.dem.manifest import read_manifest


def press(window, keys):
    QTest.keySequence(QApplication.focusWidget() or window, QKeySequence(keys))
    QApplication.processEvents()


def type_in(words):
    QTest.keyClicks(QApplication.focusWidget(), words)
    QApplication.processEvents()


def run_by_name(window, words):
    """Find a command in the palette and run it."""
    press(window, "Ctrl+K")
    type_in(words)
    press(window, "Return")


def go_to_field(window, name):
    """Press Tab until a field has the focus."""
    for _ in range(60):
        if QApplication.focusWidget().accessibleName() == name:
            return
        press(window, "Tab")
    raise AssertionError(f"Tab never reaches “{name}”.")


class Windows(QObject):
    """Notes what is shown as a window of its own."""

    def __init__(self):
        super().__init__()
        self.shown = []

    def eventFilter(self, watched, event):
        if event.type() == QEvent.Type.Show and watched.isWidgetType() and watched.isWindow():
            self.shown.append(type(watched).__name__)
        return False


@pytest.fixture
def windows(qapp):
    seen = Windows()
    qapp.installEventFilter(seen)
    yield seen.shown
    qapp.removeEventFilter(seen)


def test_enter_belongs_to_the_field_that_is_written_in(segmented):
    """It is also the key that accepts a suspicious grain."""
    accept = segmented.commands.action("grains.accept_suspect")
    accepted = []
    accept.triggered.connect(lambda: accepted.append(True))
    segmented.activateWindow()
    fields = [w for w in segmented.stations.grains.panel.findChildren(QAbstractSpinBox) if w.isVisible()]
    fields[0].setFocus(Qt.FocusReason.TabFocusReason)
    accept.setEnabled(True)
    press(segmented, "Return")
    press(segmented, "Ctrl+K")
    assert isinstance(QApplication.focusWidget(), QLineEdit)
    type_in("theme: dark")
    accept.setEnabled(True)
    press(segmented, "Return")
    assert not accepted
    assert segmented.studio.theme.is_dark
    assert not isinstance(QApplication.focusWidget(), QLineEdit), "the palette closes"


def test_letters_in_the_palette_run_no_command(segmented):
    before = segmented.workspace.state
    segmented.workspace.select(1)
    press(segmented, "Ctrl+K")
    type_in("mxsbez")
    assert QApplication.focusWidget().text() == "mxsbez"
    assert segmented.workspace.state is before
    press(segmented, "Esc")


def test_a_slider_with_its_lock_is_no_window_while_it_is_made(qtbot, window, windows):
    from mbstudio.ui.widgets.value_slider import ValueSlider

    for lock in (True, False):
        qtbot.addWidget(ValueSlider("Size", window.studio.icons, lock=lock))
    assert windows == []


@pytest.mark.full
@pytest.mark.timeout(900)
def test_from_the_sample_scan_to_an_export_without_a_mouse(window, idle, windows, tmp_path):
    """Last passed on 30 November 2026."""
    window.activateWindow()
    run_by_name(window, "open the sample")
    idle()
    press(window, "Ctrl+G")
    idle()
    grains = window.workspace.state.grains
    assert len(grains) > 60
    press(window, "N")
    idle()
    suspect = window.workspace.selected
    press(window, "Return")
    idle()
    assert window.workspace.state.grains.accepted_labels == {suspect}
    press(window, "Ctrl+Down")
    chosen = window.workspace.selected
    press(window, "X")
    idle()
    assert chosen in window.workspace.state.grains.excluded_labels
    press(window, "Ctrl+Z")
    press(window, "Del")
    idle()
    assert len(window.workspace.state.grains) == len(grains) - 1
    press(window, "Ctrl+Z")
    press(window, "Ctrl+Shift+F")
    idle()
    assert len(window.workspace.state.fits) >= 30
    press(window, "Ctrl+4")
    press(window, "Ctrl+M")
    idle()
    press(window, "Ctrl+5")
    press(window, "Ctrl+L")
    idle()
    assert window.workspace.style is not None
    press(window, "Ctrl+Shift+G")
    idle()
    assert len(window.workspace.state.clones) >= 20
    press(window, "Ctrl+7")
    go_to_field(window, "Folder")
    type_in(str(tmp_path / "out"))
    press(window, "Tab")
    press(window, "Ctrl+E")
    idle()
    assert read_manifest(tmp_path / "out")["items"]
    assert set(windows) <= {"MainWindow"}
