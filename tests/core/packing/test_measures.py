"""Measures of packings whose porosity, contacts and fabric are known by geometry."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.errors import PackingError
from mbstudio.core.fabric import anisotropy, fabric_tensor, rose
from mbstudio.core.packing.contacts import FLOOR, find_contacts
from mbstudio.core.packing.grain_kinds import GrainKinds
from mbstudio.core.packing.mould import Mould, width_for
from mbstudio.core.packing.packing import Packing
from mbstudio.core.packing.poses import Poses


def upright(positions: np.ndarray) -> Poses:
    count = len(positions)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    return Poses(np.zeros(count, dtype=int), np.ones(count), positions, turns)


def cubic(side: int, pitch: float = 1.0) -> np.ndarray:
    axis = (np.arange(side) + 0.5) * pitch
    x, y, z = np.meshgrid(axis - side * pitch / 2, axis - side * pitch / 2, axis, indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def cubic_packing(balls: GrainKinds, side: int = 6, pitch: float = 0.9999) -> Packing:
    return Packing(balls, upright(cubic(side, pitch)), Mould("box", side * pitch / 2))


def test_simple_cubic_spheres(balls):
    """Porosity 1 - pi / 6, six neighbours each, normals along the axes and alike."""
    made = cubic_packing(balls)
    found = made.measures()
    assert made.solids.porosity(made.solids.wall_distances > 1, 1, 5) == pytest.approx(
        1 - np.pi / 6, abs=0.01
    )
    assert found.core.high == pytest.approx(5, abs=0.6)
    assert found.coordination == pytest.approx(6.0)
    assert found.fabric == pytest.approx(np.eye(3) / 3, abs=0.05)
    assert found.counted_twice == 0


def test_periodic_cubic_spheres_are_solid_to_the_sides(balls):
    made = Packing(balls, upright(cubic(4, 0.9999)), Mould("box", 2 * 0.9999, periodic=True))
    contacts = made.found_contacts
    neighbours = contacts.neighbours(len(made))
    inner = (made.poses.positions[:, 2] > 1) & (made.poses.positions[:, 2] < 3)
    assert (neighbours[inner] == 6).all()
    everywhere = np.ones_like(made.solids.wall_distances, dtype=bool)
    assert made.solids.porosity(everywhere, 0, 4 * 0.9999) == pytest.approx(1 - np.pi / 6, abs=0.01)


def test_spheres_that_do_not_touch_have_no_contacts(balls):
    apart = cubic_packing(balls, pitch=1.01)
    assert len(apart.contacts) == 0
    assert apart.overlap == 0
    near = find_contacts(apart.kinds, apart.poses, apart.mould, gap=0.02)
    assert len(near.pairs[near.among_grains]) == 3 * 6 * 6 * 5


def test_a_contact_has_point_normal_and_overlap(balls):
    poses = upright(np.array([[0.0, 0.0, 0.49], [0.0, 0.0, 1.46]]))
    contacts = find_contacts(balls, poses, Mould("box", 3.0))
    table = Packing(balls, poses, Mould("box", 3.0)).contacts
    assert contacts.pairs.tolist() == [[0, 1], [0, FLOOR]]
    assert contacts.normals == pytest.approx(np.array([[0, 0, 1.0], [0, 0, -1.0]]))
    assert contacts.overlaps == pytest.approx([0.03, 0.01])
    assert contacts.points[0] == pytest.approx([0, 0, 0.975])
    assert table[["grain", "other"]].to_numpy().tolist() == [[0, 1], [0, -1]]


def test_a_cylinder_has_walls_all_around(balls):
    mould = Mould("cylinder", 2.0)
    around = np.array([[1.52 * np.cos(a), 1.52 * np.sin(a), 3.0] for a in np.linspace(0, 6.28, 9)])
    contacts = find_contacts(balls, upright(around), mould)
    assert (np.unique(contacts.pairs[~contacts.among_grains][:, 0]) == np.arange(9)).all()
    assert mould.holds(around).all()
    assert not mould.holds(np.array([[2.1, 0, 1.0]])).any()


def test_avatars_are_counted_and_not_their_clumps(kinds):
    """One grain in a large box: the points that it holds are its volume."""
    poses = Poses(
        np.array([1]), np.array([1.5]), np.array([[0.1, -0.2, 2.5]]), np.array([[0.5, 0.5, 0.5, 0.5]])
    )
    grid = Packing(kinds, poses, Mould("box", 3.0)).solids
    volume = grid.counts.sum() * grid.spacing**3
    assert volume == pytest.approx(kinds.volumes[1] * 1.5**3, rel=0.01)


def test_the_surface_of_a_packing_is_that_of_its_avatars(kinds):
    poses = Poses(np.array([0, 2]), np.ones(2), np.array([[0, 0, 2.0], [3, 0, 2]]), np.eye(4)[[0, 2]])
    made = Packing(kinds, poses, Mould("box", 5.0))
    mesh = made.mesh(cells=48)
    assert mesh.volume == pytest.approx(kinds.volumes[[0, 2]].sum(), rel=0.01)
    assert set(np.unique(mesh.face_attributes["grain"])) == {0, 1}
    placed = made.avatar(1)
    first = trimesh.Trimesh(mesh.vertices, mesh.faces[mesh.face_attributes["grain"] == 1])
    assert placed.contains(first.triangles_center * 0.9 + 0.1 * made.poses.positions[1]).mean() > 0.9


def test_fabric_of_known_normals():
    up = np.tile([0, 0, 1.0], (10, 1))
    assert anisotropy(fabric_tensor(up)) == pytest.approx(7.5)
    assert anisotropy(fabric_tensor(np.eye(3))) == pytest.approx(0.0)
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(200_000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    assert rose(normals) == pytest.approx(np.ones(18), abs=0.1)


def test_a_packing_without_an_inside_is_not_measured(balls):
    with pytest.raises(PackingError, match="no inner part"):
        cubic_packing(balls, side=2).porosity


def test_profiles_by_height_and_wall(balls):
    """Layers of cubic spheres: dense at the heights of their centres, open between them."""
    made = cubic_packing(balls)
    profile = made.profile()
    dense = np.interp(2.5, profile["height"], profile["porosity"])
    open_ = np.interp(3.0, profile["height"], profile["porosity"])
    assert dense == pytest.approx(1 - np.pi / 4, abs=0.03)
    assert open_ > 0.9
    walls = made.wall_profile()
    assert walls["porosity"].iloc[0] > 0.7 > walls["porosity"].iloc[4]


def test_the_width_gives_the_height():
    solid = 200 * np.pi / 6
    assert 2 * width_for(solid, "box") == pytest.approx((solid / 0.58) ** (1 / 3))
