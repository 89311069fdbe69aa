"""The minimum-volume box."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.axes import box_along, convex_hull, minimum_bounding_box


def test_a_regular_tetrahedron_fits_a_cube():
    """Its smallest box is the cube of the face diagonals (O'Rourke 1985), not a box on a face."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    box = minimum_bounding_box(convex_hull(corners @ Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix().T))
    assert box.lengths == pytest.approx([2, 2, 2], rel=2e-3)
    assert np.linalg.det(box.directions) == pytest.approx(1)


def test_no_rotation_of_many_gives_a_smaller_box():
    points = np.random.default_rng(3).normal(size=(60, 3)) * [1, 1.4, 2]
    box = minimum_bounding_box(convex_hull(points))
    frames = Rotation.random(30000, rng=np.random.default_rng(4)).as_matrix()
    brute = np.ptp(frames @ points.T, axis=2).prod(axis=1).min()
    assert box.lengths.prod() <= brute * (1 + 1e-4)
    assert np.ptp(box.directions @ points.T, axis=1) == pytest.approx(box.lengths)


def test_flat_points_have_no_box():
    with pytest.raises(MeasureError, match="flat"):
        convex_hull(np.random.default_rng(0).normal(size=(20, 3)) * [1, 1, 0])


def test_an_exhaustive_search_finds_no_smaller_box():
    """A smallest box has two neighbouring faces that each hold an edge of the hull (O'Rourke 1985)."""
    rng = np.random.default_rng(5)
    for _ in range(3):
        hull = convex_hull(rng.normal(size=(12, 3)) * [1, 1.2, 1.5])
        pairs = {tuple(sorted(pair)) for face in hull.simplices for pair in combinations(face, 2)}
        edges = np.array([hull.points[b] - hull.points[a] for a, b in sorted(pairs)])
        turn = np.linspace(0, np.pi, 361)[:-1]
        least = np.inf
        for edge in edges:
            across = np.linalg.svd(edge[None])[2][1:]
            normals = np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1]
            for other in edges:
                second = np.cross(normals, other)
                size = np.linalg.norm(second, axis=1)
                fit = size > 1e-9
                one, two = normals[fit], second[fit] / size[fit, None]
                frames = np.stack([one, two, np.cross(one, two)], axis=1)
                least = min(least, np.ptp(frames @ hull.points.T, axis=2).prod(axis=1).min())
        assert minimum_bounding_box(hull).lengths.prod() <= least * (1 + 1e-4)


@pytest.mark.parametrize("name", ["I-anm-00006", "K-anm-00005", "N-anm-00001"])
def test_a_long_search_finds_no_smaller_box_of_grains_that_have_two_of_nearly_the_same_volume(
    shared_data, name
):
    points = np.asarray(trimesh.load(shared_data / "aggregates" / f"{name}.ply").vertices)
    hull = convex_hull(points)
    corners = points[hull.vertices]

    def volumes(frames):
        return np.ptp(frames @ corners.T, axis=-1).prod(axis=-1)

    frames = Rotation.random(4000, rng=np.random.default_rng(1)).as_matrix()
    frames = frames[np.argsort(volumes(frames))[:150]]
    least, angle = volumes(frames), np.radians(10)
    turns = np.random.default_rng(2).normal(size=(24, 3))
    for _ in range(32):
        steps = Rotation.from_rotvec(np.vstack([turns, -turns]) * angle / 2).as_matrix()
        for i, frame in enumerate(frames):
            trials = steps @ frame
            found = volumes(trials)
            if found.min() < least[i]:
                frames[i], least[i] = trials[found.argmin()], found.min()
        angle *= 0.75
    assert minimum_bounding_box(hull).lengths.prod() <= least.min() * (1 + 2e-4)


def test_a_box_along_given_directions():
    points = np.array([[x, y, z] for x in (0, 3) for y in (0, 1) for z in (0, 2)], dtype=float)
    box = box_along(points, np.eye(3))
    np.testing.assert_allclose(box.lengths, [1, 2, 3])
    np.testing.assert_allclose(np.abs(box.directions), np.eye(3)[[1, 2, 0]])
    assert np.linalg.det(box.directions) == pytest.approx(1)
    # Turned by an angle t about z, a rectangle is a cos t + b sin t wide.
    t = 0.3
    turned = Rotation.from_rotvec([0, 0, t]).as_matrix()
    wanted = [3 * np.sin(t) + np.cos(t), 2, 3 * np.cos(t) + np.sin(t)]
    np.testing.assert_allclose(box_along(points, turned).lengths, wanted)
    with pytest.raises(MeasureError, match="orthogonal unit vectors"):
        box_along(points, np.eye(3) * 1.1)
    with pytest.raises(MeasureError, match=r"\(2, 3\)"):
        box_along(points, np.eye(3)[:2])
