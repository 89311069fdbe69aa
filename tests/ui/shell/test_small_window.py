"""In the smallest window nothing is cut off: docks, close buttons, words of buttons."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QSize
from PySide6.QtWidgets import QPushButton


def overhanging(window):
    """Return the docks, and the page in the middle, that reach out of the window."""
    parts = [window.centralWidget(), *(dock for dock in window.docks if dock.isVisible())]
    return [part for part in parts if part.geometry().right() > window.width()]


@pytest.mark.parametrize("size", [QSize(1024, 700), QSize(900, 600)])
def test_every_station_fits_into_a_small_window(with_grains, idle, size):
    window = with_grains
    window.resize(size)
    idle()
    for station in [station.id for station in window.stations]:
        window.enter(station)
        idle()
        assert window.size() == size
        assert overhanging(window) == [], station
        assert window.viewport.width() >= 180, station


def test_the_buttons_of_the_first_page_have_room_for_their_words(window, idle):
    for size in (QSize(900, 600), QSize(1440, 900), QSize(900, 600)):
        window.resize(size)
        idle()
        page = window.welcome
        for button in (page.open_button, page.sample_button, page.meshes_button, page.project_button):
            assert isinstance(button, QPushButton)
            words = button.fontMetrics().horizontalAdvance(button.text())
            assert button.width() >= words + 20, (size, button.text())


def test_after_a_scan_is_opened_the_main_button_leads_on(scanned, idle):
    panel = scanned.stations.scan.panel
    assert panel.next_button.isVisible()
    assert panel.open_button.property("primary") == ""
    assert not panel.sample_button.isVisible()
    panel.next_button.click()
    assert scanned.stations.current.id == "grains"
    scanned.project_files.new_project()
    idle()
    assert panel.open_button.property("primary") == "true"
    assert not panel.next_button.isVisibleTo(panel)


def test_the_two_ghosts_are_told_apart_by_their_icons(window):
    ghosts = [window.view.scene.layers[name] for name in ("ghost_a", "ghost_b")]
    assert ghosts[0].icon != ghosts[1].icon
