"""Station Grains tells the memory that finding the grains takes, and asks where it is too little."""

from __future__ import annotations

from mbstudio.core.batch import memory_estimate


def test_the_memory_is_told_and_held_against_what_is_free(scanned, idle, monkeypatch):
    window = scanned
    panel, messages = window.stations.grains.panel, window.messages
    window.enter("grains")
    assert panel._hint.text().startswith("Finding the grains takes about ")
    assert "free" not in panel._hint.text()
    monkeypatch.setattr(memory_estimate, "free_memory", lambda: 222_000_000)
    window.enter("scan")
    window.enter("grains")
    assert "222 MB are free" in panel._hint.text()
    messages.dismiss()
    assert window.commands.run("grains.find")
    assert window.queue.is_idle, "it was not begun"
    assert messages.level == "warning"
    assert "222 MB are free: take a part of the scan" in messages.text
    assert messages._action.text() == "Find anyway"
    messages._action.click()
    idle()
    assert len(window.workspace.state.grains) == 3
