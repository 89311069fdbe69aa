"""Generations of the paper's search, each written out anew with plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit, start_fit
from mbstudio.core.imaging.paper.gradient_search import PaperOptions
from mbstudio.core.imaging.preprocess import PreparedGrain, prepare
from mbstudio.core.imaging.start.control_points import control_of_spheres
from mbstudio.core.imaging.start.sphere_clustering import Sphere, cluster_to_the_letter
from mbstudio.core.imaging.steps import SearchStep
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import ellipsoid, grain_where

RATE = 0.01
FEW = {"hull_points": 10, "learning_rate": RATE}


@pytest.fixture(scope="module")
def egg() -> Grain:
    return grain_where(ellipsoid(9.3, 6.2, 5.4), 12, VoxelSize(2, 2, 2, "um"), name="egg")


@pytest.fixture(scope="module")
def prepared(egg: Grain) -> PreparedGrain:
    return prepare(egg, working_side=200, hull_points=10)


def loss_and_slopes(hull: np.ndarray, control: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean of Eq. GSloss and its slopes by x, y, z, k, a hull point and a control point at a time."""
    loss, slopes = 0.0, np.zeros_like(control)
    for point in hull:
        f = sum(control[3, j] / ((point - control[:3, j]) ** 2).sum() for j in range(control.shape[1]))
        if f >= 2:
            loss, outer = loss + (f - 1) ** 2, 2 * (f - 1)
        elif f >= 1:
            loss, outer = loss + f - 1, 1.0
        else:
            loss, outer = loss + (f - 1) ** 2 + 1 / f - 1, 2 * (f - 1) - 1 / f**2
        for j in range(control.shape[1]):
            away = point - control[:3, j]
            square = (away**2).sum()
            slopes[3, j] += outer / square
            slopes[:3, j] += outer * 2 * control[3, j] * away / square**2
    return loss / len(hull), slopes / len(hull)


def control_of(avatar: Avatar, prepared: PreparedGrain) -> np.ndarray:
    """Rows x, y, z, k in the working frame."""
    places = (avatar.centers - prepared.center) / prepared.scale
    return np.vstack([places.T, avatar.weights / prepared.scale**2])


def searched(egg: Grain, **options: object) -> list[SearchStep]:
    steps: list[SearchStep] = []
    fit(egg, 2, "paper", on_step=steps.append, **FEW, **options)
    return [step for step in steps if step.phase == "search"]


def test_adam_then_sgd_generation_by_generation(egg: Grain, prepared: PreparedGrain) -> None:
    steps = searched(egg, generations=6, adam_share=0.5, momentum=0.3)
    assert len(prepared.hull) == 10
    control = control_of(steps[0].avatar, prepared)
    first = second = velocity = np.zeros_like(control)
    for generation, step in enumerate(steps):
        loss, slopes = loss_and_slopes(prepared.hull, control)
        np.testing.assert_allclose(control_of(step.avatar, prepared), control, rtol=1e-9, atol=1e-12)
        assert step.loss == pytest.approx(loss)
        # The fourth generation is the first after the half.
        assert step.note == ("SGD takes over from Adam" if generation == 4 else "")
        slopes[3] *= control[3]  # the slope by ln k
        if generation < 3:
            count = generation + 1
            first = 0.9 * first + 0.1 * slopes
            second = 0.999 * second + 0.001 * slopes**2
            unbiased = first / (1 - 0.9**count), second / (1 - 0.999**count)
            change = -RATE * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8)
        else:
            velocity = slopes if generation == 3 else 0.3 * velocity + slopes
            change = -RATE * velocity
        control = np.vstack([control[:3] + change[:3], control[3] * np.exp(change[3])])


@pytest.mark.parametrize("unit", ["rms radius", "voxel"])
@pytest.mark.parametrize("reduction", ["mean", "sum"])
def test_one_generation_as_printed(egg: Grain, prepared: PreparedGrain, reduction: str, unit: str) -> None:
    """M <- M - eta grad L, by k itself, with lengths in either unit."""
    start, after = searched(egg, generations=1, adam_share=0.0, parameter="k", reduction=reduction, unit=unit)
    length = 1.0 if unit == "rms radius" else prepared.scale / 2.0  # voxels of 2 um in a working length
    control = control_of(start.avatar, prepared)
    control = np.vstack([control[:3] * length, control[3] * length**2])
    _, slopes = loss_and_slopes(prepared.hull * length, control)
    expected = control - RATE * slopes * (10 if reduction == "sum" else 1)
    found = control_of(after.avatar, prepared)
    np.testing.assert_allclose(found[:3] * length, expected[:3], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found[3] * length**2, expected[3], rtol=1e-9)
    assert not np.allclose(expected, control, rtol=1e-6)


@pytest.mark.parametrize(("unit", "length"), [("voxel", 2.0), ("rms radius", None)])
def test_the_first_step_of_adam_is_the_rate_in_every_coordinate(
    egg: Grain, prepared: PreparedGrain, unit: str, length: float | None
) -> None:
    start, after = searched(egg, generations=1, adam_share=1.0, unit=unit)
    moved = np.abs(after.avatar.centers - start.avatar.centers)
    np.testing.assert_allclose(moved, RATE * (length or prepared.scale), rtol=1e-4)
    ratio = np.abs(np.log(after.avatar.weights / start.avatar.weights))
    np.testing.assert_allclose(ratio, RATE, rtol=1e-4)


def test_k_stays_above_its_floor(egg: Grain) -> None:
    *_, last = searched(
        egg, generations=3, adam_share=1.0, parameter="k", weight="radius", least_k=0.5, common_factor=False
    )
    scale = prepare(egg, working_side=200, hull_points=10).scale
    assert last.avatar.weights.min() / scale**2 >= 0.5


