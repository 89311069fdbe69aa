"""Symmetric templates of any number of control points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.errors import SerializationError
from mbstudio.core.vae.serialize.serialization import FLIPS, Template

WEIGHT_SCALE, PLACE_SCALE = 0.5, 0.1
"""Changes of ln k, and of a place in D_n, that count alike."""
_SOFTEST = 0.1  # of the mean variance: what a direction is given in which nothing varies
_LEAST_VARIANCE = 1e-8
_CANDIDATES = 6000
_LLOYD_ROUNDS = 12


def orbit_kinds(n: int) -> tuple[int, ...]:
    """Return the sizes of the orbits that `n` control points form, the largest first.

    A point off all mirror planes is one of 8; on one plane, of 4; on an axis, of 2; the centre is
    alone. So any n is a sum of eights and at most one each of 4, 2 and 1.

    Raises
    ------
    SerializationError
        If `n` is not a whole number from 1.
    """
    if int(n) != n or n < 1:
        raise SerializationError(f"n = {n} is not possible: n must be a whole number, 1 or more.")
    eights, rest = divmod(int(n), 8)
    return (8,) * eights + tuple(size for size in (4, 2, 1) if rest & size)


def _free_axes(size: int) -> np.ndarray:
    """Return which coordinates of an orbit's generator are free: planes and axes of most extent first."""
    return np.arange(3) < {8: 3, 4: 2, 2: 1, 1: 0}[size]


def exchange_table(kinds: tuple[int, ...]) -> Int[np.ndarray, "8 n"]:
    """Return, for each flip of `FLIPS`, which control point takes each place.

    Within an orbit of 8 the points stand in the order of `FLIPS`; one of 4 has the first four, one
    of 2 the first two of them.
    """
    rows, start = [], 0
    for size in kinds:
        # Bit b of a place in the orbit is the sign of coordinate b, so a flip turns these bits.
        rows.append(start + (np.arange(size)[None] ^ (np.arange(8)[:, None] & (size - 1))))
        start += size
    return np.concatenate(rows, axis=1)


def spread_orbits(
    generators: Float[np.ndarray, "orbits 3"], kinds: tuple[int, ...]
) -> Float[np.ndarray, "n 3"]:
    """Return the control points of all orbits from one generator each, in the octant where x, y, z >= 0."""
    return np.concatenate(
        [
            np.where(_free_axes(size), generator, 0.0) * FLIPS[:size]
            for generator, size in zip(generators, kinds, strict=True)
        ]
    )


def symmetric_mean(centers: Float[np.ndarray, "m n 3"], log_weights: Float[np.ndarray, "m n"]) -> Template:
    """Return the template that is the mean of serialized avatars and of all their flips.

    Parameters
    ----------
    centers : float array, shape (m, n, 3)
        In D_n, in the order of the template that they were fitted from.
    log_weights : float array, shape (m, n)
    """
    kinds = orbit_kinds(centers.shape[1])
    exchange = exchange_table(kinds)
    middle, weight = centers.mean(axis=0), log_weights.mean(axis=0)
    places = np.mean([middle[row] * signs for row, signs in zip(exchange, FLIPS, strict=True)], axis=0)
    # Rounding must not break the symmetry: every orbit follows its first point.
    starts = np.concatenate([[0], np.cumsum(kinds)[:-1]])
    mean_weight = weight[exchange].mean(axis=0)
    return Template(spread_orbits(places[starts], kinds), np.repeat(mean_weight[starts], kinds), exchange)


