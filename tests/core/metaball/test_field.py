"""The metaball function, its gradient and the avatar's geometry, against values found by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mbstudio.core.errors import AvatarError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metaball.field import control_rows, field_on_grid, solid_bounds

TWO = Avatar([[0, 0, 0], [3, 0, 0]], [1.0, 4.0], "mm")


def some_avatar(n: int = 7, seed: int = 3) -> Avatar:
    rng = np.random.default_rng(seed)
    return Avatar(rng.normal(size=(n, 3)), rng.uniform(0.1, 1.0, n), "mm")


def test_field_is_the_sum_of_k_over_squared_distance() -> None:
    # At (1, 0, 0): 1/1 + 4/4 = 2. At (0, 4, 0): 1/16 + 4/25. At (3, 0, 2): 1/13 + 4/4.
    found = TWO.field(np.array([[1, 0, 0], [0, 4, 0], [3, 0, 2]]))
    np.testing.assert_allclose(found, [2, 1 / 16 + 4 / 25, 1 / 13 + 1], rtol=1e-14)


def test_field_on_a_control_point_is_infinite_and_silent() -> None:
    assert TWO.field(np.array([[3.0, 0, 0]]))[0] == np.inf
    assert TWO.contains(np.array([[3.0, 0, 0]]))[0]


def test_gradient_at_a_point_found_by_hand() -> None:
    # d/dx of 1/x**2 + 4/(3-x)**2 at x = 1 is -2 + 8/8 = -1; y and z vanish by symmetry.
    np.testing.assert_allclose(TWO.gradient(np.array([[1.0, 0, 0]])), [[-1, 0, 0]], atol=1e-14)


def test_gradient_agrees_with_finite_differences() -> None:
    avatar, points, step = some_avatar(), np.random.default_rng(0).normal(size=(300, 3)) * 2, 1e-5
    numeric = np.stack(
        [(avatar.field(points + d) - avatar.field(points - d)) / (2 * step) for d in step * np.eye(3)], axis=1
    )
    scale = np.abs(numeric).max(axis=1, keepdims=True)
    np.testing.assert_allclose(avatar.gradient(points) / scale, numeric / scale, atol=1e-5)


def test_inside_is_where_the_field_reaches_one() -> None:
    sphere = Avatar([[1, 2, 3]], [4.0], "mm")  # a sphere of radius 2
    found = sphere.contains(np.array([[1, 2, 4.999], [1, 2, 5.001], [2.9, 2, 3]]))
    assert found.tolist() == [True, False, True]


@pytest.mark.parametrize("n", [1, 2, 5, 40])
def test_grid_agrees_with_points(n: int) -> None:
    avatar, shape, origin, spacing = (
        some_avatar(n),
        (5, 6, 7),
        np.array([-2.0, -1.5, -1.0]),
        np.array([0.5, 0.4, 0.3]),
    )
    field = field_on_grid(origin, spacing, shape, avatar.control)
    index = np.stack(np.meshgrid(*[np.arange(s) for s in shape], indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(field.ravel(), avatar.field(index[:, ::-1] * spacing + origin), rtol=3e-5)


def test_grid_keeps_its_precision_far_from_the_origin() -> None:
    near = some_avatar()
    far = near.transformed(translation=np.full(3, 1e6))
    shape, spacing = (9, 9, 9), np.full(3, 0.25)
    here = field_on_grid(np.full(3, -1.0), spacing, shape, near.control)
    there = field_on_grid(np.full(3, 1e6 - 1.0), spacing, shape, far.control)
    np.testing.assert_allclose(here, there, rtol=1e-4)


def test_grid_node_on_a_control_point_is_infinite() -> None:
    control = control_rows(np.array([[0.0, 0, 0], [0, 0, 0]]), np.ones(2))
    field = field_on_grid(np.full(3, -1.0), np.ones(3), (3, 3, 3), control)
    assert field[1, 1, 1] == np.inf
    assert field[1, 1, 2] == pytest.approx(2.0)


def test_points_of_a_wrong_shape_are_refused() -> None:
    with pytest.raises(AvatarError, match=r"\(m, 3\)"):
        TWO.field(np.zeros(3))


def test_bounds_of_a_sphere_are_the_sphere() -> None:
    np.testing.assert_allclose(Avatar([[1, 2, 3]], [4.0], "mm").bounds(), [[-1, 0, 1], [3, 4, 5]], atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_bounds_hold_the_solid_and_little_more(seed: int) -> None:
    avatar = some_avatar(12, seed)
    low, high = avatar.bounds()
    wide = solid_bounds(avatar.control, rounds=0)
    axes = [np.linspace(a, b, 60) for a, b in wide.T]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = points[avatar.contains(points)]
    assert (inside >= low).all()
    assert (inside <= high).all()
    slack = np.concatenate([inside.min(axis=0) - low, high - inside.max(axis=0)])
    assert slack.max() < 0.12 * (high - low).max()


def test_other_units_keep_field_and_place() -> None:
    points = np.array([[1.0, 0.5, 0.2]])
    metres = TWO.to("m")
    assert metres.unit == "m"
    np.testing.assert_allclose(metres.field(points * 1e-3), TWO.field(points), rtol=1e-12)


def test_rotation_and_translation_carry_points_along() -> None:
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # x to y
    moved = TWO.transformed(quarter, np.array([0, 0, 5.0]))
    np.testing.assert_allclose(moved.centers, [[0, 0, 5], [0, 3, 5]], atol=1e-15)
    np.testing.assert_array_equal(moved.weights, TWO.weights)


def test_a_matrix_that_is_no_rotation_is_refused() -> None:
    with pytest.raises(AvatarError, match="orthogonal"):
        TWO.transformed(2 * np.eye(3))


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan])
def test_an_impossible_scale_is_refused(factor: float) -> None:
    with pytest.raises(AvatarError, match="positive"):
        TWO.scaled(factor)


@settings(max_examples=40)
@given(
    centers=arrays(float, (4, 3), elements=st.floats(-10, 10)),
    weights=arrays(float, 4, elements=st.floats(0.01, 10)),
    factor=st.floats(0.01, 100),
    shift=arrays(float, 3, elements=st.floats(-100, 100)),
)
def test_field_is_the_same_after_scaling_and_moving_points_along(
    centers: np.ndarray, weights: np.ndarray, factor: float, shift: np.ndarray
) -> None:
    avatar = Avatar(centers, weights, "mm")
    points = np.array([[0.3, 11.0, -0.7], [12.0, 0.1, 0.2]])  # further than 1 from every control point
    changed = avatar.scaled(factor).transformed(translation=shift)
    np.testing.assert_allclose(changed.field(points * factor + shift), avatar.field(points), rtol=1e-7)
