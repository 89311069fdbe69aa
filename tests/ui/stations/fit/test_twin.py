"""The twin in the window: fitted live, paused, stopped, cancelled; its contacts, network, fabric, files."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from scipy import ndimage

from mbstudio.core.grains import load_labels
from mbstudio.core.grains.editing.records import Merge
from mbstudio.core.imaging import fit
from mbstudio.core.project import Project
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.ui.stations.fit.twin.residual_tint import REACH, residual_tint
from tests.core.project.test_twin_table import made_twin
from tests.ui.conftest import PATIENCE


@pytest.fixture(scope="module")
def scanned():
    """Two ellipsoids that touch, with their avatars."""
    bodies = ((np.array([9.3, 12.2, 12.4]), [7.0, 6.0, 6.5]), (np.array([23.3, 12.2, 12.4]), [7.0, 6.6, 5.6]))
    z, y, x = np.mgrid[:26, :26, :36]
    shares = [
        np.clip(0.5 - 6 * (np.sqrt((((np.stack((x, y, z), -1) - m) / a) ** 2).sum(-1)) - 1), 0, 1)
        for m, a in bodies
    ]
    image = 1000 + 1000 * ndimage.gaussian_filter(shares[0] + shares[1], 0.6)
    image += 20 * np.random.default_rng(3).standard_normal(image.shape)
    scan = Scan(image.astype(np.float32), VoxelSize.parse("20 um"))
    grains = load_labels(np.where(shares[0] > 0.5, 1, 2 * (shares[1] > 0.5)).astype(np.int32), scan)
    return scan, grains, {grain.label: fit(grain, 8) for grain in grains}


@pytest.fixture
def twinning(window, scanned, idle):
    """The window with that project, the twin open at station Fit."""
    scan, grains, fits = scanned
    project = Project.new(scan, embed_scan=True)
    project.change("Load labels", grains=grains)
    project.add_fits(fits)
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    idle()
    assert window.commands.run("fit.twin")
    idle()
    return window


def test_it_is_fitted_before_the_eyes_and_kept_as_one_change(twinning, idle, tmp_path):
    window, station = twinning, twinning.stations.fit
    dock, work = station.twin_dock, station.twin_work
    assert window.docks["twin"].isVisible()
    assert not window.docks["curve"].isVisible()
    seen, tints = [], []
    work.moved.connect(lambda: seen.append(len(work.misfits)))
    window.view.tinted.connect(lambda: tints.append(sorted(window.view.tints)))
    before = dict(window.workspace.state.fits)
    QTest.mouseClick(dock.start_button, Qt.MouseButton.LeftButton)
    assert work.run.is_running
    idle()
    assert ["x", "y", "z"] in tints
    twin = window.workspace.state.twin
    assert len(twin.misfits) == 5
    assert twin.misfits[-1] < twin.misfits[0]
    assert max(seen) == 5
    assert {fit.fitted_to for fit in window.workspace.state.fits.values()} == {"grey values"}
    assert dock.table.content.rowCount() == 1
    assert window.view.scene.layers.network.is_visible
    assert window.view.scene.layers.network.holds_something
    picture = dock.picture
    assert picture.pixmap().isNull()
    assert dock.tabs.currentIndex() == 1
    dock.tabs.setCurrentIndex(2)
    idle()
    assert not picture.pixmap().isNull()
    for ending in ("csv", "vtu", "graphml"):
        station.twin_link.export(tmp_path / f"sand.{ending}")
    station.twin_link.save_figure(tmp_path / "fabric.svg")
    idle()
    with (tmp_path / "sand.csv").open() as stream:
        assert [row["a"] for row in csv.DictReader(stream)] == ["1"]
    assert (tmp_path / "sand.graphml").stat().st_size > 300
    assert (tmp_path / "sand.vtu").stat().st_size > 500
    assert (tmp_path / "fabric.svg").stat().st_size > 10_000
    window.workspace.undo()
    assert window.workspace.state.twin is None
    assert dict(window.workspace.state.fits) == before
    assert not window.view.scene.layers.network.holds_something
    assert window.view.tints == {}
    window.workspace.redo()
    assert window.workspace.state.twin is twin


def test_it_waits_goes_on_and_is_given_up(twinning, idle, qtbot):
    window, work = twinning, twinning.stations.fit.twin_work
    begun = window.workspace.state
    assert window.commands.run("fit.start_twin")
    assert window.commands.run("fit.pause_twin")
    assert work.run.is_paused
    assert window.commands.run("fit.pause_twin")
    assert not work.run.is_paused
    assert window.commands.run("fit.cancel_twin")
    idle()
    assert window.workspace.state is begun
    assert not work.has_residual
    # Ended early it is kept as it stands.
    window.commands.run("fit.start_twin")
    qtbot.waitUntil(lambda: work.run.can_stop, timeout=PATIENCE)
    window.commands.run("fit.stop_twin")
    idle()
    assert 1 <= len(window.workspace.state.twin.misfits) < 5


def test_a_pair_is_looked_at_and_the_network_coloured(twinning, idle):
    window, station = twinning, twinning.stations.fit
    twin = made_twin((1, 2))
    window.workspace.change("Fit the twin", twin=twin)
    idle()
    dock = station.twin_dock
    assert dock.facts.text().startswith("2 grains · 1 contact")
    assert dock.notes.text() == "Look."
    dock.table.selectRow(0)
    assert window.workspace.chosen == {1, 2}
    window.view.show_layer("network", True)
    layer = window.view.scene.layers.network
    headings = []
    for place in range(dock.measure.count()):
        dock.measure.setCurrentIndex(place)
        headings.append(layer.scale.heading.GetInput())
    assert len(set(headings)) == 4
    assert "%" in headings[2]
    # Without a contact there is a table of near misses.
    far = replace(twin, contacts=twin.contacts.assign(probability=0.1))
    window.workspace.change("Fit the twin", twin=far)
    idle()
    assert dock.table.content.rowCount() == 0
    dock.near.setChecked(True)
    assert dock.table.content.rowCount() == 1
    assert not window.commands.action("fit.save_fabric").isEnabled()


def test_grains_that_are_corrected_take_the_contacts_away(twinning, idle):
    window = twinning
    window.workspace.change("Fit the twin", twin=made_twin((1, 2)))
    window.workspace.edit_grains(Merge(labels=(1, 2)), "Merge")
    idle()
    assert window.workspace.state.twin is None
    assert "Undo" in window.message_bar.text


def test_residuals_are_red_where_the_scan_is_brighter():
    picture = residual_tint(np.array([[REACH, -REACH, 0.0, 0.02]], np.float32))
    red, blue, none, little = picture[0].astype(int)
    assert red[0] > red[2] + 100
    assert blue[2] > blue[0] + 60
    assert red[3] > 180
    assert none[3] == little[3] == 0
