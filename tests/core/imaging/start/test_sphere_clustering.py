"""Sphere clustering: by hand on small masks, and the incremental way against the letter."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.imaging.start.sphere_clustering import cluster_incrementally, cluster_to_the_letter

UNIT = np.ones(3)


def test_the_largest_sphere_comes_first_and_its_voxels_are_taken() -> None:
    mask = np.zeros((9, 9, 9), dtype=bool)
    mask[1:8, 1:8, 1:8] = True  # a cube of 7 voxels: the centre is 4 from the nearest outside voxel
    first, second = cluster_to_the_letter(mask, UNIT, 2)
    assert first.voxel == (4, 4, 4)
    assert first.radius == 4
    distance = np.linalg.norm(np.array(second.voxel) - 4)
    assert distance >= 4  # not a voxel of the first sphere
    assert second.radius == 1  # what is left in the corners is one voxel from the outside


def test_two_cubes_get_a_sphere_each_larger_first() -> None:
    mask = np.zeros((11, 11, 24), dtype=bool)
    mask[1:10, 1:10, 1:10] = True  # 9 wide
    mask[3:8, 3:8, 15:20] = True  # 5 wide
    first, *others = cluster_to_the_letter(mask, UNIT, 30)
    assert (first.voxel, first.radius) == ((5, 5, 5), 5)
    assert max(others, key=lambda sphere: sphere.radius).radius == 3
    assert (5, 5, 17) in [sphere.voxel for sphere in others]


def test_anisotropic_voxels_count_in_lengths() -> None:
    mask = np.zeros((9, 9, 9), dtype=bool)
    mask[1:8, 1:8, 1:8] = True
    (first,) = cluster_to_the_letter(mask, np.array([1.0, 1.0, 3.0]), 1)  # x, y, z: long in z
    assert first.radius == 4
    (flat,) = cluster_to_the_letter(mask, np.array([1.0, 1.0, 0.25]), 1)
    assert flat.radius == 1  # four layers of a quarter


def test_clustering_ends_when_every_voxel_is_taken() -> None:
    mask = np.zeros((5, 5, 5), dtype=bool)
    mask[2, 2, 1:4] = True
    spheres = list(cluster_to_the_letter(mask, UNIT, 100))
    assert sorted(sphere.voxel for sphere in spheres) == [(2, 2, 1), (2, 2, 2), (2, 2, 3)]
    again = list(cluster_incrementally(mask.astype(np.float32), UNIT, 100, 1.0))
    assert sorted(sphere.voxel for sphere in again) == [(2, 2, 1), (2, 2, 2), (2, 2, 3)]


def test_incremental_agrees_with_the_letter(ellipsoid_grain: Grain, angular_grain: Grain) -> None:
    for grain in (ellipsoid_grain, angular_grain):
        prepared = prepare(grain)
        transform = prepared.distance + np.float32(0.5 * prepared.voxel)
        letter = list(cluster_to_the_letter(prepared.mask, prepared.spacing, 40))
        fast = list(cluster_incrementally(transform, prepared.spacing, 40, prepared.voxel))
        assert fast[0].voxel == letter[0].voxel
        assert fast[0].radius == pytest.approx(letter[0].radius, rel=1e-5)
        difference = np.abs([a.radius - b.radius for a, b in zip(letter, fast, strict=True)])
        assert difference.max() <= 1.8 * prepared.voxel
        for spheres in (letter, fast):
            radii = [sphere.radius for sphere in spheres]
            assert radii == sorted(radii, reverse=True)


def test_incremental_spheres_do_not_overlap_and_stay_inside(ellipsoid_grain: Grain) -> None:
    prepared = prepare(ellipsoid_grain)
    transform = prepared.distance + np.float32(0.5 * prepared.voxel)
    spheres = list(cluster_incrementally(transform, prepared.spacing, 40, prepared.voxel))
    centers = np.array([sphere.voxel for sphere in spheres])[:, ::-1] * prepared.spacing
    radii = np.array([sphere.radius for sphere in spheres])
    gap = np.linalg.norm(centers[:, None] - centers[None], axis=2) - radii[:, None] - radii[None]
    assert gap[~np.eye(40, dtype=bool)].min() > -1e-4
    depth = transform[tuple(np.array([sphere.voxel for sphere in spheres]).T)]
    assert (radii <= depth + 1e-5).all()


def by_brute_force(mask: np.ndarray, spacing: np.ndarray, n: int, closed: bool) -> list[tuple]:
    """Algorithm 1 with every distance computed: Transform, Search, Reset."""
    place = np.stack(np.meshgrid(*(np.arange(side) for side in mask.shape), indexing="ij"), axis=-1)
    place = place * spacing[::-1]
    left, spheres = mask.copy(), []
    for _ in range(n):
        taken = place[~left]
        distance = np.zeros(mask.shape)
        for index in np.argwhere(left):
            distance[tuple(index)] = np.sqrt(((taken - place[tuple(index)]) ** 2).sum(axis=1)).min()
        distance = distance.round(9)
        center = tuple(int(i) for i in np.unravel_index(distance.argmax(), mask.shape))
        radius = distance[center]
        apart = np.sqrt(((place - place[center]) ** 2).sum(axis=-1)).round(9)
        left &= ~((apart <= radius) if closed else (apart < radius))
        spheres.append((center, radius))
    return spheres


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.9, 1.0, 1.7)])
def test_spheres_of_algorithm_1_by_brute_force(spacing: tuple[float, ...], closed: bool) -> None:
    z, y, x = np.indices((13, 12, 16))
    mask = ((x - 5) ** 2 + (y - 5) ** 2 + (z - 6) ** 2 <= 19) | ((x - 10) ** 2 + (y - 6) ** 2 <= 9)
    mask[[0, -1]] = mask[:, [0, -1]] = mask[:, :, [0, -1]] = False
    edges = np.array(spacing)
    expected = by_brute_force(mask, edges, 5, closed)
    found = list(cluster_to_the_letter(mask, edges, 5, closed=closed))
    assert [sphere.voxel for sphere in found] == [center for center, _ in expected]
    np.testing.assert_allclose([sphere.radius for sphere in found], [r for _, r in expected], rtol=1e-6)
    # Going on from the first spheres gives the others.
    assert list(cluster_to_the_letter(mask, edges, 5, found=found[:2], closed=closed)) == found[2:]


def test_open_and_closed_spheres_by_hand() -> None:
    mask = np.zeros((3, 3, 11), dtype=bool)
    mask[1, 1, 1:10] = True  # a row of 9: every voxel is 1 from the outside, the first one is taken
    spheres = [list(cluster_to_the_letter(mask, UNIT, 9, closed=closed)) for closed in (False, True)]
    assert [sphere.voxel[2] for sphere in spheres[0]] == [1, 2, 3, 4, 5, 6, 7, 8, 9]
    # Closed, each takes its neighbours at distance 1 along.
    assert [sphere.voxel[2] for sphere in spheres[1]] == [1, 3, 5, 7, 9]
