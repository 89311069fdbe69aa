"""Grain, avatar and clone side by side in the window."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from mbstudio.core.imaging.fitting import fit
from mbstudio.core.project import Project, ProjectState


@pytest.fixture
def fitted(window, idle, two_grains):
    """The window at station Fit with grain 1 fitted and chosen."""
    result = fit(two_grains.grain(1), 6)
    window.workspace.replace_project(Project(ProjectState(grains=two_grains, fits={1: result})))
    window.workspace.select(1)
    window.enter("fit")
    idle()
    return window


def thirds(window):
    """Return the hue (red minus blue) of the middle of each third of the view."""
    picture = window.viewport.picture().astype(int)
    height, width, _ = picture.shape
    places = [width // 6, width // 2, 5 * width // 6]
    return [picture[height // 2, x, 0] - picture[height // 2, x, 2] for x in places]


def test_grain_and_avatar_stand_side_by_side_and_the_view_comes_back(fitted, idle):
    window = fitted
    before = window.viewport.picture()
    assert window.commands.run("view.side_by_side")
    idle()
    grain, avatar, clone = thirds(window)
    assert grain > 60, "the grain's sand colour"
    assert avatar < -60, "the avatar's blue"
    assert abs(clone) < 40, "no clone yet"
    columns = window.view.scene.layers.side_by_side
    captions = [caption.GetInput() for caption, _ in columns._texts]
    assert captions == ["Grain 1", f"Avatar, n = {window.workspace.state.fits[1].avatar.n}", "Clone"]
    # A click chooses nothing there: what it would choose is not to be seen.
    QTest.mouseClick(window.viewport, Qt.MouseButton.LeftButton, pos=window.viewport.rect().center())
    assert window.workspace.selected == 1
    assert window.commands.run("view.side_by_side")
    after = window.viewport.picture()
    assert (np.abs(after.astype(int) - before).max(axis=2) > 8).mean() < 0.002


def test_it_is_left_with_its_stations_and_comes_back_with_them(fitted, idle):
    window = fitted
    assert window.commands.run("view.side_by_side")
    idle()
    window.enter("grains")
    idle()
    assert not window.view.scene.layers.side_by_side.is_shown
    assert not window.commands.run("view.side_by_side"), "not at this station"
    window.enter("fit")
    idle()
    assert window.view.scene.layers.side_by_side.is_shown
    window.workspace.select(2)
    idle()
    captions = [caption.GetInput() for caption, _ in window.view.scene.layers.side_by_side._texts]
    assert captions[:2] == ["Grain 2", "Avatar"]
    grain, avatar, _ = thirds(window)
    assert grain > 60
    assert abs(avatar) < 40, "grain 2 has no avatar"


def test_the_convergence_curve_is_saved_as_a_drawing(fitted, idle, tmp_path):
    window = fitted
    for name in ("curve.svg", "curve.pdf"):
        window.stations.fit.link.save_curve(tmp_path / name)
        idle()
        assert window.messages.level == "success", window.messages.text
    drawing = (tmp_path / "curve.svg").read_text()
    assert drawing.lstrip().startswith("<?xml")
    assert drawing.count("<path") > 5
    assert (tmp_path / "curve.pdf").read_bytes().startswith(b"%PDF")
    window.stations.fit.link.save_curve(tmp_path / "curve.doc")
    assert window.messages.level == "error"
    window.workspace.select(2)
    assert not window.commands.run("view.save_curve"), "grain 2 has no fit"
