"""Exact surfaces of grains in the project file: kept to the last bit, checked when they are read."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import trimesh

from mbstudio.core.errors import ProjectError
from mbstudio.core.grains.mesh_set import grain_set_from_meshes
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.file import read_project, write_project


@pytest.fixture
def grains(tmp_path):
    for number, radius in enumerate((1.0, 0.7)):
        trimesh.creation.icosphere(subdivisions=2, radius=radius).export(tmp_path / f"µ {number}.stl")
    return grain_set_from_meshes(tmp_path, 16, "mm")


def test_surfaces_and_files_come_back(tmp_path, grains):
    project = Project(ProjectState(grains=grains))
    project.save(tmp_path / "stones.mbs")
    with h5py.File(tmp_path / "stones.mbs") as file:
        assert file.attrs["schema"] == 5
    again = Project.open(tmp_path / "stones.mbs").grains
    assert list(again.table["file"]) == [str(tmp_path / "µ 0.stl"), str(tmp_path / "µ 1.stl")]
    assert again.is_of_meshes
    for label in (1, 2):
        np.testing.assert_array_equal(again.meshes[label].vertices, grains.meshes[label].vertices)
        np.testing.assert_array_equal(again.meshes[label].faces, grains.meshes[label].faces)


@pytest.mark.parametrize(
    ("part", "values"),
    [
        ("faces", lambda rows: rows + 1000),
        ("faces", lambda rows: -rows),
        ("vertices_offsets", lambda ends: ends[::-1].copy()),
        ("faces_offsets", lambda ends: ends + 1),
    ],
)
def test_damaged_surfaces_are_refused_with_the_name_of_the_file(tmp_path, grains, part, values, edit_project):
    path = tmp_path / "stones.mbs"
    write_project(path, ProjectState(grains=grains))
    with edit_project(path) as file:
        damaged = values(file[f"grains/meshes/{part}"][:])
        file[f"grains/meshes/{part}"][...] = damaged
    with pytest.raises(ProjectError, match=r"stones\.mbs"):
        read_project(path)
