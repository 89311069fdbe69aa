"""Mass properties against closed formulas and a fine quadrature."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import MeasureError, MeshError
from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import mass_properties
from mbstudio.core.units import VoxelSize
from tests.core.metrics.solids import turned


def test_a_box_by_hand():
    a, b, c = 1.0, 2.0, 4.0
    box = trimesh.creation.box((a, b, c))
    box.units = "mm"
    found = mass_properties(turned(box, 4), 2650)
    mass = 2650e-9 * a * b * c
    assert found.mass == pytest.approx(mass)
    assert found.principal == pytest.approx(mass / 12 * np.array([a**2 + b**2, a**2 + c**2, b**2 + c**2]))
    assert found.unit == "mm"
    in_metres = found.to("m")
    assert in_metres.principal == pytest.approx(found.principal * 1e-6)
    assert in_metres.volume == pytest.approx(found.volume * 1e-9)
    assert in_metres.mass == found.mass


def test_pose_and_tensor_agree():
    box = trimesh.creation.box((1, 2, 4))
    rotation, shift = Rotation.from_rotvec([0.4, 0.9, -0.3]), np.array([7.0, -3.0, 2.0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), shift
    box.apply_transform(pose)
    found = mass_properties(box, 1000, unit="m")
    assert found.com == pytest.approx(shift)
    assert np.linalg.det(found.rotation) == pytest.approx(1)
    assert found.rotation @ np.diag(found.principal) @ found.rotation.T == pytest.approx(found.inertia)
    w, *xyz = found.quaternion
    assert Rotation.from_quat([*xyz, w]).as_matrix() == pytest.approx(found.rotation)
    # The box's own frame must come out: lengths 4, 2, 1 along the axes of rising moment.
    local = (np.asarray(box.vertices) - found.com) @ found.rotation
    assert np.ptp(local, axis=0) == pytest.approx([4, 2, 1])


def line_quadrature(avatar: Avatar, steps: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Return volume, centre and second moments about it, by lines along x whose ends are solved for."""
    low, high = avatar.bounds()
    y, z = (low[i] + (np.arange(steps) + 0.5) * (high[i] - low[i]) / steps for i in (1, 2))
    lines = np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1).reshape(-1, 2)
    x = np.linspace(low[0], high[0], 65)
    inside = np.stack(
        [avatar.contains(np.column_stack([np.full(len(lines), at), lines])) for at in x], axis=1
    )
    line, cell = np.nonzero(inside[:, 1:] != inside[:, :-1])
    left, right, rises = x[cell], x[cell + 1], inside[line, cell + 1]
    for _ in range(40):
        middle = (left + right) / 2
        beyond = avatar.contains(np.column_stack([middle, lines[line]])) == rises
        left, right = np.where(beyond, left, middle), np.where(beyond, middle, right)
    # Antiderivatives of 1, x and x**2, taken away where the line enters, added where it leaves.
    sign = np.where(rises, -1.0, 1.0) * np.prod([(high[i] - low[i]) / steps for i in (1, 2)])
    ones, first, second = sign * right, sign * right**2 / 2, sign * right**3 / 3
    v, w = lines[line].T
    volume = ones.sum()
    com = np.array([first.sum(), (ones * v).sum(), (ones * w).sum()]) / volume
    xy, xz, yz = (first * v).sum(), (first * w).sum(), (ones * v * w).sum()
    moments = np.array([[second.sum(), xy, xz], [xy, (ones * v**2).sum(), yz], [xz, yz, (ones * w**2).sum()]])
    return volume, com, moments - volume * np.outer(com, com)


def test_an_avatar_against_a_fine_quadrature():
    avatar = Avatar([[-0.6, 0, 0], [0.5, 0.3, 0.1], [0.2, -0.5, 0.4]], [0.5, 0.4, 0.3], "mm")
    found = mass_properties(avatar, 1e9)
    volume, com, second = line_quadrature(avatar, 260)
    inertia = np.trace(second) * np.eye(3) - second
    assert found.volume == pytest.approx(volume, rel=1e-4)
    assert found.com == pytest.approx(com, abs=1e-4)
    assert found.principal == pytest.approx(np.linalg.eigvalsh(inertia), rel=1e-4)


def test_one_control_point_is_a_sphere():
    found = mass_properties(Avatar([[1, 2, 3]], [0.25], "cm"), 1000)
    mass = 1000 * 4 / 3 * np.pi * 0.005**3
    assert found.mass == pytest.approx(mass, rel=1e-5)
    assert found.principal == pytest.approx([0.4 * mass * 0.5**2] * 3, rel=1e-4)
    assert found.com == pytest.approx([1, 2, 3], abs=1e-6)


@pytest.mark.parametrize("density", [0, -1, np.nan, np.inf])
def test_an_impossible_density_is_refused(density):
    with pytest.raises(MeasureError, match="density"):
        mass_properties(Avatar([[0, 0, 0]], [1.0], "mm"), density)


def test_a_mesh_without_unit_or_without_inside_is_refused():
    with pytest.raises(MeasureError, match="unit"):
        mass_properties(trimesh.creation.box(), 2650)
    opened = trimesh.creation.box()
    opened = trimesh.Trimesh(opened.vertices, opened.faces[1:], process=False)
    with pytest.raises(MeshError, match="not closed"):
        mass_properties(opened, 2650, unit="m")


def test_a_grain_of_long_voxels_by_hand():
    mask = np.zeros((3, 4, 5), dtype=bool)
    mask[0, 0, 0] = mask[2, 3, 4] = mask[0, 3, 0] = True
    size = VoxelSize(3.0, 2.0, 1.0, "mm")
    found = mass_properties(Grain(mask, size, (10.0, 20.0, 30.0)), 1e9)
    points = np.array([[10, 20, 30], [14, 26, 36], [10, 26, 30]], dtype=float)
    centred = points - points.mean(axis=0)
    second = 6.0 * centred.T @ centred
    assert found.volume == 18
    assert found.com == pytest.approx(points.mean(axis=0))
    assert found.inertia == pytest.approx(np.trace(second) * np.eye(3) - second)
    assert found.unit == "mm"


def test_the_voxels_of_a_box_have_its_moments():
    edges = np.array([24.3, 17.8, 11.1])
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(6):
        turn, shift = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3)
        z, y, x = np.mgrid[-18:19, -18:19, -18:19]
        mask = (np.abs((np.stack([x, y, z], axis=-1) - shift) @ turn) <= edges / 2).all(axis=-1)
        found = mass_properties(Grain(mask, VoxelSize(1, 1, 1, "mm")), 1e9)
        known = np.sort((edges**2).sum() - edges**2) / 12
        errors.append(found.principal / found.volume / known - 1)
    # Cubes instead of points would add 0.4 to 0.5 %.
    assert np.mean(errors, axis=0) == pytest.approx(np.zeros(3), abs=3e-3)
