"""Pieces, voids, handles: bodies whose topology is known."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.metaball.topology import genus_of_voxels, topology
from mbstudio.core.metaball.validity import check
from mbstudio.core.units import VoxelSize


def on_a_shell(n: int = 200) -> np.ndarray:
    """Points spread evenly over the unit sphere (Fibonacci)."""
    i = np.arange(n) + 0.5
    polar, turn = np.arccos(1 - 2 * i / n), np.pi * (1 + 5**0.5) * i
    return np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)


def on_a_ring(n: int = 30) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def ball(radius: int = 12) -> Grain:
    z, y, x = np.ogrid[-radius : radius + 1, -radius : radius + 1, -radius : radius + 1]
    return Grain(x * x + y * y + z * z <= radius**2, VoxelSize(1, 1, 1, "mm"))


@pytest.mark.parametrize(
    ("distance", "pieces"),
    # Two equal spheres of radius 1 join where f = 2 / (d/2)**2 reaches 1 half way: d = sqrt(8) = 2.828.
    [(1.0, 1), (2.8, 1), (2.82, 1), (2.828, 1), (2.829, 2), (2.9, 2), (5.0, 2)],
)
def test_two_spheres_join_at_the_right_distance(distance: float, pieces: int) -> None:
    avatar = Avatar([[0, 0, 0], [distance, 0.0, 0]], [1.0, 1.0], "mm")
    found = topology(avatar.control)
    assert (found.pieces, found.voids, found.genus) == (pieces, 0, 0)
    verdict = check(avatar)
    assert verdict.valid == (pieces == 1)
    assert bool(verdict.reasons) == (pieces > 1)


def test_pieces_of_points_are_told_apart_largest_first() -> None:
    found = topology(
        Avatar([[0, 0, 0], [0, 10, 0], [10, 0, 0], [10.5, 0, 0]], [1, 0.2, 2, 2.0], "mm").control
    )
    assert found.pieces == 3
    assert found.piece_of_point.tolist() == [1, 2, 0, 0]
    assert (np.diff(found.volumes) < 0).all()
    # A sphere alone has V = 4/3 pi k**1.5; its neighbours at 10 add a little.
    assert found.volumes[1] == pytest.approx(4 / 3 * np.pi, rel=0.2)


def test_an_island_smaller_than_a_grid_cell_is_found() -> None:
    avatar = Avatar([[0, 0, 0], [1.4, 0, 0]], [1.0, 1e-6], "mm")
    assert topology(avatar.control).pieces == 2


def test_points_on_a_shell_enclose_a_void() -> None:
    verdict = check(Avatar(on_a_shell(), np.full(200, 0.0045), "mm"))
    assert (verdict.pieces, verdict.voids, verdict.valid) == (1, 1, False)
    assert "cavity" in verdict.reasons[0]
    assert "n is too small" in verdict.reasons[0]


def test_points_on_a_shell_with_more_weight_are_solid() -> None:
    # In the centre f = 200 k: above 1 from k = 0.005 on.
    verdict = check(Avatar(on_a_shell(), np.full(200, 0.0055), "mm"))
    assert (verdict.pieces, verdict.voids, verdict.genus, verdict.valid) == (1, 0, 0, True)


def test_points_on_a_ring_make_one_handle() -> None:
    verdict = check(Avatar(on_a_ring(), np.full(30, 0.015), "mm"))
    assert (verdict.pieces, verdict.voids, verdict.genus) == (1, 0, 1)


def test_two_rings_make_two_handles() -> None:
    centers = np.vstack([on_a_ring(), on_a_ring() + np.array([2.0, 0, 0])])
    found = topology(Avatar(centers, np.full(60, 0.006), "mm").control)
    assert (found.pieces, found.genus) == (1, 2)


def test_verdict_compares_with_the_grain() -> None:
    grain = ball()
    radius = (3 * grain.volume / (4 * np.pi)) ** (1 / 3)
    true = Avatar([[12, 12, 12]], [radius**2], "mm")
    verdict = check(true, grain)
    assert verdict.valid
    assert verdict.volume_error == pytest.approx(0, abs=2e-4)
    larger = check(true.scaled(1.0).transformed(translation=np.zeros(3)).scaled(1), grain)
    assert larger.volume_error == pytest.approx(verdict.volume_error)
    grown = check(Avatar([[12, 12, 12]], [(1.05 * radius) ** 2], "mm"), grain)
    assert grown.volume_error == pytest.approx(1.05**3 - 1, abs=1e-3)
    assert not grown.valid
    assert "+15.8 %" in grown.reasons[0]


def test_control_points_outside_the_grain_are_counted() -> None:
    verdict = check(Avatar([[12, 12, 12], [30, 12, 12], [12, 12, -3]], [140.0, 0.1, 0.1], "mm"), ball())
    assert verdict.points_outside == 2
    assert not verdict.valid


def test_verdict_in_another_unit_is_the_same() -> None:
    grain, avatar = ball(), Avatar([[12, 12, 12], [14, 12, 12]], [70.0, 70.0], "mm")
    here, there = check(avatar, grain), check(avatar.to("um"), grain)
    assert there.volume_error == pytest.approx(here.volume_error, abs=1e-5)
    assert there.points_outside == here.points_outside == 0


def test_handles_of_voxels_are_those_of_scikit_image() -> None:
    import cc3d
    import fill_voids
    from scipy.ndimage import gaussian_filter
    from skimage.measure import euler_number

    found = set()
    for seed in range(8):
        noise = gaussian_filter(np.random.default_rng(seed).random((24, 24, 24)), 1.5)
        body = cc3d.largest_k(np.pad(noise > np.quantile(noise, 0.6), 1), 1, connectivity=26) > 0
        body = fill_voids.fill(body) > 0
        found.add(genus_of_voxels(body))
        assert genus_of_voxels(body) == 1 - euler_number(body, 3)
    assert max(found) > 1  # else it would prove little
