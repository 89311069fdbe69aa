"""Another number of control points on the way: what was reached is kept, or the start is as good."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitRun, SearchStep, fit, start_fit
from mbstudio.core.imaging.loss import mean_loss
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.imaging.start.control_points import with_number
from mbstudio.core.metaball.field import field_at
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import cut_box, ellipsoid, grain_where

OPTIONS = {"fast": {"generations": 25}, "paper": {"generations": 150, "hull_points": 1200}}
METHODS = pytest.mark.parametrize("method", ["fast", "paper"])


def cobble(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """An ellipsoid with gentle waves."""
    radius = np.sqrt((x / 16.3) ** 2 + (y / 12.2) ** 2 + (z / 10.1) ** 2)
    return radius <= 1 + 0.04 * np.sin(0.4 * x + 0.3 * y) + 0.04 * np.cos(0.35 * z - 0.2 * x)


def craggy(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Three lobes grown together, a sharp-edged bite, a rough face."""
    lobes = [((-7, 0, 0), 9.3), ((7, 3, 2), 8.4), ((2, -6, -4), 8.1)]
    body = np.zeros(np.broadcast_shapes(x.shape, y.shape, z.shape), dtype=bool)
    rough = 0.5 * np.sin(1.3 * x + 0.9 * y) + 0.5 * np.sin(1.1 * z - 1.4 * y)
    for (cx, cy, cz), radius in lobes:
        body |= np.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) + rough <= radius
    return body & ((x - 1) ** 2 + (y - 8) ** 2 + (z - 5) ** 2 > 30)


@pytest.fixture(scope="module")
def grains() -> dict[str, Grain]:
    shapes = {"cobble": cobble, "angular": cut_box, "craggy": craggy}
    return {
        name: grain_where(shape, 20, VoxelSize(1, 1, 1, "um"), name=name) for name, shape in shapes.items()
    }


def loss_at_the_start(grain: Grain, n: int, method: str, known: dict[tuple, float]) -> float:
    key = (grain.name, n, method)
    if key not in known:
        run = start_fit(grain, n, method, **OPTIONS[method])
        known[key] = next(step.loss for step in run if step.phase == "search")
    return known[key]


@pytest.fixture(scope="module")
def known() -> dict[tuple, float]:
    return {}


def advance(run: FitRun, generations: int) -> SearchStep:
    """Go on for so many steps of the search (or to its end)."""
    done, step = 0, None
    for step in run:
        done += step.phase == "search"
        if done > generations:
            break
    assert step is not None
    return step


@METHODS
@pytest.mark.parametrize(
    ("shape", "generations"),
    [("cobble", 0), ("cobble", 1000), ("angular", 0), ("angular", 10), ("craggy", 10), ("craggy", 1000)],
)
@pytest.mark.parametrize("n", [40, 10, 1])
def test_never_worse_than_a_fresh_start(
    grains: dict[str, Grain], known: dict[tuple, float], method, n: int, shape: str, generations: int
) -> None:
    """From the start, in the middle and after the end; up, down, by one, from and to a single point."""
    grain = grains[shape]
    run = start_fit(grain, n, method, **OPTIONS[method])
    advance(run, generations)
    for m in {40: (20, 40, 41, 1), 10: (80, 10), 1: (40, 1)}[n]:
        before = run.result()
        run.change_control_points(m)
        step = next(run)
        assert step.avatar.n == m
        assert step.loss <= loss_at_the_start(grain, m, method, known)
        after = run.result()
        assert (after.n, after.avatar.n) == (m, m)
        np.testing.assert_array_equal(after.history[:-1], before.history)
        assert after.history[-1] == step.loss


@METHODS
@pytest.mark.parametrize("shape", ["cobble", "angular", "craggy"])
def test_a_small_change_at_the_end_hardly_changes_the_loss(grains, method, shape: str) -> None:
    run = start_fit(grains[shape], 30, method, **OPTIONS[method])
    last = advance(run, 1000)
    for m, most in ((31, 1.05), (30, 1.1), (40, 1.1)):
        run.change_control_points(m)
        step = next(run)
        assert step.loss < most * last.loss
        assert step.note == f"goes on with {m} control points"


@METHODS
def test_one_point_says_nothing_of_where_forty_belong(grains: dict[str, Grain], method) -> None:
    run = start_fit(grains["craggy"], 1, method, **OPTIONS[method])
    advance(run, 1000)
    run.change_control_points(40)
    step = next(run)
    assert step.note.startswith("restarts with 40")
    fresh = start_fit(grains["craggy"], 40, method, **OPTIONS[method])
    start = next(step for step in fresh if step.phase == "search")
    np.testing.assert_allclose(step.avatar.centers, start.avatar.centers)
    assert step.loss == pytest.approx(start.loss)


