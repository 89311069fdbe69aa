"""Many bodies of mesh files as grains: one each, named by their files, in one set."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import trimesh

from mbstudio.core.errors import Cancelled, GrainError, GrainWarning, MeshError, UnitError
from mbstudio.core.grains import Grain, mesh_set
from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.grains.solid_voxels import solid_as_scan
from mbstudio.core.project import Project
from mbstudio.core.project.measuring import measure_project


@pytest.fixture
def stones(tmp_path):
    """Five ellipsoids of different sizes, each around its own origin, and a file that is none."""
    folder = tmp_path / "stones"
    folder.mkdir()
    for number, radius in enumerate((1.0, 1.4, 0.9, 1.1, 0.6)):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
        ball.vertices *= (1, 1.2, 0.8)
        ball.export(folder / f"stone{number}.{('ply', 'stl', 'obj', 'off', 'glb')[number]}")
    (folder / "notes.txt").write_text("no mesh")
    return folder


def true_volumes():
    ball = trimesh.creation.icosphere(subdivisions=3)
    return [0.96 * ball.volume * radius**3 for radius in (1.0, 1.4, 0.9, 1.1, 0.6)]


@pytest.mark.parametrize("how", ["folder", "pattern", "files"])
def test_grains_of_folders_patterns_and_files(stones, how):
    given = {
        "folder": stones,
        "pattern": str(stones / "stone*.*"),
        "files": sorted(stones.glob("stone?.*")),
    }[how]
    with pytest.warns(GrainWarning, match="is in m by its format"):
        grains = Grain.from_meshes(given, 40, "mm")
    assert [grain.name for grain in grains] == [f"stone{i}" for i in range(5)]
    assert all(max(grain.mask.shape) == 40 for grain in grains)
    assert [grain.volume for grain in grains] == pytest.approx(true_volumes(), rel=0.01)
    with pytest.warns(GrainWarning):
        found = grain_set_from_meshes(given, 40, "mm")
    assert list(found.table["name"]) == [f"stone{i}" for i in range(5)]
    assert found.interior_labels == [1, 2, 3, 4, 5]
    assert [found.grain(label).volume for label in range(1, 6)] == pytest.approx(true_volumes(), rel=0.02)
    assert found.grain(3).name == "stone2"


def test_names_outlive_saving(stones, tmp_path):
    grains = grain_set_from_meshes(sorted(stones.glob("stone[0-3].*")), 20, "mm")
    project = Project.new()
    project.change("Load mesh", grains=grains)
    project.save(tmp_path / "a.mbs")
    again = Project.open(tmp_path / "a.mbs").grains
    assert [grain.name for grain in again] == ["stone0", "stone1", "stone2", "stone3"]


def test_bodies_of_one_file_keep_their_places(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3)
    places = [(10.3, 0, 0), (13, 1, 0.7), (10, 4, 2)]
    bodies = [ball.copy().apply_translation(place) for place in places]
    trimesh.util.concatenate(bodies).export(tmp_path / "pack.stl")
    found = grain_set_from_meshes(tmp_path / "pack.stl", 30, "mm")
    assert list(found.table["name"]) == ["pack#1", "pack#2", "pack#3"]
    for grain, place in zip(found, places, strict=True):
        np.testing.assert_allclose(grain.centroid, place, atol=0.02)
        assert grain.volume == pytest.approx(ball.volume, rel=0.01)
    with pytest.raises(MeshError, match="3 separate bodies"):
        Grain.from_mesh(tmp_path / "pack.stl", unit="mm")
    assert len(Grain.from_meshes(tmp_path / "pack.stl", 20, "mm")) == 3


def test_one_body_alone_is_what_from_mesh_makes(stones):
    alone = Grain.from_mesh(stones / "stone0.ply", 30, "mm")
    (found,) = grain_set_from_meshes(stones / "stone0.ply", 30, "mm")
    np.testing.assert_array_equal(found.mask, alone.mask)
    np.testing.assert_allclose(found.origin, alone.origin, atol=1e-12)


def test_units_are_brought_together(stones):
    """A GLB in metres beside a PLY that is told to be in metres too, and bodies of unlike sizes."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = grain_set_from_meshes([stones / "stone0.ply", stones / "stone4.glb"], 60, "m")
    assert found.unit == "m"
    tiny = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    tiny.export(stones / "tiny.ply")
    with pytest.warns(GrainWarning, match="1 of the 2 bodies are less than 30 voxels long"):
        grain_set_from_meshes([stones / "stone0.ply", stones / "tiny.ply"], 60, "m")