def learn_template(centers: Float[np.ndarray, "m n 3"], log_weights: Float[np.ndarray, "m n"]) -> Template:
    """Return the symmetric mean of serialized avatars, stiff where they and their flips vary little.

    The stiffness is the inverse of their covariance, to which a tenth of the mean variance is added,
    and is scaled so that on average it weighs their changes as much as equal stiffness would.

    Parameters
    ----------
    centers : float array, shape (m, n, 3)
    log_weights : float array, shape (m, n)
    """
    mean = symmetric_mean(centers, log_weights)
    changes = np.concatenate(
        [
            np.concatenate(
                [
                    (log_weights[:, row] - mean.log_weights) / WEIGHT_SCALE,
                    *((centers[:, row] * signs - mean.centers) / PLACE_SCALE).transpose(2, 0, 1),
                ],
                axis=1,
            )
            for row, signs in zip(mean.exchange, FLIPS, strict=True)
        ]
    )
    covariance = changes.T @ changes / len(changes)
    variance = float(np.trace(covariance)) / len(covariance)
    if not variance > _LEAST_VARIANCE:
        return mean
    stiffness = np.linalg.inv(covariance / variance + _SOFTEST * np.eye(len(covariance)))
    stiffness *= len(covariance) * variance / float((stiffness * covariance).sum())
    return replace(mean, stiffness=0.5 * (stiffness + stiffness.T))


def spread_template(n: int, radii: Float[np.ndarray, " d"], directions: Float[np.ndarray, "d 3"]) -> Template:
    """Return `n` symmetric control points spread through a star-shaped body, of equal weights.

    Parameters
    ----------
    n : int
    radii : float array, shape (d,)
        Radius of the body in D_n along each direction.
    directions : float array, shape (d, 3)
        Unit vectors in the octant where x, y, z >= 0, evenly spread.

    Notes
    -----
    Lloyd's iteration in one octant, in which a place belongs to the nearest point among the
    generators and their mirror images; the points then stand in a layer below the surface, where
    each has the most to say about it. The weights are scaled so that ln f is 0 on average over
    the surface.
    """
    kinds = orbit_kinds(n)
    rng = np.random.default_rng(n)
    # Only the outer half, by radius: control points near the centre hardly shape the surface.
    chosen = rng.integers(len(radii), size=_CANDIDATES)
    depth = np.cbrt(rng.uniform(0.35**3, 0.85**3, _CANDIDATES))
    places = directions[chosen] * (radii[chosen] * depth)[:, None]
    free = np.array([_free_axes(size) for size in kinds])
    generators = _start_far_apart(places, free)
    for _ in range(_LLOYD_ROUNDS):
        owner = _squared_distances(places, generators, kinds).argmin(axis=1)
        for i in range(len(kinds)):
            own = places[owner == i]
            if len(own):
                generators[i] = np.where(free[i], own.mean(axis=0), 0.0)
    centers = spread_orbits(generators, kinds)
    surface = directions * radii[:, None]
    field = (1.0 / ((surface[:, None] - centers[None]) ** 2).sum(axis=2)).sum(axis=1)
    weight = -float(np.mean(np.log(field)))
    return Template(centers, np.full(n, weight), exchange_table(kinds))


def _squared_distances(
    places: np.ndarray, generators: np.ndarray, kinds: tuple[int, ...]
) -> Float[np.ndarray, "p orbits"]:
    """Return the squared distance of places to the nearest point of each orbit."""
    return np.stack(
        [
            ((places[:, None] - np.where(_free_axes(size), one, 0.0) * FLIPS[:size]) ** 2)
            .sum(axis=2)
            .min(axis=1)
            for one, size in zip(generators, kinds, strict=True)
        ],
        axis=1,
    )


def _start_far_apart(places: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return a start for Lloyd's iteration: each generator as far as can be from those before it."""
    generators = np.zeros((len(free), 3))
    nearest = np.full(len(places), np.inf)
    for i, axes in enumerate(free):
        if not axes.any():
            continue  # the centre
        held = np.where(axes, places, 0.0)
        score = np.minimum(nearest, 0.5 * (held[:, axes] ** 2).sum(axis=1))
        generators[i] = held[score.argmax()] if i else held[(held**2).sum(axis=1).argmax()]
        nearest = np.minimum(nearest, ((places - generators[i]) ** 2).sum(axis=1))
    return generators
