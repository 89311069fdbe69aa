"""Radii of avatars in fixed directions: their shape, whatever the order of the control points."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.compiled import compiled
from mbstudio.core.metaball.rays import crossing_along
from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization

_IN_OCTANT = 18
SMALLEST_RADIUS = 0.02
"""What stands for the radius along a ray that meets no solid, in the unit of the centers."""


@cache
def directions(in_octant: int = _IN_OCTANT) -> Float64[np.ndarray, "directions 3"]:
    """Return unit directions, even over the sphere and closed under the flips of the principal axes.

    Parameters
    ----------
    in_octant : int
        Directions in one octant; those of octant f follow at rows ``f * in_octant``, each the flip f of
        one in the first.

    Returns
    -------
    float array, shape (8 * in_octant, 3)
        Read-only.

    Notes
    -----
    Equal areas in z and golden steps in longitude (a Fibonacci lattice) on an eighth of the sphere.
    """
    place = np.arange(in_octant)
    z = (place + 0.5) / in_octant
    longitude = 0.5 * np.pi * np.mod((place + 0.5) * (np.sqrt(5) - 1) / 2, 1.0)
    across = np.sqrt(1 - z**2)
    first = np.stack([across * np.cos(longitude), across * np.sin(longitude), z], axis=1)
    every = (first[None] * FLIPS[:, None]).reshape(-1, 3)
    every.flags.writeable = False
    return every


@cache
def direction_exchange(in_octant: int = _IN_OCTANT) -> Int[np.ndarray, "8 directions"]:
    """Return, in row f, which direction's radius takes each direction's place after flip f."""
    octant, place = np.divmod(np.arange(8 * in_octant), in_octant)
    table = (octant[None] ^ np.arange(8)[:, None]) * in_octant + place
    table.flags.writeable = False
    return table


@compiled(error_model="numpy")
def _outermost(control: np.ndarray, along: np.ndarray, out: np.ndarray) -> None:
    places, squares = np.empty(control.shape[2]), np.empty(control.shape[2])
    start = np.empty(3)
    for a in range(control.shape[0]):
        body = control[a]
        reach = 0.0
        for i in range(body.shape[1]):
            reach = max(reach, np.sqrt(body[0, i] ** 2 + body[1, i] ** 2 + body[2, i] ** 2))
        reach = 1.01 * (reach + np.sqrt(body[3].sum()))
        for d in range(len(along)):
            start[:] = reach * along[d]
            way = crossing_along(start, -along[d], reach, 1e-4 * reach, body, places, squares)
            out[a, d] = reach - way if way < reach else 0.0


def outermost_radii(
    centers: Float[np.ndarray, "avatars n 3"],
    log_weights: Float[np.ndarray, "avatars n"],
    along: Float[np.ndarray, "directions 3"] | None = None,
) -> Float64[np.ndarray, "avatars directions"]:
    """Return how far from the origin each avatar reaches in each direction.

    Parameters
    ----------
    centers : float array, shape (avatars, n, 3)
    log_weights : float array, shape (avatars, n)
    along : float array, shape (directions, 3), optional
        Unit directions; by default the 144 of :func:`directions`.

    Returns
    -------
    float array, shape (avatars, directions)
        In the unit of the centers; where a ray from the origin meets no solid, 0.02 of it, so that its
        logarithm exists.
    """
    along = directions() if along is None else np.ascontiguousarray(along, dtype=np.float64)
    control = np.empty((len(centers), 4, log_weights.shape[1]))
    control[:, :3] = np.asarray(centers).transpose(0, 2, 1)
    control[:, 3] = np.exp(log_weights)
    out = np.empty((len(control), len(along)))
    _outermost(control, along, out)
    return np.maximum(out, SMALLEST_RADIUS)


def log_radii(avatars: Serialization) -> Float64[np.ndarray, "avatars 144"]:
    """Return ln r, r in D_n, of each avatar in the 144 directions."""
    logs: np.ndarray = np.log(outermost_radii(avatars.centers, avatars.log_weights))
    return logs


def surface_rms(
    avatars: Serialization, others: Serialization, *, in_octant: int = 72
) -> Float64[np.ndarray, " avatars"]:
    """Return the root mean square distance of two surfaces each over directions from the centroid, in D_n.

    Parameters
    ----------
    avatars, others : Serialization
        As many of each.
    in_octant : int
        Directions in one octant.

    Notes
    -----
    Of two points in one direction the nearer surface is about ``|dr| cos`` away, with the angle between
    direction and normal; the field's gradient at the first surface gives it.
    """
    along = directions(in_octant)
    theirs = outermost_radii(others.centers, others.log_weights, along)
    ours = outermost_radii(avatars.centers, avatars.log_weights, along)
    square = np.empty(len(avatars))
    for i in range(len(avatars)):
        points = ours[i][:, None] * along
        away = points[:, None] - avatars.centers[i]
        slopes = np.exp(avatars.log_weights[i]) / np.square(np.einsum("dnx,dnx->dn", away, away))
        gradient = np.einsum("dn,dnx->dx", slopes, away)
        cosine = np.abs(np.einsum("dx,dx->d", gradient, along)) / np.linalg.norm(gradient, axis=1)
        square[i] = np.mean(np.square((ours[i] - theirs[i]) * cosine))
    return np.sqrt(square)


def novelty_distances(
    clones: Float[np.ndarray, "clones 144"], parents: Float[np.ndarray, "parents 144"]
) -> Float64[np.ndarray, "clones parents"]:
    """Return the distance of each clone to each parent, over its eight flips the smallest.

    Parameters
    ----------
    clones, parents : float array, shape (bodies, 144)
        Of :func:`log_radii`.

    Returns
    -------
    float array, shape (clones, parents)
        Root mean square difference of ln r.
    """
    nearest = np.full((len(clones), len(parents)), np.inf)
    for exchange in direction_exchange():
        other = parents[:, exchange]
        square = np.square(clones).sum(1)[:, None] + np.square(other).sum(1)[None] - 2.0 * clones @ other.T
        np.minimum(nearest, square, out=nearest)
    distances: np.ndarray = np.sqrt(np.maximum(nearest, 0.0) / clones.shape[1])
    return distances
