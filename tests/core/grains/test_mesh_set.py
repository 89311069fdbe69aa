"""Many bodies of mesh files as grains: one each, named by their files, in one set."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import trimesh

from mbstudio.core.errors import GrainWarning, MeshError, UnitError
from mbstudio.core.grains import Grain
from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.project import Project


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
    with pytest.raises(MeshError, match="None of the 1 files"):
        grain_set_from_meshes([stones / "bad.stl"], 20, "mm", on_failure=lambda *_: None)
    with pytest.raises(UnitError, match=r"stone0\.ply does not contain its unit"):
        grain_set_from_meshes([stones / "stone0.ply", stones / "stone1.stl"], 20)
    (tmp_path / "empty").mkdir()
    for nothing in (tmp_path / "empty", str(tmp_path / "*.ply")):
        with pytest.raises(MeshError, match="no meshes"):
            Grain.from_meshes(nothing, unit="mm")
