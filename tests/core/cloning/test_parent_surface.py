"""Parents: what they keep of a mesh or a grain, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.cloning.parent_surface import MOST_FACES, ParentSurface
from mbstudio.core.cloning.solid_moments import solid_moments
from mbstudio.core.errors import CloningError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.units import VoxelSize
from tests.core.cloning.conftest import make_stone


def test_it_keeps_the_surface_up_to_pose() -> None:
    stone = make_stone(3)
    parent = ParentSurface.from_mesh(stone, "stone")
    body = parent.body_vertices() * parent.diameter
    assert solid_moments(body, parent.faces).volume == pytest.approx(stone.volume)
    sides = np.linalg.norm(np.diff(np.asarray(stone.vertices)[stone.edges], axis=1)[:, 0], axis=1)
    turned = np.linalg.norm(np.diff(body[stone.edges], axis=1)[:, 0], axis=1)
    assert turned == pytest.approx(sides)
    assert parent.diameter == pytest.approx(np.cbrt(6 * stone.volume / np.pi))
    assert solid_moments(parent.vertices, parent.faces).second == pytest.approx(np.eye(3) / 5, abs=1e-9)


def test_a_grain_has_the_form_of_its_voxels() -> None:
    inside = sum(
        ((np.indices((30, 40, 50))[i] - c) / r) ** 2
        for i, (c, r) in enumerate(((15, 12), (20, 15), (25, 20)))
    )
    parent = ParentSurface.from_grain(
        Grain(inside < 1, VoxelSize(2, 2, 2, "um"), (0.0, 0.0, 0.0)), "ellipsoid"
    )
    assert parent.semi_axes * parent.diameter == pytest.approx([40.0, 30.0, 24.0], rel=0.01)
    assert parent.unit == "um"


def test_many_triangles_are_simplified() -> None:
    fine = trimesh.creation.icosphere(subdivisions=6)
    fine.vertices *= [2.0, 1.5, 1.0]
    fine.units = "mm"
    assert len(fine.faces) > MOST_FACES
    parent = ParentSurface.from_mesh(fine, "fine")
    assert len(parent.faces) <= MOST_FACES
    assert parent.semi_axes * parent.diameter == pytest.approx([2.0, 1.5, 1.0], rel=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: trimesh.Trimesh(make_stone(0).vertices, make_stone(0).faces[:-3]), "cannot be a parent"),
        (lambda: make_stone(0) + make_stone(1).apply_translation([9, 0, 0]), "cannot be a parent|pieces"),
        (lambda: trimesh.creation.box((100, 100, 1)), "20 times as long as thick"),
    ],
    ids=["open", "two bodies", "flat"],
)  # fmt: skip
def test_what_is_no_body_is_refused(make, words) -> None:
    with pytest.raises(CloningError, match=words):
        ParentSurface.from_mesh(make(), "the mesh", "mm")


def test_a_mesh_without_a_unit_is_asked_for_one() -> None:
    with pytest.raises(CloningError, match="carries no length unit"):
        ParentSurface.from_mesh(trimesh.creation.icosphere(), "ball")
