"""Words over the view while surfaces are built, and where there is no deviation to be seen."""

from __future__ import annotations

import threading

from mbstudio.ui.workers import Task


def test_the_view_says_what_is_being_built(scanned, idle, qtbot):
    idle()
    note, built = scanned.building_note, threading.Event()
    assert note.text == ""
    scanned.queue.submit(Task("Drawing the grains", lambda _: built.wait(60)), lane="view")
    qtbot.waitUntil(lambda: note.text == "Drawing the grains …", timeout=60_000)
    assert note.label.isVisible()
    assert scanned.viewport.rect().contains(note.label.geometry())
    built.set()
    idle()
    assert note.text == ""
