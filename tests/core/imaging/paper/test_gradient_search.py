"""The paper's method: its start, its optimisers and its options."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit, start_fit
from mbstudio.core.imaging.paper.gradient_search import Adam, GradientDescent
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.imaging.start.control_points import control_of_spheres
from mbstudio.core.imaging.start.sphere_clustering import Sphere, cluster_to_the_letter
from mbstudio.core.metaball.field import field_at


def test_start_is_k_of_the_squared_radius_or_the_radius(ellipsoid_grain: Grain) -> None:
    prepared = prepare(ellipsoid_grain)
    sphere = Sphere((18, 21, 26), 4.5 * prepared.voxel)  # half a voxel is taken off: 4 voxels
    square = control_of_spheres(prepared, [sphere], common_factor=False)
    plain = control_of_spheres(prepared, [sphere], weight="radius", common_factor=False)
    assert square[3, 0] == pytest.approx((4 * prepared.voxel) ** 2)
    assert plain[3, 0] == pytest.approx(4 * prepared.voxel)
    # Alone, k = r**2 is a sphere of that radius about that voxel.
    place = np.array([26, 21, 18]) * prepared.spacing + prepared.origin
    assert field_at((place + np.array([4 * prepared.voxel, 0, 0]))[None], square)[0] == pytest.approx(1)


def test_common_factor_makes_the_mean_of_ln_f_vanish(ellipsoid_grain: Grain) -> None:
    prepared = prepare(ellipsoid_grain)
    spheres = list(cluster_to_the_letter(prepared.mask, prepared.spacing, 20))
    plain = control_of_spheres(prepared, spheres, common_factor=False)
    scaled = control_of_spheres(prepared, spheres)
    assert np.log(field_at(prepared.hull, plain)).mean() > 0.2  # far too large
    assert np.log(field_at(prepared.hull, scaled)).mean() == pytest.approx(0, abs=0.01)
    np.testing.assert_allclose(scaled[3] / plain[3], scaled[3, 0] / plain[3, 0])


def test_adam_first_steps_by_hand() -> None:
    adam = Adam(0.1, 0.9, 0.999, 1e-8)
    # First step: m/(1-b1) = g, v/(1-b2) = g**2, so the change is -rate * sign(g).
    np.testing.assert_allclose(adam.change(np.array([4.0, -0.01])), [-0.1, 0.1], rtol=1e-5)
    # Second, g = 0: m = 0.9 * 0.1 g / (1 - 0.81), v = 0.999 * 0.001 g**2 / (1 - 0.999**2).
    m, v = 0.09 * 4 / 0.19, 0.000999 * 16 / (1 - 0.999**2)
    np.testing.assert_allclose(adam.change(np.array([0.0, 0.0]))[0], -0.1 * m / np.sqrt(v), rtol=1e-6)


def test_descent_by_hand() -> None:
    plain, heavy = GradientDescent(0.1, 0.0), GradientDescent(0.1, 0.5)
    gradient = np.array([2.0])
    assert plain.change(gradient)[0] == plain.change(gradient)[0] == pytest.approx(-0.2)
    assert heavy.change(gradient)[0] == pytest.approx(-0.2)
    assert heavy.change(gradient)[0] == pytest.approx(-0.3)


def test_optimisers_agree_with_torch() -> None:
    import torch

    start = np.array([1.0, -2.0, 0.5])
    for ours, make in (
        (Adam(0.01, 0.9, 0.999, 1e-8), lambda p: torch.optim.Adam(p, lr=0.01)),
        (GradientDescent(0.01, 0.3), lambda p: torch.optim.SGD(p, lr=0.01, momentum=0.3)),
    ):
        theirs = torch.tensor(start, dtype=torch.float64, requires_grad=True)
        optimiser, here = make([theirs]), start.copy()
        for _ in range(20):
            optimiser.zero_grad()
            (theirs**4).sum().backward()
            optimiser.step()
            here = here + ours.change(4 * here**3)
        np.testing.assert_allclose(here, theirs.detach().numpy(), rtol=1e-10)


def test_paper_fit_of_an_ellipsoid(ellipsoid_grain: Grain) -> None:
    steps = []
    result = fit(ellipsoid_grain, 12, "paper", generations=500, hull_points=3000, on_step=steps.append)
    assert [step.phase for step in steps] == ["clustering"] * 12 + ["search"] * 501
    assert result.method == "paper"
    assert len(result.history) == 501
    assert result.history[-1] < 0.3 * result.history[0]
    assert result.verdict.pieces == 1
    assert abs(result.verdict.volume_error) < 0.05
    assert [step.generation for step in steps if "SGD" in step.note] == [401]
    # SGD ends the jitter: it goes down, and in small steps.
    assert result.history[-1] <= result.history[400]


def test_paper_fit_repeats_and_pauses(ellipsoid_grain: Grain) -> None:
    options = {"generations": 20, "hull_points": 2000}
    whole = fit(ellipsoid_grain, 6, "paper", **options)
    run = start_fit(ellipsoid_grain, 6, "paper", **options)
    for _ in range(15):
        next(run)
    for _ in run:
        pass
    np.testing.assert_array_equal(run.result().avatar.weights, whole.avatar.weights)
    run.change_control_points(9)
    assert sum(1 for _ in run) == 21  # the changed control points themselves, then 20 generations
    assert run.result().avatar.n == 9
    run.more_generations(3)
    assert sum(1 for _ in run) == 3


def test_literal_variant_with_k_stays_positive(ellipsoid_grain: Grain) -> None:
    result = fit(
        ellipsoid_grain, 6, "paper", generations=60, hull_points=2000, parameter="k", weight="radius",
        common_factor=False, learning_rate=0.05, least_k=1e-4,
    )  # fmt: skip
    assert result.avatar.weights.min() > 0


def test_divergence_is_an_error_not_an_avatar(ellipsoid_grain: Grain) -> None:
    with pytest.raises(FitError, match=r"diverged.*learning_rate"):
        fit(ellipsoid_grain, 6, "paper", generations=200, hull_points=2000, reduction="sum", adam_share=0.0)


@pytest.mark.parametrize(
    "options",
    [{"weight": "cube"}, {"parameter": "x"}, {"learning_rate": 0.0}, {"generations": 0}, {"adam_share": 2.0}],
)
def test_impossible_options_are_refused(ellipsoid_grain: Grain, options: dict[str, object]) -> None:
    with pytest.raises(FitError):
        start_fit(ellipsoid_grain, 6, "paper", **options)