def test_what_cannot_be_read_is_told_by_name(stones, tmp_path):
    (stones / "bad.stl").write_bytes(b"nothing")
    failed = []
    with pytest.warns(GrainWarning):
        found = grain_set_from_meshes(
            stones, 20, "mm", on_failure=lambda path, error: failed.append((path.name, str(error)))
        )
    assert len(found) == 5
    assert failed[0][0] == "bad.stl"
    assert "7 bytes" in failed[0][1]
    with pytest.raises(MeshError, match=r"bad\.stl"):
        grain_set_from_meshes(stones, 20, "mm")
    with pytest.raises(MeshError, match="None of 1 file"):
        grain_set_from_meshes([stones / "bad.stl"], 20, "mm", on_failure=lambda *_: None)
    with pytest.raises(UnitError, match=r"stone0\.ply does not contain its unit"):
        grain_set_from_meshes([stones / "stone0.ply", stones / "stone1.stl"], 20)
    (tmp_path / "empty").mkdir()
    for nothing in (tmp_path / "empty", str(tmp_path / "*.ply")):
        with pytest.raises(MeshError, match="no meshes"):
            Grain.from_meshes(nothing, unit="mm")


@pytest.fixture
def three(stones):
    """Three ellipsoids of different sizes from a PLY, an STL and an OBJ."""
    return grain_set_from_meshes(sorted(stones.glob("stone[0-2].*")), 30, "mm")


def test_exact_surfaces_lie_where_the_voxels_do(three, stones):
    assert sorted(three.meshes) == [1, 2, 3]
    for label, volume in zip((1, 2, 3), true_volumes(), strict=False):
        mesh, grain = three.meshes[label].to_trimesh("mm"), three.grain(label)
        assert mesh.volume == pytest.approx(volume, rel=1e-6)
        np.testing.assert_allclose(mesh.center_mass, grain.centroid, atol=0.3 * grain.voxel_size.x)
        measured = three.body(label)
        assert isinstance(measured, trimesh.Trimesh)
        assert measured.units == "mm"
    assert [name.rpartition("/")[2] for name in three.table["file"]] == [
        "stone0.ply", "stone1.stl", "stone2.obj",
    ]  # fmt: skip
    assert three.name_of(2) == "stone1"


def test_a_project_measures_the_meshes_themselves(three):
    project = Project.new()
    project.change("Open meshes", grains=three)
    found = measure_project(project, workers=0).grains
    assert found.surface == "mesh"
    np.testing.assert_allclose(found.factors["volume"], true_volumes()[:3], rtol=1e-6)


def test_the_first_file_lies_at_the_upper_left(three):
    places = three.table[["x", "y"]].to_numpy()
    assert places[:, 0].argmin() in (0, int(places[:, 1].argmin()))
    assert places[0, 1] == places[:, 1].max()


def test_bodies_of_one_file_keep_their_surfaces_in_place(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2)
    bodies = [ball.copy().apply_translation(place) for place in ((10.3, 0, 0), (13, 1, 0.7))]
    trimesh.util.concatenate(bodies).export(tmp_path / "pack.stl")
    found = grain_set_from_meshes(tmp_path / "pack.stl", 20, "mm")
    np.testing.assert_allclose(found.meshes[2].to_trimesh("mm").center_mass, (13, 1, 0.7), atol=1e-6)
    bodies[0].export(tmp_path / "one.stl")
    alone = grain_set_from_meshes(tmp_path / "one.stl", 20, "mm")
    np.testing.assert_allclose(alone.meshes[1].to_trimesh("mm").center_mass, (10.3, 0, 0), atol=1e-6)


