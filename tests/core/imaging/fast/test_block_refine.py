"""The search that moves control points in blocks of neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit
from mbstudio.core.imaging.depths import depths_of
from mbstudio.core.imaging.fast import block_relocation
from mbstudio.core.imaging.fast.block_refine import BLOCK, BlockRefinement, Part, Sums, blocks, field_at
from mbstudio.core.imaging.fast.block_relocation import relocate_in_blocks
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings
from mbstudio.core.imaging.preprocess import PreparedGrain, prepare
from mbstudio.core.imaging.run import cluster_spheres
from mbstudio.core.imaging.start.control_points import control_of_spheres
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import cut_box, grain_where

N = 100


@pytest.fixture(scope="module")
def grain() -> Grain:
    return grain_where(lambda x, y, z: cut_box(x / 1.6, y / 1.6, z / 1.6), 33, VoxelSize(1, 1, 1, "um"))


@pytest.fixture(scope="module")
def prepared(grain: Grain) -> PreparedGrain:
    return prepare(grain)


def begin(kind: type[Refinement], prepared: PreparedGrain, **settings: float) -> Refinement:
    control = control_of_spheres(prepared, cluster_spheres(prepared, N))
    search = kind(prepared, control, RefineSettings(**settings))
    search.settle()
    return search


def prepared_depths(prepared: PreparedGrain, control: np.ndarray) -> np.ndarray:
    return depths_of(prepared, control[:3])[0]


@pytest.mark.parametrize("count", [1, 7, 40, 41, 333])
def test_blocks_are_neighbours_and_hold_every_point_once(count: int) -> None:
    places = np.random.default_rng(count).normal(size=(3, count))
    found = list(blocks(places, 40, np.random.default_rng(0)))
    assert sorted(np.concatenate(found).tolist()) == list(range(count))
    assert all(1 <= len(block) <= 40 for block in found)
    if len(found) > 4:
        spreads = [places[:, block].std(axis=1).mean() for block in found]
        assert np.mean(spreads) < 0.75 * places.std(axis=1).mean()
    again = list(blocks(places, 40, np.random.default_rng(1)))
    assert count <= 40 or any(len(a) != len(b) or (a != b).any() for a, b in zip(found, again, strict=False))


@pytest.mark.parametrize("area_weight", [0.0, 1.0])
def test_the_gradient_of_a_block_is_that_of_its_rows(prepared: PreparedGrain, area_weight: float) -> None:
    search = begin(BlockRefinement, prepared, area_weight=area_weight)
    for _ in range(3):
        search.advance()
    if area_weight:
        search._wanted_area = prepared.area
        search._renew_surface()
        assert search.solid.area_weight
        assert search.solid.bend.any()
    search._measure_scale(search.control.astype(np.float32))
    (block, *_) = blocks(search.control[:3], BLOCK, np.random.default_rng(0))
    part = Part(search, block, Sums(search), offset=1)
    at = part.rows(part.begun)
    _, gradient = part.normal_equations(at)
    rng, n = np.random.default_rng(4), len(block)
    for _ in range(5):
        step = rng.normal(size=4 * n)
        step *= 3e-3 / np.linalg.norm(step)

        def cost(times: float, step: np.ndarray = step) -> float:
            moved = part.begun.copy()
            moved[3] *= np.exp(times * step[:n])
            moved[:3] += times * step[n:].reshape(3, n)
            return part.cost(part.rows(moved))

        # Rows are in single precision: large enough a difference to stand out.
        slope = (cost(1.0) - cost(-1.0)) / 2
        assert slope == pytest.approx(
            float(gradient @ step), rel=0.05, abs=2e-3 * np.linalg.norm(gradient) * 3e-3
        )


def test_sums_follow_the_blocks(prepared: PreparedGrain) -> None:
    search = begin(BlockRefinement, prepared)
    search._measure_scale(search.control.astype(np.float32))
    sums = Sums(search)
    before = search.control.copy()
    for block in blocks(search.control[:3], BLOCK, np.random.default_rng(0)):
        search._move(block, sums)
    assert (search.control != before).any(axis=0).sum() > 0.9 * N
    single = search.control.astype(np.float32)
    np.testing.assert_allclose(sums.field, field_at(search.surface.points, single), rtol=2e-4)
    np.testing.assert_allclose(sums.residual, search._scale * (1 - sums.field**-0.5), rtol=1e-5, atol=1e-6)


def test_blocks_come_as_near_as_all_control_points_at_once(prepared: PreparedGrain) -> None:
    together, apart = begin(Refinement, prepared), begin(BlockRefinement, prepared)
    start = together.rms()
    for _ in range(15):
        together.advance()
    for _ in range(40):
        apart.advance()
    assert apart.rms() < 0.4 * start
    assert apart.rms() < 1.15 * together.rms()
    depth = apart.depth_of(apart.control[:3])
    assert depth.min() > 0.9 * apart.hard_depth


def test_the_guard_damps_all_blocks(prepared: PreparedGrain) -> None:
    search = begin(BlockRefinement, prepared)
    for _ in range(5):
        search.advance()
    assert search._dampings.max() < 1
    before = search.control.copy()
    search.damping = 1e7
    search.advance()
    assert np.abs(search.control[:3] - before[:3]).max() < 1e-4


def test_a_fit_of_many_control_points_is_valid_true_and_repeatable(grain: Grain) -> None:
    found = fit(grain, 160, seed=3)
    assert found.verdict.valid
    assert abs(found.verdict.volume_error) < 0.005
    again = fit(grain, 160, seed=3)
    np.testing.assert_array_equal(found.avatar.centers, again.avatar.centers)
    np.testing.assert_array_equal(found.avatar.weights, again.avatar.weights)
    at_once = fit(grain, 160, seed=3, blocks_from=161)
    assert (found.avatar.centers != at_once.avatar.centers).any()
    assert found.verdict.rms < 1.15 * at_once.verdict.rms


def test_useless_control_points_move_to_where_they_help(prepared: PreparedGrain) -> None:
    search = begin(BlockRefinement, prepared)
    for _ in range(10):
        search.advance()
    # Ten control points of no weight, heaped up in the middle.
    idle = search.control.copy()
    middle = idle[:3, prepared_depths(prepared, idle).argmax()]
    idle[:3, :10] = middle[:, None] + np.random.default_rng(0).normal(0, 0.01, (3, 10))
    idle[3, :10] = 1e-5
    search.set_control(idle)
    before = search.rms()
    moved = relocate_in_blocks(search, 10, np.random.default_rng(1))
    assert 8 <= moved <= 10
    gone = ~np.isin(idle[0], search.control[0])
    assert gone[:10].sum() >= 8, "those that do nothing go first"
    assert search.depth_of(search.control[:3][:, gone]).min() > 0.8 * search.hard_depth
    for _ in range(4):
        search.advance()
    assert search.rms() < 0.95 * before


def test_nothing_moves_where_nothing_is_gained(prepared: PreparedGrain, monkeypatch) -> None:
    search = begin(BlockRefinement, prepared)
    for _ in range(5):
        search.advance()
    monkeypatch.setattr(block_relocation, "_losses", lambda matrix: np.full(len(matrix) // 4, 1e9))
    before = search.control.copy()
    assert relocate_in_blocks(search, 10, np.random.default_rng(1)) == 0
    np.testing.assert_array_equal(search.control, before)


def test_losses_of_a_block_are_those_of_the_quadratic_form() -> None:
    rows = np.random.default_rng(2).normal(size=(40, 12))
    matrix = rows.T @ rows
    found = block_relocation._losses(matrix)
    for i in range(3):
        # The least of p M p with p_i = -1, the others free.
        others = [a for a in range(12) if a != i]
        free = np.linalg.solve(matrix[np.ix_(others, others)], matrix[others, i])
        least = matrix[i, i] - matrix[i, others] @ free
        assert found[i] == pytest.approx(least, rel=1e-3)
