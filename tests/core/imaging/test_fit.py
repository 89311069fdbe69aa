"""Both methods: fidelity on known shapes, the step object, repeatability, bad input."""

from __future__ import annotations

import numpy as np
import pytest

import mbstudio as mb
from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit, start_fit
from mbstudio.core.metaball.topology import topology
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import CENTER, EGG_AXES, ellipsoid, grain_where

EGG = 4 / 3 * np.pi * float(np.prod(EGG_AXES))


@pytest.fixture(scope="module")
def egg(ellipsoid_grain: Grain):
    return fit(ellipsoid_grain, 20)


def test_fast_fit_of_an_ellipsoid(egg, ellipsoid_grain: Grain) -> None:
    mesh = egg.avatar.mesh(96)
    assert mesh.volume == pytest.approx(EGG, rel=0.005)
    # The surface lies within about half a voxel of 1 um everywhere, a fifth on average.
    scaled = (mesh.vertices - CENTER) / EGG_AXES
    off = (np.linalg.norm(scaled, axis=1) - 1) * 15
    assert np.abs(off).max() < 0.6
    assert np.sqrt((off**2).mean()) < 0.2
    verdict = egg.verdict
    assert verdict.valid
    assert (verdict.pieces, verdict.voids, verdict.genus, verdict.points_outside) == (1, 0, 0, 0)
    assert abs(verdict.volume_error) < 0.002
    assert verdict.rms < 0.2


def test_avatar_carries_name_label_and_unit(egg) -> None:
    assert (egg.avatar.name, egg.avatar.label, egg.avatar.unit) == ("egg", 7, "um")
    assert (egg.method, egg.n, egg.avatar.n) == ("fast", 20, 20)


def test_histories_fall_and_match_the_steps(ellipsoid_grain: Grain, egg) -> None:
    steps = []
    again = fit(ellipsoid_grain, 20, on_step=steps.append)
    search = [step for step in steps if step.phase == "search"]
    clustering = [step for step in steps if step.phase == "clustering"]
    assert [step.generation for step in clustering] == list(range(1, 21))
    assert [step.generation for step in search] == list(range(len(search)))
    assert all(step.generation <= step.generations for step in steps)
    assert all(np.isnan(step.loss) for step in clustering)
    assert clustering[4].avatar.n == 5
    np.testing.assert_array_equal(again.history, [step.loss for step in search])
    np.testing.assert_array_equal(again.rms_history, [step.rms for step in search])
    assert again.history[-1] < 0.2 * again.history[0]
    np.testing.assert_array_equal(search[-1].avatar.centers, again.avatar.centers)
    # The avatar of an early step is that step's, though it is built later.
    assert not np.array_equal(search[0].avatar.centers, search[-1].avatar.centers)


def test_same_seed_same_avatar_other_seed_other(ellipsoid_grain: Grain, egg) -> None:
    again, other = fit(ellipsoid_grain, 20), fit(ellipsoid_grain, 20, seed=1)
    np.testing.assert_array_equal(again.avatar.centers, egg.avatar.centers)
    np.testing.assert_array_equal(again.avatar.weights, egg.avatar.weights)
    assert not np.array_equal(other.avatar.weights, egg.avatar.weights)


def test_a_pause_changes_nothing(ellipsoid_grain: Grain, egg) -> None:
    run = start_fit(ellipsoid_grain, 20)
    for _ in range(25):
        next(run)
    halfway = run.result()
    assert len(halfway.history) == 5  # 20 spheres, then generations 0 to 4
    for _ in run:
        pass
    np.testing.assert_array_equal(run.result().avatar.weights, egg.avatar.weights)
    np.testing.assert_array_equal(run.result().history, egg.history)


def test_fast_fit_of_an_angular_body(angular_grain: Grain) -> None:
    result = fit(angular_grain, 80)
    assert result.verdict.valid
    assert abs(result.verdict.volume_error) < 0.01
    assert result.verdict.rms < 0.4  # of a voxel of 1 um, edges included


