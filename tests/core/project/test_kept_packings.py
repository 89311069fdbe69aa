"""Packings in a project: kept by its file, brought along by a merge, gone with the sizes of their grains."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

from mbstudio.core.errors import ProjectError
from mbstudio.core.packing.trial import run_trial
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.project.merging import merge_states
from mbstudio.core.project.voxel_size import correct_voxel_size
from mbstudio.core.sealing import seal_image
from mbstudio.core.units import VoxelSize
from tests.core.packing.conftest import irregular
from tests.core.project.test_voxel_size import OLD, project_of


@pytest.fixture(scope="module")
def trial():
    return run_trial({"parents": [irregular(1), irregular(2)]}, 6, spheres=4, processes=1)


def test_the_file_keeps_a_packing_and_older_formats_none(trial, tmp_path):
    path = tmp_path / "packed.mbs"
    write_project(path, ProjectState(packing=trial))
    again = read_project(path).packing
    assert again.first.summary(0.0) == trial.first.summary(0.0)
    with h5py.File(path) as file:
        assert file.attrs["schema"] == 9
    write_project(path, ProjectState())
    with h5py.File(path) as file:
        assert file.attrs["schema"] == 1
    assert read_project(path).packing is None


def test_a_spoilt_packing_is_refused(trial, tmp_path):
    path = tmp_path / "packed.mbs"
    write_project(path, ProjectState(packing=trial))
    with h5py.File(path, "r+") as file:
        file["packing/quaternions_0"][2] *= 2.0
    image = bytearray(path.read_bytes())
    seal_image(image)
    path.write_bytes(image)
    with pytest.raises(ProjectError, match="no rotation"):
        read_project(path)


def test_a_merge_takes_the_packing_of_who_made_one(trial):
    begun = ProjectState()
    packed = replace(begun, packing=trial)
    assert merge_states(begun, packed, begun).state.packing is trial
    assert merge_states(begun, begun, packed).state.packing is trial


@pytest.mark.parametrize("size", [VoxelSize(4.0, 4.0, 4.0, "um"), VoxelSize(2.0, 2.0, 3.0, "um")])
def test_a_correction_of_the_voxel_size_removes_the_packing(trial, size):
    project: Project = project_of(OLD)
    project.change("Pack grains", packing=trial)
    found = correct_voxel_size(project.state, size)
    assert found.state.packing is None
    assert any("packing" in note for note in found.notes)
    assert np.array_equal(project.state.packing.first.poses.kinds, trial.first.poses.kinds)
