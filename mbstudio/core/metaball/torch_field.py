"""The metaball function and its geometry on torch tensors: any device, differentiable.

Each function takes points and control points as tensors of one floating type on one device.
Results can be differentiated with respect to points, centers and weights; those of iterations
(projection, closest points, ray hits) by the implicit function theorem, so that no iteration is
recorded. The numpy kernels of this package are the faster ones on a processor without gradients.

Examples
--------
How the distances of points to an avatar's surface change with its control points:

>>> from mbstudio.core.metaball import Avatar, torch_field
>>> avatar = Avatar([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [0.4, 0.4], "mm")
>>> centers, weights = torch_field.avatar_tensors(avatar, dtype=torch.float64)
>>> points = torch.tensor([[0.5, 2.0, 0.0]], dtype=torch.float64)
>>> _, distance = torch_field.closest_points(points, centers.requires_grad_(), weights)
>>> distance.sum().backward()
>>> (centers.grad[:, 1] < 0).tolist()  # points nearer to y = 2 make the gap smaller
[True, True]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import torch
from jaxtyping import Bool, Float

if TYPE_CHECKING:
    from mbstudio.core.metaball.avatar import Avatar

T = TypeVar("T")
Points = Float[torch.Tensor, "m 3"]
Centers = Float[torch.Tensor, "n 3"]
Weights = Float[torch.Tensor, "n"]

# Pairs of point and control point at a time: a cache's share on a processor, plenty of work on a GPU.
_PAIRS = {"cpu": 1 << 16, "cuda": 1 << 25}


def avatar_tensors(
    avatar: Avatar, *, device: str | torch.device = "cpu", dtype: torch.dtype = torch.float32
) -> tuple[Centers, Weights]:
    """Return an avatar's control points and weights as tensors, in its unit."""
    return (
        torch.tensor(avatar.centers, device=device, dtype=dtype),
        torch.tensor(avatar.weights, device=device, dtype=dtype),
    )


