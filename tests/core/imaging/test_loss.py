"""Eq. GSloss: its three branches by hand, where they meet, its slope, its gradient."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.imaging.loss import mean_loss, point_loss_slope
from mbstudio.core.imaging.paper.gradient_search import loss_and_gradient


def losses(field: np.ndarray) -> np.ndarray:
    """Return the loss of each hull point by itself."""
    return np.array([mean_loss(np.array([f])) for f in field])


@pytest.mark.parametrize(
    ("f", "loss"),
    [
        (4.0, 9.0), (3.0, 4.0),  # (f - 1)**2
        (1.5, 0.5), (1.25, 0.25),  # f - 1
        (0.5, 0.25 + 2 - 1), (0.25, 0.5625 + 4 - 1), (0.8, 0.04 + 1.25 - 1),  # (f - 1)**2 + 1/f - 1
    ],
)  # fmt: skip
def test_each_branch(f: float, loss: float) -> None:
    assert mean_loss(np.array([f])) == pytest.approx(loss)


@pytest.mark.parametrize(("f", "loss"), [(1.0, 0.0), (2.0, 1.0)])
def test_branches_meet(f: float, loss: float) -> None:
    around = np.array([f - 1e-9, f, f + 1e-9])
    np.testing.assert_allclose(losses(around), loss, atol=1e-8)


def test_reported_loss_is_the_mean_over_hull_points() -> None:
    field = np.array([3.0, 1.5, 0.5])
    assert mean_loss(field) == pytest.approx((4 + 0.5 + 1.25) / 3)
    assert mean_loss(np.tile(field, 10)) == pytest.approx(mean_loss(field))


def test_loss_is_lowest_on_the_surface() -> None:
    field = np.linspace(0.05, 5, 400)
    loss = losses(field)
    assert (loss > 0).all()
    assert (np.diff(loss[field < 1]) < 0).all()
    assert (np.diff(loss[field > 1]) > 0).all()


def test_slope_agrees_with_finite_differences() -> None:
    field = np.array([0.2, 0.6, 0.95, 1.1, 1.7, 2.2, 5.0])
    numeric = (losses(field + 1e-6) - losses(field - 1e-6)) / 2e-6
    np.testing.assert_allclose(point_loss_slope(field), numeric, rtol=1e-5)


def test_gradient_by_the_control_points_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(4)
    hull = rng.normal(size=(60, 3))
    hull /= np.linalg.norm(hull, axis=1, keepdims=True)
    control = np.vstack([0.3 * rng.normal(size=(3, 5)), rng.uniform(0.05, 0.3, (1, 5))])
    _, gradient = loss_and_gradient(hull, control)
    numeric = np.empty_like(control)
    for index in np.ndindex(control.shape):
        step = np.zeros_like(control)
        step[index] = 1e-6
        numeric[index] = (
            loss_and_gradient(hull, control + step)[0] - loss_and_gradient(hull, control - step)[0]
        ) / 2e-6
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-6)


def test_loss_and_gradient_of_one_point_on_each_branch_by_hand() -> None:
    # One control point of k = 3 at the origin; f = 3 / d**2 is 3, 1.5 and 0.75 at the hull points.
    control = np.array([[0.0], [0.0], [0.0], [3.0]])
    hull = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, np.sqrt(2.0)], [-2.0, 0.0, 0.0]])
    loss, gradient = loss_and_gradient(hull, control)
    assert loss == pytest.approx((4 + 0.5 + (0.0625 + 1 / 0.75 - 1)) / 3)
    slope = [4.0, 1.0, -0.5 - 16 / 9]  # 2 (f - 1), 1, 2 (f - 1) - 1 / f**2
    by_k = [1.0, 0.5, 0.25]  # 1 / d**2
    assert gradient[3, 0] == pytest.approx(np.dot(slope, by_k) / 3)
    # df/dx = 2 k (H - c) / d**4: 6 along x, 1.5 sqrt 2 along z, -0.75 along x.
    assert gradient[0, 0] == pytest.approx((slope[0] * 6 - slope[2] * 0.75) / 3)
    assert gradient[1, 0] == 0
    assert gradient[2, 0] == pytest.approx(slope[1] * 1.5 * np.sqrt(2) / 3)