@pytest.mark.parametrize("n", [40, 10])
def test_going_on_with_another_number_keeps_what_was_reached(ellipsoid_grain: Grain, n: int) -> None:
    run = start_fit(ellipsoid_grain, 20)
    for _ in run:
        pass
    before = run.result()
    run.change_control_points(n)
    step = next(run)
    assert step.avatar.n == n
    fresh = start_fit(ellipsoid_grain, n)
    start = next(s for s in fresh if s.phase == "search")
    assert step.loss < start.loss
    for _ in run:
        pass
    after = run.result()
    assert after.avatar.n == after.n == n
    assert after.verdict.valid
    assert len(after.history) > len(before.history)
    np.testing.assert_array_equal(after.history[: len(before.history)], before.history)


def test_more_generations_go_on(ellipsoid_grain: Grain) -> None:
    run = start_fit(ellipsoid_grain, 20, generations=5)
    for _ in run:
        pass
    assert len(run.result().history) == 6
    loss = run.result().history[-1]
    run.more_generations(4)
    assert [step.generation for step in run] == [6, 7, 8, 9]
    assert run.result().history[-1] < loss


def test_another_number_while_clustering(ellipsoid_grain: Grain, egg) -> None:
    run = start_fit(ellipsoid_grain, 35)
    for _ in range(10):
        next(run)
    run.change_control_points(20)
    for _ in run:
        pass
    np.testing.assert_array_equal(run.result().avatar.weights, egg.avatar.weights)


def test_anisotropic_voxels_give_the_same_shape() -> None:
    shape = ellipsoid(*EGG_AXES)
    even = fit(grain_where(shape, 23, VoxelSize(1, 1, 1, "um")), 20)
    flat = fit(grain_where(shape, 23, VoxelSize(2, 1, 0.8, "um")), 20)
    a, b = even.avatar.mesh(80), flat.avatar.mesh(80)
    assert b.volume == pytest.approx(a.volume, rel=0.01)
    np.testing.assert_allclose(b.extents, a.extents, atol=0.6)
    assert flat.verdict.valid


def test_a_grain_moved_and_in_other_units_gives_the_avatar_moved_and_in_them(
    ellipsoid_grain: Grain, egg
) -> None:
    far = Grain(ellipsoid_grain.mask, VoxelSize(0.5, 0.5, 0.5, "mm"), (100.0, -50.0, 7.0))
    moved = fit(far, 20)
    expected = (egg.avatar.centers - ellipsoid_grain.origin) * 0.5 + far.origin
    np.testing.assert_allclose(moved.avatar.centers, expected, atol=1e-3)
    assert moved.avatar.unit == "mm"


def test_a_ring_keeps_its_hole() -> None:
    ring = grain_where(lambda x, y, z: np.hypot(np.hypot(x, y) - 16, z) <= 6, 23, VoxelSize(1, 1, 1, "um"))
    result = fit(ring, 40)
    assert result.verdict.genus == 1
    assert result.verdict.valid
    assert abs(result.verdict.volume_error) < 0.01


@pytest.mark.parametrize(
    "shape",
    [
        lambda x, y, z: (np.hypot(x, y) <= 18) & (np.abs(z) <= 1.6),
        lambda x, y, z: (np.abs(np.sqrt(x * x + y * y + z * z) - 15) <= 2.2) & (z <= 2),
        lambda x, y, z: (np.abs(x) <= 20) & (np.abs(y) <= 1.2) & (np.abs(z) <= 1.2),
    ],
    ids=["disc", "bowl", "needle"],
)  # fmt: skip
@pytest.mark.parametrize("n", [6, 40])
def test_difficult_shapes_are_sound_or_say_why_not(shape, n: int) -> None:
    result = fit(grain_where(shape, 23, VoxelSize(1, 1, 1, "um")), n)
    found = topology(result.avatar.control, cells=96)
    assert (found.pieces, found.voids) == (1, 0)
    assert result.verdict.valid == (not result.verdict.reasons)
    assert result.verdict.valid or "n is too small" in " ".join(result.verdict.reasons)
    if abs(result.verdict.volume_error) > 0.05:
        assert not result.verdict.valid