def test_start_of_two_spheres_by_hand(prepared: PreparedGrain) -> None:
    voxel = prepared.voxel
    spheres = [Sphere((10, 10, 12), 4 * voxel), Sphere((10, 11, 18), 2.5 * voxel)]
    letter = control_of_spheres(prepared, spheres, weight="radius", common_factor=False, radius_offset=0.0)
    np.testing.assert_allclose(letter[3], np.array([4, 2.5]) * voxel)
    ours = control_of_spheres(prepared, spheres, common_factor=False)
    np.testing.assert_allclose(ours[3], (np.array([3.5, 2]) * voxel) ** 2)
    # The factor: the geometric mean of f over the hull becomes 1.
    for weight in ("radius", "square"):
        plain = control_of_spheres(prepared, spheres, weight=weight, common_factor=False)
        scaled = control_of_spheres(prepared, spheres, weight=weight)
        away = prepared.hull[:, None] - plain[:3].T[None]
        f = (plain[3] / (away**2).sum(axis=2)).sum(axis=1)
        np.testing.assert_allclose(scaled[3], plain[3] / np.prod(f) ** (1 / 10))
        np.testing.assert_array_equal(scaled[:3], plain[:3])


def test_batches_of_sgd_are_drawn_by_the_seed(egg: Grain) -> None:
    options = {"generations": 4, "hull_points": 300, "adam_share": 0.5}
    whole = fit(egg, 2, "paper", **options)
    all_of_them = fit(egg, 2, "paper", batch_points=300, **options)
    np.testing.assert_array_equal(whole.history, all_of_them.history)
    some, again = (fit(egg, 2, "paper", batch_points=30, **options) for _ in range(2))
    np.testing.assert_array_equal(some.history, again.history)
    # Generations of Adam see all points; the losses are those of all points throughout.
    np.testing.assert_array_equal(some.history[:3], whole.history[:3])
    assert (some.history[3:] != whole.history[3:]).all()
    np.testing.assert_allclose(some.history[3:], whole.history[3:], rtol=0.02)


def test_a_ball_is_used_up_by_one_sphere_and_refused_where_the_letter_stops() -> None:
    ball = grain_where(ellipsoid(4.2, 4.2, 4.2), 6, VoxelSize(1, 1, 1, "um"), name="ball")
    ready = prepare(ball, working_side=200)
    most = len(list(cluster_to_the_letter(ready.mask, ready.spacing, 1000)))
    with pytest.raises(FitError, match=f"'ball'.*ask for n = {most} or fewer"):
        fit(ball, most + 1, "paper", used_up="stop", generations=1)
    assert fit(ball, most, "paper", used_up="stop", generations=1).avatar.n == most
    assert fit(ball, most + 1, "paper", generations=1).avatar.n == most + 1


def test_the_hull_can_be_the_outermost_voxels() -> None:
    body = grain_where(ellipsoid(9.3, 6.2, 5.4), 12, VoxelSize(1, 1, 1, "um"))
    surface, voxels = (
        fit(body, 4, "paper", generations=300, learning_rate=0.005, hull=hull)
        for hull in ("surface", "voxels")
    )
    # A voxel whose neighbour along the steepest axis is outside lies between 0 and that part of the
    # normal inside: 0.5 um where faces lie along the voxels, 0.4 um on average over directions.
    radii = [np.cbrt(result.avatar.mesh(64).volume * 3 / (4 * np.pi)) for result in (surface, voxels)]
    assert 0.2 < radii[0] - radii[1] < 0.5


@pytest.mark.parametrize(
    "options",
    [
        {"hull": "cloud"}, {"unit": "um"}, {"zeroed": "half"}, {"used_up": "go on"}, {"batch_points": -1},
        {"beta1": 1.0}, {"momentum": -0.1}, {"radius_offset": 2.0}, {"least_k": 0.0}, {"hull_points": 3},
        {"working_side": 0}, {"epsilon": 0.0}, {"zeroed": "closed", "clustering": "incremental"},
        {"learning_rate": float("nan")},
    ],
)  # fmt: skip
def test_impossible_options_are_named(egg: Grain, options: dict[str, object]) -> None:
    with pytest.raises(FitError, match=next(iter(options))):
        start_fit(egg, 2, "paper", **options)


def test_the_start_as_printed_is_the_spheres_of_algorithm_1(egg: Grain, prepared: PreparedGrain) -> None:
    """M_r = {r_i, c_i}: the radii as the distance transform gives them are the weights."""
    assert PaperOptions().learning_rate == 0.001
    options = {"weight": "radius", "radius_offset": 0.0, "common_factor": False, "generations": 1}
    run = start_fit(egg, 3, "paper", hull_points=10, **options)
    start = next(step for step in run if step.phase == "search")
    spheres = list(cluster_to_the_letter(prepared.mask, prepared.spacing, 3))
    control = control_of(start.avatar, prepared)
    np.testing.assert_allclose(control[3], [sphere.radius for sphere in spheres], rtol=1e-6)
    places = np.array([sphere.voxel[::-1] for sphere in spheres]) * prepared.spacing + prepared.origin
    np.testing.assert_allclose(control[:3].T, places, atol=1e-12)
    # The first centre is the voxel deepest in the grain: in voxels of 2 um, its radius by hand.
    padded = np.pad(egg.mask, 1)
    inside, outside = np.argwhere(padded), np.argwhere(~padded)
    depth = np.sqrt(((inside[:, None] - outside[None]) ** 2).sum(axis=2)).min(axis=1)
    assert spheres[0].radius * prepared.scale == pytest.approx(2 * depth.max(), rel=1e-6)