def _in_chunks(evaluate: Callable[[Points], T], points: Points, n: int) -> list[T]:
    size = max(1, _PAIRS.get(points.device.type, 1 << 20) // max(n, 1))
    return [evaluate(chunk) for chunk in points.split(size)] if len(points) else [evaluate(points)]


def field(points: Points, centers: Centers, weights: Weights) -> Float[torch.Tensor, "m"]:
    """Return f at points; infinite on a control point."""

    def evaluate(chunk: Points) -> torch.Tensor:
        square = (chunk[:, 0, None] - centers[:, 0]).square()
        square = square + (chunk[:, 1, None] - centers[:, 1]).square()
        square = square + (chunk[:, 2, None] - centers[:, 2]).square()
        return square.reciprocal() @ weights

    return torch.cat(_in_chunks(evaluate, points, len(weights)))


def field_and_gradient(
    points: Points, centers: Centers, weights: Weights
) -> tuple[Float[torch.Tensor, "m"], Points]:
    """Return f and its gradient at points, both differentiable; the gradient on a control point is NaN."""

    def evaluate(chunk: Points) -> tuple[torch.Tensor, torch.Tensor]:
        away = [chunk[:, axis, None] - centers[:, axis] for axis in range(3)]
        inverse = (away[0].square() + away[1].square() + away[2].square()).reciprocal()
        terms = inverse * weights
        slopes = -2.0 * terms * inverse
        return terms.sum(1), torch.stack([(slopes * component).sum(1) for component in away], 1)

    parts = _in_chunks(evaluate, points, len(weights))
    return torch.cat([part[0] for part in parts]), torch.cat([part[1] for part in parts])


def contains(points: Points, centers: Centers, weights: Weights) -> Bool[torch.Tensor, "m"]:
    """Return whether each point lies in the solid f >= 1."""
    return field(points, centers, weights) >= 1.0


def _u_and_gradient(
    points: Points, centers: Centers, weights: Weights
) -> tuple[Float[torch.Tensor, "m"], Points]:
    f, gradient = field_and_gradient(points, centers, weights)
    return f.rsqrt(), gradient * (-0.5 * f**-1.5)[:, None]


def first_order_distance(points: Points, centers: Centers, weights: Weights) -> Float[torch.Tensor, "m"]:
    """Return ``(u - 1) / |grad u|`` with ``u = f**-1/2``: negative inside, exact for one control point."""
    u, gradient = _u_and_gradient(points, centers, weights)
    distance: torch.Tensor = (u - 1.0) / gradient.norm(dim=1)
    return distance


def project_to_surface(points: Points, centers: Centers, weights: Weights, steps: int = 12) -> Points:
    """Return points moved along the gradient onto f = 1.

    Parameters
    ----------
    points, centers, weights : tensors of shapes (m, 3), (n, 3), (n,)
    steps : int
        Newton steps on u, each halved until it brings u nearer to 1.

    Notes
    -----
    Differentiable by its last step: a change of the control points moves the result along the normal.
    """
    with torch.no_grad():
        moved = _settled_on_surface(points, centers, weights, steps)
    u, gradient = _u_and_gradient(moved + (points - points.detach()), centers, weights)
    return (
        moved
        + (points - points.detach())
        - ((u - 1.0) / gradient.square().sum(1)).nan_to_num()[:, None] * gradient.nan_to_num()
    )


def _settled_on_surface(points: Points, centers: Centers, weights: Weights, steps: int) -> Points:
    moved = points.clone()
    u, gradient = _u_and_gradient(moved, centers, weights)
    for _ in range(steps):
        move = (-(u - 1.0) / gradient.square().sum(1))[:, None] * gradient
        share = torch.ones_like(u)
        for _ in range(4):
            trial = moved + share[:, None] * move
            u_there, gradient_there = _u_and_gradient(trial, centers, weights)
            better = (u_there - 1.0).abs() < (u - 1.0).abs()
            moved = torch.where(better[:, None], trial, moved)
            u, gradient = (
                torch.where(better, u_there, u),
                torch.where(better[:, None], gradient_there, gradient),
            )
            if bool(better.all()):
                break
            share = torch.where(better, 0.0, 0.5 * share)
    return moved


def closest_points(
    points: Points, centers: Centers, weights: Weights, iterations: int = 20
) -> tuple[Points, Float[torch.Tensor, "m"]]:
    """Return the nearest surface points (without gradient) and the signed distance (differentiable).

    Parameters
    ----------
    points, centers, weights : tensors of shapes (m, 3), (n, 3), (n,)
    iterations : int
        Damped steps in the tangent plane, each followed by a projection.

    Notes
    -----
    From the starts of :func:`mbstudio.core.metaball.signed_distance.closest_points`, which
    converges faster. The distance's derivatives are exact: by the place of the point the normal,
    by the control points ``du / |grad u|`` at the nearest point.
    """
    with torch.no_grad():
        here = points.detach()
        nearest, best = _slid(
            here, _settled_on_surface(here, centers, weights, 12), centers, weights, iterations
        )
        other, there = _slid(here, _start_by_rays(here, centers, weights), centers, weights, iterations)
        best, nearest = torch.minimum(best, there), torch.where((there < best)[:, None], other, nearest)
        u, gradient = _u_and_gradient(nearest, centers, weights)
        steepness = gradient.norm(dim=1)
        normal = gradient / steepness[:, None]
        sign = torch.where(contains(here, centers, weights), -1.0, 1.0).to(best)
        # Of a point not on the surface the normal is the direction to it, free of rounding.
        straight = sign[:, None] * (here - nearest) / best[:, None]
        normal = torch.where((best > 1e-4 / steepness)[:, None], straight, normal)
    u = field(nearest, centers, weights).rsqrt()
    return nearest, (normal * (points - nearest)).sum(1) + (u - u.detach()) / steepness


def _slid(
    points: Points, nearest: Points, centers: Centers, weights: Weights, iterations: int
) -> tuple[Points, Float[torch.Tensor, "m"]]:
    """Return surface points slid to where they are nearest to `points`, and the distances."""
    best = (points - nearest).norm(dim=1).nan_to_num(nan=torch.inf)
    share = torch.full_like(best, 0.5)
    for _ in range(iterations):
        _, gradient = _u_and_gradient(nearest, centers, weights)
        normal = torch.nn.functional.normalize(gradient, dim=1)
        away = points - nearest
        slide = away - (away * normal).sum(1, keepdim=True) * normal
        trial = _settled_on_surface(nearest + share[:, None] * slide, centers, weights, 3)
        there = (points - trial).norm(dim=1)
        better = there < best
        nearest, best = torch.where(better[:, None], trial, nearest), torch.where(better, there, best)
        share = torch.where(better, (1.5 * share).clamp(max=1.0), 0.4 * share)
    return nearest, best


def _start_by_rays(points: Points, centers: Centers, weights: Weights) -> Points:
    """Return crossings of rays to the nearest control sphere, or from inside of the shortest way out."""
    nearest = ((points[:, None] - centers).norm(dim=2) - weights.sqrt()).argmin(1)
    toward = centers[nearest] - points
    inside = torch.nonzero(contains(points, centers, weights)).flatten()
    if len(inside):
        signs = torch.cartesian_prod(*[torch.tensor([-1.0, 0.0, 1.0])] * 3).to(points)
        ways = signs[(signs.abs().sum(1) == 1) | (signs.abs().sum(1) == 3)]
        lengths = torch.stack(
            [first_hits(points[inside], way.expand(len(inside), 3), centers, weights) for way in ways], 1
        )
        toward[inside] = ways[lengths.argmin(1)]
    t = first_hits(points, toward, centers, weights)
    return points + t.nan_to_num(posinf=0.0)[:, None] * torch.nn.functional.normalize(toward, dim=1)


def first_hits(
    origins: Points,
    directions: Points,
    centers: Centers,
    weights: Weights,
    *,
    shortest_chord: float = 1e-4,
    most_steps: int = 2000,
) -> Float[torch.Tensor, "m"]:
    """Return how far along each ray the surface is first crossed; infinity for a miss.

    Parameters
    ----------
    origins, directions : tensors of shape (m, 3)
        Directions need not have length 1.
    centers, weights : tensors of shapes (n, 3), (n,)
    shortest_chord : float
        As in :func:`mbstudio.core.metaball.rays.first_hits`, whose bounds it uses; coarser here,
        because single precision knows no better.
    most_steps : int
        Rays that have not been decided after so many steps count as missed.

    Notes
    -----
    Differentiable with respect to origins, directions and control points.
    """
    unit = torch.nn.functional.normalize(directions, dim=1)
    with torch.no_grad():
        t = torch.cat(
            _in_chunks(
                lambda rows: _march(rows[:, :3], rows[:, 3:], centers, weights, shortest_chord, most_steps),
                torch.cat([origins, unit], 1),
                max(1, len(weights) // 8),  # small chunks would wait for their slowest ray
            )
        )
    struck = t.isfinite()
    at = origins + torch.where(struck, t, 0.0)[:, None] * unit
    u, gradient = _u_and_gradient(at, centers, weights)
    slope = (gradient.detach() * unit.detach()).sum(1)
    # One more Newton step, whose value is nothing and whose derivative is the implicit function's.
    return torch.where(struck, t - torch.where(struck, (u - u.detach()) / slope, 0.0), t)


def _march(
    origins: Points,
    unit: Points,
    centers: Centers,
    weights: Weights,
    shortest_chord: float,
    most_steps: int,
) -> Float[torch.Tensor, "m"]:
    """March all rays by steps over which a bound of f proves that none crosses."""
    reach = weights.sum().sqrt()
    diagonal = (centers.max(0).values - centers.min(0).values).norm() + 2.0 * reach
    shortest = shortest_chord * diagonal
    # From the point of the ray where it comes near the ball that holds the solid.
    middle = 0.5 * (centers.max(0).values + centers.min(0).values)
    start = (((middle - origins) * unit).sum(1) - 0.5 * diagonal - reach).clamp(min=0.0)
    from_start = centers - (origins + start[:, None] * unit)[:, None]
    places = (from_start * unit[:, None]).sum(2)
    squares = (from_start - places[:, :, None] * unit[:, None]).square().sum(2).clamp(min=1e-30)
    end = places.max(1).values + reach
    result, t = torch.full_like(start, torch.inf), torch.zeros_like(start)
    longest = torch.full_like(start, torch.inf)
    left = torch.nonzero(end > 0).flatten()
    for _ in range(most_steps):
        if not len(left):
            break
        here, p, s = t[left], places[left], squares[left]
        away = here[:, None] - p
        inverse = (away.square() + s).reciprocal()
        terms = weights * inverse
        f = terms.sum(1)
        inside = f >= 1.0
        toward = torch.where(inside[:, None], away, -away).clamp(min=0.0)
        slope = 2.0 * (terms * inverse * toward).sum(1)
        step = (1.96 * (f.pow(1.5) - f).abs() / slope).nan_to_num(nan=0.0, posinf=torch.inf)
        step = torch.minimum(step, torch.minimum(longest[left], end[left] - here)).clamp(min=shortest)
        proven = _bound_holds(here, step, inside, p, s, weights)
        longest[left] = torch.where(proven, 4.0 * step, 0.5 * step)
        beyond = here + step
        crosses = ~proven & (step <= shortest) & ((_on_ray(beyond, p, s, weights) >= 1.0) != inside)
        if bool(crosses.any()):
            rows = left[crosses]
            result[rows] = start[rows] + _bisected(
                here[crosses], beyond[crosses], inside[crosses], p[crosses], s[crosses], weights
            )
        # A longer step that is not proven is not made: the next round tries its half.
        t[left] = torch.where(proven | (step <= shortest), beyond, here)
        left = left[~crosses & (t[left] < end[left])]
    return result


def _on_ray(
    t: torch.Tensor, places: torch.Tensor, squares: torch.Tensor, weights: torch.Tensor
) -> torch.Tensor:
    return (weights / ((t[:, None] - places).square() + squares)).sum(1)


def _bound_holds(
    t: torch.Tensor,
    step: torch.Tensor,
    inside: torch.Tensor,
    places: torch.Tensor,
    squares: torch.Tensor,
    weights: torch.Tensor,
) -> Bool[torch.Tensor, "m"]:
    """Return whether each ray surely stays on its side from t to t + step."""
    before, behind = t[:, None] - places, (t + step)[:, None] - places
    least = torch.maximum(before, -behind).clamp(min=0.0)
    most = torch.maximum(before.abs(), behind.abs())
    bound = (weights / (torch.where(inside[:, None], most, least).square() + squares)).sum(1)
    return torch.where(inside, bound >= 1.0, bound < 1.0)


def _bisected(
    low: torch.Tensor,
    high: torch.Tensor,
    inside: torch.Tensor,
    places: torch.Tensor,
    squares: torch.Tensor,
    weights: torch.Tensor,
) -> torch.Tensor:
    """Return where f = 1 between ends that differ: Newton on u, bisection as guard."""
    t = 0.5 * (low + high)
    for _ in range(24):
        away = t[:, None] - places
        inverse = (away.square() + squares).reciprocal()
        terms = weights * inverse
        f, slope = terms.sum(1), -2.0 * (terms * inverse * away).sum(1)
        same = (f >= 1.0) == inside
        low, high = torch.where(same, t, low), torch.where(same, high, t)
        following = t + 2.0 * (f - f.pow(1.5)) / slope
        within = (following > low) & (following < high)
        t = torch.where(within, following, 0.5 * (low + high))
    return t