def test_advice_that_is_followed_cures() -> None:
    z, y, x = np.indices((7, 53, 53))
    disc = Grain.from_mask(((x - 26) ** 2 + (y - 26) ** 2 <= 25**2) & (abs(z - 3) <= 1), voxel_size="1 um")
    result = fit(disc, n=6)
    assert not result.verdict.valid
    advised = int(result.verdict.reasons[0].split("try ")[1].rstrip("."))
    assert advised > 24
    assert fit(disc, n=advised).verdict.valid


@pytest.mark.parametrize("n", [0, -3, 2.5, True])
def test_n_must_be_a_whole_number_from_one_on(ellipsoid_grain: Grain, n: object) -> None:
    with pytest.raises(FitError, match="n ="):
        start_fit(ellipsoid_grain, n)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["fast", "paper"])
def test_a_ball_that_one_sphere_fills_holds_more_control_points(method) -> None:
    radius = 10
    square = sum(axis**2 for axis in np.indices((2 * radius + 3,) * 3) - radius - 1)
    grain = Grain.from_mask(square <= radius**2, voxel_size="2 um")
    options = {"generations": 500} if method == "paper" else {}
    result = fit(grain, n=12, method=method, **options)
    assert result.avatar.n == 12
    assert result.verdict.valid
    assert len(np.unique(np.round(result.avatar.centers, 6), axis=0)) == 12
    # The surface is a sphere about the middle of the mask.
    reach = np.linalg.norm(result.avatar.mesh().vertices - grain.centroid, axis=1)
    assert np.abs(reach / reach.mean() - 1).max() < (0.02 if method == "fast" else 0.06)


def test_too_many_control_points_names_the_greatest_number() -> None:
    grain = grain_where(ellipsoid(3, 3, 3), 5, VoxelSize(1, 1, 1, "um"))
    with pytest.raises(FitError, match=r"n = (\d+) or fewer") as caught:
        fit(grain, grain.voxel_count)
    most = int(str(caught.value).split("ask for n = ")[1].split()[0])
    assert 1 <= most < grain.voxel_count
    assert fit(grain, most).avatar.n <= most
    with pytest.raises(FitError, match="or fewer"):
        fit(grain, grain.voxel_count + 1000)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 2, 2), (2, 2, 2), (1, 1, 15), (1, 9, 9), (3, 3, 3)])
def test_grains_of_a_few_voxels_are_fitted_or_refused(shape: tuple[int, int, int]) -> None:
    grain = Grain(np.ones(shape, dtype=bool), VoxelSize(1, 1, 1, "um"))
    result = fit(grain, 1)
    assert (result.verdict.pieces, result.verdict.voids) == (1, 0)
    assert result.verdict.valid or result.verdict.reasons


def test_unknown_methods_and_options_are_named(ellipsoid_grain: Grain) -> None:
    with pytest.raises(FitError, match="'slow'"):
        start_fit(ellipsoid_grain, 10, "slow")  # type: ignore[arg-type]
    with pytest.raises(FitError, match=r"'generation'.*generations"):
        start_fit(ellipsoid_grain, 10, generation=5)


def test_there_is_no_result_before_the_search(ellipsoid_grain: Grain) -> None:
    run = start_fit(ellipsoid_grain, 10)
    next(run)
    with pytest.raises(FitError, match="not begun"):
        run.result()
    with pytest.raises(FitError, match="not begun"):
        run.more_generations(3)


def test_public_names() -> None:
    assert mb.fit is fit
    assert mb.start_fit is start_fit
