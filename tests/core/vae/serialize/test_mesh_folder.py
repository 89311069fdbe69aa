"""Meshes as parents: the bodies that fit and measure take, by name."""

from __future__ import annotations

import pytest
import trimesh

from mbstudio.core.errors import GrainWarning, MeshError, SerializationError
from mbstudio.core.vae.serialize.mesh_folder import read_one_body, read_parents


@pytest.fixture
def folder(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2)
    inner = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    ball.export(tmp_path / "one.stl")
    trimesh.util.concatenate([ball, ball.copy().apply_translation((5, 0, 0))]).export(tmp_path / "two.ply")
    trimesh.util.concatenate([ball, inner]).export(tmp_path / "hollow.obj")
    (tmp_path / "notes.txt").write_text("no mesh")
    return tmp_path


def test_the_bodies_of_a_folder(folder):
    with pytest.warns(GrainWarning, match="1 enclosed cavity"):
        bodies, names = read_parents(folder, "mm")
    assert names == ["hollow", "one", "two#1", "two#2"]
    volume = trimesh.creation.icosphere(subdivisions=2).volume
    assert [body.volume for body in bodies] == pytest.approx([volume] * 4, rel=1e-5)
    assert {body.units for body in bodies} == {"mm"}
    bodies, names = read_parents([folder / "one.stl", str(folder / "t*.ply")], limit=2)
    assert names == ["one", "two#1"]
    assert bodies[0].units is None


def test_one_body_of_a_file(folder):
    assert read_one_body(folder / "one.stl", "um").units == "um"
    with pytest.raises(SerializationError, match="contains 2 bodies"):
        read_one_body(folder / "two.ply")
    (folder / "bad.stl").write_bytes(b"nothing")
    with pytest.raises(MeshError, match=r"bad\.stl"):
        read_parents(folder, "mm")
    with pytest.raises(MeshError, match="does not exist"):
        read_parents(folder / "missing")