@METHODS
def test_the_search_goes_down_from_there(grains: dict[str, Grain], method) -> None:
    run = start_fit(grains["angular"], 40, method, **OPTIONS[method])
    advance(run, 1000)
    for m in (20, 40, 10, 80):
        run.change_control_points(m)
        first = next(step for step in run if step.phase == "search")
        last = advance(run, 1000)
        assert last.loss < first.loss


@METHODS
def test_twice_in_a_row_and_the_result_between(grains: dict[str, Grain], method) -> None:
    run = start_fit(grains["cobble"], 20, method, **OPTIONS[method])
    advance(run, 10)
    before = run.result()
    run.change_control_points(35)
    between = run.result()
    assert (between.n, between.avatar.n) == (35, 35)
    assert len(between.history) == len(between.rms_history) == len(before.history)
    run.change_control_points(12)
    now = run.result()
    step = next(run)
    assert now.avatar.n == step.avatar.n == 12
    np.testing.assert_array_equal(now.avatar.centers, step.avatar.centers)
    # The verdict is of these control points, not of those before the change.
    assert now.verdict.rms == pytest.approx(step.rms)
    assert now.verdict.rms != before.verdict.rms
    assert run.result().history[-1] == step.loss
    run.change_control_points(12)  # the same number: nothing begins anew
    assert next(run).generation == step.generation + 1


@METHODS
@pytest.mark.parametrize("changes", [(12,), (30,), (30, 4)])
def test_while_clustering_it_is_as_if_asked_from_the_beginning(grains, method, changes: tuple) -> None:
    options = {**OPTIONS[method], "generations": 4}
    run = start_fit(grains["craggy"], 20, method, **options)
    first = [next(run).avatar for _ in range(7)]
    for m in changes:
        run.change_control_points(m)
        step = next(run)
    # The spheres found so far are kept: the next one is the eighth.
    assert (step.phase, step.generation) == (("clustering", 8) if changes[-1] != 4 else ("search", 0))
    assert first[-1].n == 7
    for _ in run:
        pass
    whole = fit(grains["craggy"], changes[-1], method, **options)
    np.testing.assert_array_equal(run.result().avatar.weights, whole.avatar.weights)
    np.testing.assert_array_equal(run.result().history, whole.history)


@METHODS
def test_an_impossible_number_leaves_the_run_as_it_was(method) -> None:
    ball = grain_where(ellipsoid(4, 4, 4), 6, VoxelSize(1, 1, 1, "um"))
    options = {**OPTIONS[method], "generations": 12}
    run = start_fit(ball, 5, method, **options)
    advance(run, 3)
    for bad in (0, -1, 2.5, ball.voxel_count, 10**6):
        with pytest.raises(FitError):
            run.change_control_points(bad)  # type: ignore[arg-type]
    assert run.result().n == 5
    for _ in run:
        pass
    whole = fit(ball, 5, method, **options)
    np.testing.assert_array_equal(run.result().avatar.weights, whole.avatar.weights)
    # While clustering it shows at the next step, and a smaller number cures it.
    run = start_fit(ball, 5, method, **options)
    next(run)
    run.change_control_points(ball.voxel_count)
    with pytest.raises(FitError, match="or fewer"):
        for _ in run:
            pass
    run.change_control_points(5)
    for _ in run:
        pass
    np.testing.assert_array_equal(run.result().avatar.weights, whole.avatar.weights)


@METHODS
@pytest.mark.parametrize("steps", [0, 5, 25])
def test_a_run_that_is_dropped_is_freed(grains: dict[str, Grain], method, steps: int) -> None:
    run = start_fit(grains["cobble"], 12, method, **OPTIONS[method])
    for _ in range(steps):
        step = next(run)
    prepared = getattr(run, "prepared", None)
    freed = weakref.ref(run if prepared is None else prepared)
    if steps:
        assert step.make_avatar().n == min(steps, 12)
        del step
    del run, prepared
    gc.collect()
    assert freed() is None


def test_splitting_and_merging_by_hand() -> None:
    grain = grain_where(ellipsoid(9.3, 9.3, 9.3), 12, VoxelSize(1, 1, 1, "um"))
    prepared = prepare(grain)
    control = np.array([[-0.5, 0.5, 0.52], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.3, 0.1, 0.3]])
    merged = with_number(control, 2, prepared)
    # The pair 0.02 apart becomes one at its centre of mass; a factor may follow.
    np.testing.assert_allclose(np.sort(merged[0]), [-0.5, 0.515])
    ratio = merged[3] / np.array([0.3, 0.4])
    assert ratio[0] == pytest.approx(ratio[1])
    split = with_number(merged, 5, prepared)
    assert split.shape == (4, 5)
    assert len(np.unique(split[:3].round(9), axis=1).T) == 5
    losses = [mean_loss(field_at(prepared.hull, one)) for one in (merged, split)]
    assert losses[1] < 1.05 * losses[0]
    same = with_number(split, 5, prepared)
    np.testing.assert_array_equal(same, split)
    assert same is not split
