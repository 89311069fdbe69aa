"""Bodies that cannot be measured say so by name; those that can but poorly carry a warning."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.errors import GrainError, MeasureError, MeshError
from mbstudio.core.grains import Grain
from mbstudio.core.metrics import factor_intervals, mass_properties, measure, measure_detail
from mbstudio.core.units import VoxelSize

MEASURES = (measure, measure_detail, factor_intervals)


def grain_of(mask):
    return Grain(np.asarray(mask, dtype=bool), VoxelSize(1, 1, 1, "um"), name="pebble")


@pytest.mark.parametrize("take", MEASURES)
def test_an_empty_mask(take):
    with pytest.raises(MeasureError, match="'pebble' has no voxels"):
        take(grain_of(np.zeros((3, 3, 3))))
    with pytest.raises(GrainError, match="empty"):
        Grain.from_mask(np.zeros((3, 3, 3), dtype=bool), "1 um")


@pytest.mark.parametrize("take", MEASURES)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 20, 20), (1, 1, 9)], ids=["voxel", "plate", "rod"])
def test_a_grain_one_voxel_thick(take, shape):
    with pytest.raises(MeasureError, match=r"'pebble' .* one voxel thick"):
        take(grain_of(np.ones(shape)))


def test_a_staircase_one_voxel_thick_is_found_out_too():
    mask = np.zeros((12, 12, 12))
    z, y, x = np.indices(mask.shape)
    mask[z == (x + y) // 2] = 1
    with pytest.raises(MeasureError, match="one voxel thick"):
        measure(grain_of(mask))


def test_a_plate_two_voxels_thick_carries_a_warning():
    found = measure(grain_of(np.ones((2, 12, 12))))
    assert "Less than 3 voxels thick" in found.warning
    assert found.volume == 288
    assert "Less than" in measure_detail(grain_of(np.ones((2, 12, 12)))).warning
    assert "Only 3.0 of the longest voxel edges thick" in measure(grain_of(np.ones((3, 12, 12)))).warning
    assert measure(grain_of(np.ones((6, 12, 12)))).warning == ""


@pytest.mark.parametrize("take", MEASURES)
def test_two_pieces(take):
    mask = np.zeros((6, 6, 15))
    mask[:, :, :6] = mask[:, :, 9:] = 1
    with pytest.raises(MeasureError, match="in 2 pieces"):
        take(grain_of(mask))


@pytest.mark.parametrize("take", [measure, measure_detail])
def test_meshes_that_are_no_closed_body(take):
    cube = trimesh.creation.box()

    def broken(vertices, faces):
        return trimesh.Trimesh(vertices, faces, process=False)

    with pytest.raises(MeshError, match="not closed"):
        take(broken(cube.vertices, cube.faces[1:]))
    vertices = np.array(cube.vertices)
    vertices[0, 0] = np.inf
    with pytest.raises(MeshError, match="finite"):
        take(broken(vertices, cube.faces))
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]], process=False)
    with pytest.raises(MeshError):
        take(flat)


def test_an_inverted_mesh_is_measured_as_its_mirror_outside():
    cube = trimesh.creation.box((1, 2, 3))
    cube.invert()
    assert measure_detail(cube).inscribed == pytest.approx(1, rel=1e-3)
    assert measure(cube).area == pytest.approx(22)


def test_unknown_conventions():
    cube = trimesh.creation.box()
    with pytest.raises(MeasureError, match="axes='pca'"):
        measure(cube, axes="pca")
    with pytest.raises(MeasureError, match="surface='cubes'"):
        measure(cube, surface="cubes")


def test_a_row_of_voxels_has_no_moment_about_itself():
    with pytest.raises(MeasureError, match="moment"):
        mass_properties(grain_of(np.ones((1, 1, 9))), 2650)
    with pytest.raises(MeasureError, match="no voxels"):
        mass_properties(grain_of(np.zeros((2, 2, 2))), 2650)
