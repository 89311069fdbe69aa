"""Meshes in the window: many files at once become grains that are seen, fitted, measured and saved."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PySide6.QtCore import Qt

from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.project import Project, ProjectState
from mbstudio.ui.shell.dialogs import leave_card
from mbstudio.ui.stations.grains.mesh_dialog import MeshDialog, likely_unit
from mbstudio.ui.stations.grains.mesh_link import sort_out
from mbstudio.ui.stations.grains.mesh_summary import MeshSummary
from mbstudio.ui.stations.grains.table_model import NAME
from mbstudio.ui.view.view_surfaces import TRIANGLES
from tests.ui.test_bad_input import drop

SIZES = {"a_box": (2.0, 1.6, 1.2), "b_ball": (1.8, 1.8, 1.8), "c_egg": (2.4, 1.5, 1.3)}


def body(name):
    if name == "a_box":
        return trimesh.creation.box(SIZES[name])
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    ball.vertices *= SIZES[name]
    return ball


@pytest.fixture
def stones(tmp_path):
    """Three stones as STL, one with a hole, and notes."""
    folder = tmp_path / "stones"
    folder.mkdir()
    for name in SIZES:
        body(name).export(folder / f"{name}.stl")
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.update_faces(list(range(2, len(ball.faces))))
    ball.export(folder / "d_broken.stl")
    (folder / "notes.txt").write_text("no mesh")
    return folder


def dialog_of(window):
    (dialog,) = window.findChildren(MeshDialog)
    return dialog


def open_stones(window, idle, *paths, resolution=24, unit="mm"):
    """Drop files, answer the dialog, and wait until all is drawn."""
    drop(window, *paths)
    idle()
    dialog = dialog_of(window)
    dialog.resolution.setValue(resolution)
    dialog.unit.setCurrentIndex(dialog.unit.findData(unit))
    dialog.accept()
    idle()


@pytest.fixture
def opened(window, idle, stones):
    """The window with three stones."""
    open_stones(window, idle, *(stones / f"{name}.stl" for name in SIZES))
    return window


def test_open_fit_measure_save_and_open_again(opened, idle, tmp_path):
    window, space = opened, opened.workspace
    assert window.stations.current.id == "grains"
    space.change_fit_settings(n=12)
    window.enter("fit")
    space.select(1)
    assert window.commands.run("fit.grain")
    idle()
    window.stations.fit.work.fit_all()
    idle()
    assert sorted(space.state.fits) == [1, 2, 3]
    window.enter("populations")
    assert window.commands.run("populations.measure")
    idle()
    measured = window.stations.populations.work.measured.found
    expected = [body(name).volume for name in SIZES]
    np.testing.assert_allclose(measured.grains.factors["volume"], expected, rtol=1e-6)
    np.testing.assert_allclose(measured.avatars.factors["volume"], expected, rtol=0.03)
    assert (measured.grains.unit, measured.grains.surface) == ("mm", "mesh")
    assert space.can_be_saved
    path = tmp_path / "stones.mbs"
    window.project_work.save(path)
    idle()
    assert not space.is_modified
    window.project_work.new()
    window.project_files.open_path(path)
    idle()
    assert space.state.grains.name_of(3) == "c_egg"
    assert sorted(space.state.fits) == [1, 2, 3]
    assert sorted(space.state.grains.meshes) == [1, 2, 3]
    window.enter("populations")
    assert window.commands.run("populations.measure")
    idle()
    again = window.stations.populations.work.measured.found.grains
    np.testing.assert_array_equal(again.factors["area"], measured.grains.factors["area"])


def test_what_is_no_mesh_or_has_holes_is_named_in_one_message(window, idle, stones):
    said = []
    window.messages.shown.connect(lambda level, text: said.append((level, text)))
    open_stones(window, idle, stones, stones / "notes.txt")
    assert len(window.workspace.state.grains) == 3
    (level, text) = said[-1]
    assert len(said) == 1
    assert level == "warning"
    assert "3 grains of 3 meshes, 1.8 mm to 2.4 mm long" in text
    assert "2 left out: notes.txt, d_broken.stl" in text
    window.message_bar._action.click()
    (summary,) = window.findChildren(MeshSummary)
    told = summary.text.toPlainText()
    assert "notes.txt is no mesh" in told
    assert "d_broken.stl is not closed" in told
    assert str(stones) not in told
    summary.reject()


def test_only_broken_files_are_one_error(window, idle, stones):
    (stones / "e_bad.stl").write_bytes(b"x")
    drop(window, stones / "d_broken.stl", stones / "e_bad.stl")
    idle()
    assert window.messages.level == "error"
    assert "None of the 2 files could be read" in window.messages.text
    assert not window.findChildren(MeshDialog)
    drop(window, stones / "d_broken.stl")
    idle()
    assert "d_broken.stl is not closed" in window.messages.text
    assert window.workspace.state.grains is None


def test_the_dialog_says_how_large_the_unit_makes_the_first_stone(window, idle, stones):
    drop(window, stones)
    idle()
    dialog = dialog_of(window)
    assert dialog.unit.currentData() == "mm"
    assert dialog.hint == "a_box.stl: the stone is 2 mm across."
    dialog.unit.setCurrentIndex(dialog.unit.findData("m"))
    assert dialog.hint == "a_box.stl: the stone is 2 m across. Is the unit right?"
    assert not dialog.override.isVisibleTo(dialog)
    dialog.reject()
    idle()
    assert window.workspace.state.grains is None


def test_a_file_that_states_its_unit_is_believed_unless_told_otherwise(window, idle, tmp_path):
    path = tmp_path / "stone.glb"
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.01)
    ball.export(path)
    drop(window, path)
    idle()
    dialog = dialog_of(window)
    assert dialog.hint == "stone.glb: the stone is 20 mm across. The file states its unit, m."
    dialog.override.setChecked(True)
    dialog.unit.setCurrentIndex(dialog.unit.findData("cm"))
    assert "200 µm across" in dialog.hint
    dialog.override.setChecked(False)
    dialog.accept()
    idle()
    grains = window.workspace.state.grains
    assert grains.unit == "m"
    assert grains.grain(1).volume == pytest.approx(ball.volume, rel=0.02)


@pytest.mark.parametrize(
    ("length", "before", "unit"),
    [(22.0, "", "mm"), (0.022, "", "m"), (5000.0, "", "um"), (2.0, "cm", "cm"), (5000.0, "m", "um"),
     (None, "um", "um"), (1e12, "", "mm")],
)  # fmt: skip
def test_the_likely_unit_is_the_one_that_makes_a_stone(length, before, unit):
    assert likely_unit(length, before) == unit


def test_opening_is_one_step_of_undo(scanned, idle, stones):
    """Grains of meshes replace the scan; undo brings it back, redo the stones."""
    window, space = scanned, scanned.workspace
    before = space.state
    open_stones(window, idle, stones / "b_ball.stl")
    assert space.state.scan is None
    assert space.undo_title == "Open b_ball.stl"
    window.commands.run("edit.undo")
    idle()
    assert space.state is before
    assert space.sliced is space.scan is not None
    window.commands.run("edit.redo")
    idle()
    assert space.state.grains.name_of(1) == "b_ball"
    assert space.sliced.shape == space.state.grains.labels.shape


def test_a_cancelled_opening_changes_nothing(window, idle, stones, monkeypatch):
    def stop_midway(*_, progress, **__):
        window.queue.running().cancel()
        progress(0.5, "b_ball.stl")

    monkeypatch.setattr("mbstudio.ui.stations.grains.mesh_work.grain_set_from_meshes", stop_midway)
    open_stones(window, idle, stones)
    assert window.workspace.state.grains is None
    assert window.queue.is_idle


def test_stones_lie_side_by_side_and_are_picked_where_they_lie(opened, idle):
    scene, grains = opened.view.scene, opened.workspace.state.grains
    assert opened.view.scene.layers.grains.is_visible
    picture = scene.screenshot()
    renderer = scene.plotter.renderer
    places = []
    for label in (1, 2, 3):
        middle = grains.meshes[label].vertices.mean(axis=0)
        renderer.SetWorldPoint(*middle, 1.0)
        renderer.WorldToDisplay()
        x, y, _ = renderer.GetDisplayPoint()
        assert scene.label_at(x, y) == label
        places.append((x, y))
        red, green, blue = picture[picture.shape[0] - 1 - round(y), round(x)].astype(int)
        assert max(red, green, blue) - min(red, green, blue) > 15, "in its colour, not on empty ground"
    assert np.ptp(np.array(places), axis=0).max() > 100, "apart from each other"


def test_the_chosen_stone_is_shown_as_the_file_has_it(opened, idle):
    opened.enter("fit")
    opened.workspace.select(2)
    idle()
    mesh = opened.view.scene.layers.grain._mesh
    assert mesh.n_cells == len(opened.workspace.state.grains.meshes[2].faces)
    factors = opened.stations.fit.panel.factors
    assert factors.has_grain
    assert not opened.stations.fit.panel.intervals_button.isVisibleTo(opened.stations.fit.panel)
    assert "b_ball" in opened.stations.fit.panel._facts.text()


def test_slices_cut_through_the_voxels(opened, idle):
    window, space = opened, opened.workspace
    window.enter("grains")
    panes = window.slice_views.panes.panes
    space.select(2)
    idle()
    planes = window.view.scene.layers.slices.planes
    row = space.state.grains.table.iloc[1]
    assert planes.index["x"] == (row["x0"] + row["x1"]) // 2
    image = planes.greys["z"]
    column, line = planes.index["x"], planes.index["y"]
    assert image[line, column] == 159, "the stone is grey where it is cut"
    assert image[0, 0] == 0
    assert all(pane._image is not None for pane in panes.values())
    window.slice_views._tell((column, line, planes.index["z"]))
    assert window.slice_views.readout.text().endswith("grain 2   b_ball")
    window.enter("scan")
    words = window.stations.scan.panel._empty
    assert "come from meshes" in words.text()
    assert window.stations.scan.panel.sliders["z"].isVisibleTo(window.stations.scan.panel)


def test_the_table_names_the_files(opened, stones):
    table = opened.stations.grains.table
    content = table.content
    role = Qt.ItemDataRole
    volumes = [float(content.data(content.index(row, 1), role.DisplayRole)) for row in range(3)]
    assert volumes == pytest.approx([body(name).volume for name in SIZES], rel=0.01)
    names = [content.data(content.index(row, NAME), role.DisplayRole) for row in range(3)]
    assert names == list(SIZES)
    assert content.data(content.index(0, NAME), role.ToolTipRole) == str(stones / "a_box.stl")
    assert table.horizontalHeader().visualIndex(NAME) == 1
    panel = opened.stations.grains.panel
    assert not panel.find_button.isVisibleTo(panel)
    assert "From 3 mesh files." in panel._inside.text()


def test_a_scan_after_meshes_has_its_columns_again(opened, idle, scan_path):
    opened.stations.scan.work.open(scan_path, "14 um")
    idle()
    opened.commands.run("grains.find")
    idle()
    header = opened.stations.grains.table.horizontalHeader()
    assert header.visualIndex(NAME) == NAME
    panel = opened.stations.grains.panel
    assert panel.find_button.isVisibleTo(panel)


def test_what_was_mended_is_told_in_the_words_of_the_window(window, idle, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3)
    inner = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    inner.invert()
    trimesh.util.concatenate([ball, inner]).export(tmp_path / "hollow.stl")
    open_stones(window, idle, tmp_path / "hollow.stl")
    assert window.messages.level == "warning"
    told = window.messages.text
    assert "hollow.stl has 1 enclosed cavity" in told
    assert "choose “Keep as voids” to keep it" in told
    assert "--" not in told
    assert str(tmp_path) not in told


def test_kept_cavities_are_fitted_as_voids(window, idle, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3)
    inner = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    inner.invert()
    trimesh.util.concatenate([ball, inner]).export(tmp_path / "hollow.stl")
    drop(window, tmp_path / "hollow.stl")
    idle()
    dialog = dialog_of(window)
    dialog.resolution.setValue(32)
    dialog.cavities.setCurrentIndex(1)
    dialog.accept()
    idle()
    space = window.workspace
    assert space.state.fit_settings.options["cavities"] == "keep"
    assert space.undo_title == "Open hollow.stl"
    space.change_fit_settings(n=20)
    window.stations.fit.work.fit(1)
    idle()
    fitted = space.state.fits[1].avatar.mesh(cells=40)
    assert fitted.volume == pytest.approx(0.875 * ball.volume, rel=0.1)


def test_files_are_sorted_out_before_anything_is_read(stones, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "old.mbs").write_text("")
    meshes, left_out = sort_out([stones, stones / "a_box.stl", tmp_path / "empty", tmp_path / "old.mbs"])
    assert [path.name for path in meshes] == ["a_box.stl", "b_ball.stl", "c_egg.stl", "d_broken.stl"]
    told = {path.name: reason for path, reason in left_out}
    assert "contains no meshes" in told["empty"]
    assert "open it by itself" in told["old.mbs"]


def test_grains_without_a_scan_can_be_saved_and_are_asked_about(window, idle, stones):
    grains = grain_set_from_meshes(stones / "b_ball.stl", 20, "mm")
    window.workspace.replace_project(Project(ProjectState(grains=grains)))
    idle()
    window.workspace.change("Fit settings", fit_settings=window.workspace.state.fit_settings)
    window.project_files.asks = True
    window.commands.run("project.new")
    assert isinstance(window.project_files.leaving, leave_card.LeaveCard)
    assert window.project_files.leaving.isVisible()
    window.project_files.asks = False
    window.project_files.leaving.take_away()


def test_48_stones_are_opened_at_once(window, idle, shared_data):
    open_stones(window, idle, shared_data / "aggregates", resolution=20)
    grains = window.workspace.state.grains
    assert len(grains) == len(grains.meshes) == 48
    assert window.messages.level == "success"
    shown = window.view.scene.layers.grains._mesh
    triangles = sum(len(mesh.faces) for mesh in grains.meshes.values())
    assert shown.n_cells == pytest.approx(min(triangles, TRIANGLES["software"][0]), rel=0.3)
