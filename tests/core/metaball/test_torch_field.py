"""The torch functions agree with the numpy kernels and with derivatives found by hand."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
import torch

from mbstudio.core.metaball import Avatar, torch_field
from mbstudio.core.metaball.rays import first_hits
from mbstudio.core.metaball.signed_distance import closest_points

DEVICES = [
    "cpu",
    pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")),
]
SPHERE = (
    torch.tensor([[1.0, 2.0, 3.0]], dtype=torch.float64),
    torch.tensor([4.0], dtype=torch.float64),
)


def lumpy(n: int = 12) -> Avatar:
    rng = np.random.default_rng(5)
    return Avatar(rng.normal(size=(n, 3)) * 0.6, rng.uniform(0.05, 0.3, n), "mm")


@pytest.mark.parametrize("device", DEVICES)
def test_field_gradient_inside_and_distance_agree_with_numpy(device: str) -> None:
    avatar, points = lumpy(), np.random.default_rng(0).normal(size=(20_000, 3))
    centers, weights = torch_field.avatar_tensors(avatar, device=device, dtype=torch.float64)
    here = torch.tensor(points, device=device)
    field, gradient = torch_field.field_and_gradient(here, centers, weights)
    np.testing.assert_allclose(field.cpu(), avatar.field(points), rtol=1e-11)
    np.testing.assert_allclose(gradient.cpu(), avatar.gradient(points), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(torch_field.field(here, centers, weights).cpu(), field.cpu(), rtol=1e-12)
    np.testing.assert_array_equal(torch_field.contains(here, centers, weights).cpu(), avatar.contains(points))
    np.testing.assert_allclose(
        torch_field.first_order_distance(here, centers, weights).cpu(),
        avatar.signed_distance(points), rtol=1e-8,
    )  # fmt: skip


@pytest.mark.parametrize("device", DEVICES)
def test_closest_points_agree_with_numpy(device: str) -> None:
    avatar, points = lumpy(), np.random.default_rng(1).uniform(-2, 2, (500, 3))
    centers, weights = torch_field.avatar_tensors(avatar, device=device, dtype=torch.float64)
    nearest, distance = torch_field.closest_points(torch.tensor(points, device=device), centers, weights)
    np.testing.assert_allclose(avatar.field(nearest.cpu().numpy()), 1, atol=1e-6)
    away = np.abs(distance.cpu().numpy() - closest_points(points, avatar.control)[1])
    assert np.percentile(away, 98) < 1e-4


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-7), (torch.float32, 2e-4)])
def test_ray_hits_agree_with_numpy(device: str, dtype: torch.dtype, tolerance: float) -> None:
    rng, avatar = np.random.default_rng(2), lumpy()
    origins = rng.normal(size=(400, 3))
    origins *= 5 / np.linalg.norm(origins, axis=1, keepdims=True)
    origins[:50] *= 0.01  # from inside
    directions = rng.normal(size=(400, 3)) * 0.7 - origins
    centers, weights = torch_field.avatar_tensors(avatar, device=device, dtype=dtype)
    found = torch_field.first_hits(
        torch.tensor(origins, device=device, dtype=dtype),
        torch.tensor(directions, device=device, dtype=dtype),
        centers,
        weights,
    )
    found = found.cpu().numpy()
    true = first_hits(origins, directions, avatar.control)
    hit = np.isfinite(true) & np.isfinite(found)
    assert (np.isfinite(true) != np.isfinite(found)).mean() <= 0.0025  # one that grazes
    assert hit.sum() > 200
    assert np.percentile(np.abs(found[hit] - true[hit]), 99) < tolerance


def test_the_distance_to_a_sphere_has_the_derivatives_of_geometry() -> None:
    # sd = |x - c| - sqrt(k): by x the direction, by c its opposite, by k -1 / (2 sqrt k) = -1/4.
    for measure in (
        torch_field.first_order_distance,
        lambda points, centers, weights: torch_field.closest_points(points, centers, weights)[1],
    ):
        centers, weights = (tensor.clone().requires_grad_() for tensor in SPHERE)
        point = torch.tensor([[1.0, 2.0, 8.0]], dtype=torch.float64, requires_grad=True)
        distance = measure(point, centers, weights)
        assert distance.item() == pytest.approx(3)
        distance.sum().backward()
        np.testing.assert_allclose(point.grad, [[0, 0, 1]], atol=1e-9)
        np.testing.assert_allclose(centers.grad, [[0, 0, -1]], atol=1e-9)
        np.testing.assert_allclose(weights.grad, [-0.25], atol=1e-9)


def test_a_ray_hit_has_the_derivatives_of_geometry() -> None:
    # Downward from (1, 2, 10) the top of the sphere, z = 5, is met after 5: dt/doz = 1, dt/dcz = -1, dt/dk =
    # -1/4.
    centers, weights = (tensor.clone().requires_grad_() for tensor in SPHERE)
    origin = torch.tensor([[1.0, 2.0, 10.0]], dtype=torch.float64, requires_grad=True)
    t = torch_field.first_hits(origin, torch.tensor([[0, 0, -2.0]], dtype=torch.float64), centers, weights)
    assert t.item() == pytest.approx(5)
    t.sum().backward()
    np.testing.assert_allclose(origin.grad, [[0, 0, 1]], atol=1e-9)
    np.testing.assert_allclose(centers.grad, [[0, 0, -1]], atol=1e-9)
    np.testing.assert_allclose(weights.grad, [-0.25], atol=1e-9)


def test_derivatives_agree_with_finite_differences() -> None:
    centers, weights = torch_field.avatar_tensors(lumpy(6), dtype=torch.float64)
    centers, weights = centers.requires_grad_(), weights.requires_grad_()
    points = torch.randn(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) + 2
    points.requires_grad_()
    assert torch.autograd.gradcheck(torch_field.field_and_gradient, (points, centers, weights))
    assert torch.autograd.gradcheck(torch_field.first_order_distance, (points, centers, weights))
    assert torch.autograd.gradcheck(
        lambda *inputs: torch_field.closest_points(*inputs, iterations=80)[1], (points, centers, weights),
        atol=1e-5,
    )  # fmt: skip


def test_projection_moves_with_the_control_points() -> None:
    centers, weights = (tensor.clone().requires_grad_() for tensor in SPHERE)
    landed = torch_field.project_to_surface(
        torch.tensor([[1.0, 2, 9], [1, 2, 3.5]], dtype=torch.float64), centers, weights
    )
    np.testing.assert_allclose(landed.detach(), [[1, 2, 5], [1, 2, 5]], atol=1e-9)
    landed[0, 2].backward()
    assert weights.grad.item() == pytest.approx(0.25)  # the radius grows by dk / (2 r)
    assert centers.grad[0, 2].item() == pytest.approx(1)


def test_rays_that_miss_are_infinite_and_do_not_spoil_derivatives() -> None:
    centers, weights = (tensor.clone().requires_grad_() for tensor in SPHERE)
    origins = torch.tensor([[1.0, 2, 10], [50, 50, 10]], dtype=torch.float64)
    t = torch_field.first_hits(
        origins, torch.tensor([[0, 0, -1.0]] * 2, dtype=torch.float64), centers, weights
    )
    assert torch.isinf(t[1])
    t[0].backward()
    assert torch.isfinite(centers.grad).all()


def test_the_example_is_right_and_the_module_is_found_by_its_package() -> None:
    import mbstudio.core.metaball as package

    assert package.torch_field is torch_field
    assert "torch_field" in package.__all__
    found = doctest.testmod(torch_field)
    assert (found.failed, found.attempted > 0) == (0, True)