@pytest.mark.filterwarnings("ignore:.*volume as voxels:mbstudio.core.errors.GrainWarning")
def test_a_unit_is_assumed_where_a_file_knows_none(stones):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = grain_set_from_meshes([stones / "stone0.ply", stones / "stone4.glb"], 30, assumed_unit="m")
    assert found.unit == "m"
    with pytest.warns(GrainWarning, match="less than 6 voxels"):
        mixed = grain_set_from_meshes([stones / "stone0.ply", stones / "stone4.glb"], 12, assumed_unit="cm")
    assert mixed.grain(2).volume / mixed.grain(1).volume == pytest.approx(1e6 * 0.6**3, rel=0.2)


def test_progress_is_told_file_by_file_and_can_end_the_work(stones):
    told = []
    files = sorted(stones.glob("stone[0-2].*"))
    grain_set_from_meshes(files, 12, "mm", progress=lambda share, name: told.append((share, name)))
    assert [share for share, _ in told] == sorted(share for share, _ in told)
    assert {name for _, name in told} == {"stone0.ply", "stone1.stl", "stone2.obj"}

    def cancel(share, name):
        if name == "stone1.stl":
            raise Cancelled("enough")

    with pytest.raises(Cancelled):
        grain_set_from_meshes(files, 12, "mm", progress=cancel)


def test_a_resolution_that_takes_too_much_memory_is_lowered_and_told(stones, monkeypatch):
    monkeypatch.setattr(mesh_set, "_MOST_VOXELS", 200_000)
    with pytest.warns(GrainWarning, match="more memory than there should be") as told:
        found = grain_set_from_meshes(sorted(stones.glob("stone[0-2].*")), 60, "mm")
    assert found.labels.size <= 240_000
    assert any("voxels along a body" in str(one.message) for one in told)
    with pytest.raises(GrainError, match="resolution=3 is impossible"):
        grain_set_from_meshes(stones / "stone0.ply", 3, "mm")


def test_too_many_triangles_leave_the_voxels(stones, monkeypatch):
    monkeypatch.setattr(mesh_set, "MOST_KEPT", 1000)
    with pytest.warns(GrainWarning, match="shown and measured as voxels"):
        found = grain_set_from_meshes(sorted(stones.glob("stone[0-2].*")), 20, "mm")
    assert not found.meshes
    assert isinstance(found.body(1), Grain)


def test_voxels_of_grains_are_cut_like_a_scan(three):
    scan = solid_as_scan(three)
    np.testing.assert_array_equal(scan.load(), three.labels > 0)
    np.testing.assert_array_equal(scan.voxels[5, 2:9], three.labels[5, 2:9] > 0)
    assert (scan.shape, scan.voxel_size) == (three.labels.shape, three.voxel_size)


def test_flat_faces_along_the_grid_keep_the_volume(tmp_path, rng):
    """A face along the grid takes in a layer of voxels as a whole: which ones, the volume decides."""
    for number in range(6):
        size = rng.uniform(0.5, 1, 3)
        box = trimesh.creation.box(size)
        alone = Grain.from_mesh(box, 60, "mm")
        assert alone.volume == pytest.approx(box.volume, rel=0.01)
        box.export(tmp_path / f"box{number}.stl")
    found = grain_set_from_meshes(tmp_path, 60, "mm")
    for grain, exact in zip(found, found.table["volume"], strict=True):
        assert grain.volume == pytest.approx(exact, rel=0.015)


def test_voxels_of_another_volume_are_told(tmp_path):
    plate = trimesh.creation.box((1, 1, 0.055))
    with pytest.warns(GrainWarning, match=r"has 9\.1% less volume as voxels than as a mesh: raise the resol"):
        grain = Grain.from_mesh(plate, 20, "mm")
    assert grain.mask.shape[0] == 1
