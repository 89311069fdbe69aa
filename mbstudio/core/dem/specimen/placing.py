"""Where particles start: apart from each other above a floor, turned at random."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

_TRIES = 8
_ROUNDS = 12
_GROWTH = 1.1


def random_quaternions(count: int, rng: np.random.Generator) -> Float[np.ndarray, "count 4"]:
    """Return unit quaternions (w, x, y, z), uniform over all rotations.

    Source: Shoemake (1992), Uniform random rotations, Graphics Gems III.
    """
    vectors = rng.normal(size=(count, 4))
    units: np.ndarray = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return units


def rotations_of(quaternions: Float[np.ndarray, "count 4"]) -> Float[np.ndarray, "count 3 3"]:
    """Return the matrices of quaternions (w, x, y, z)."""
    matrices: np.ndarray = Rotation.from_quat(np.asarray(quaternions)[:, [1, 2, 3, 0]]).as_matrix()
    return matrices


def lattice(count: int, half: float, low: float, reach: float) -> Float[np.ndarray, "count 3"]:
    """Return places for spheres of one radius, layer by layer, none touching another or a wall.

    Parameters
    ----------
    count : int
    half : float
        Half the width of the box, which stands around the z axis; at least the radius.
    low : float
        Height of the lowest centres.
    reach : float
        Radius of the spheres.
    """
    side = max(1, int((2 * half) // (2.1 * reach)))
    pitch = 2 * half / side
    rows = np.arange(count)
    across, along, layer = rows % side, rows // side % side, rows // side**2
    return np.column_stack(
        [(across + 0.5) * pitch - half, (along + 0.5) * pitch - half, low + layer * 2.1 * reach]
    )


def scattered(
    radii: Float[np.ndarray, " count"], half: float, low: float, filling: float, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "count 3"], float]:
    """Return random places for spheres of any radii, none touching another or a wall, and the height needed.

    The largest are placed first; where there is no room left the box grows upwards.

    Parameters
    ----------
    radii : float array, shape (count,)
        Positive, at most `half`.
    half : float
        Half the width of the box, which stands around the z axis.
    low : float
        Height of the box's lower end.
    filling : float
        Share of the box that the spheres fill at first, 0 to 1.
    rng : numpy Generator

    Returns
    -------
    centers : float array, shape (count, 3)
    top : float
        Height of the box's upper end.
    """
    height = float((4 / 3 * np.pi * radii**3).sum() / (filling * (2 * half) ** 2))
    height = max(height, 2.2 * float(radii.max()))
    order = np.argsort(-radii, kind="stable")
    centers = np.empty((len(radii), 3))
    placed = np.empty((len(radii), 4))
    for count, index in enumerate(order):
        radius = radii[index]
        place = None
        while place is None:
            room = np.array([half, half, height / 2]) - radius
            place = _free_place(room, low + height / 2, radius, placed[:count], rng)
            height *= _GROWTH if place is None else 1.0
        centers[index] = place
        placed[count] = *place, radius
    return centers, low + height


def _free_place(
    room: Float[np.ndarray, " 3"],
    middle: float,
    radius: float,
    placed: Float[np.ndarray, "m 4"],
    rng: np.random.Generator,
) -> Float[np.ndarray, " 3"] | None:
    """Return a random place that touches none of the spheres placed (x, y, z, r); None if none is found."""
    for _ in range(_ROUNDS):
        tries = rng.uniform(-1, 1, (_TRIES, 3)) * room + [0.0, 0.0, middle]
        squares = sum((tries[:, axis, None] - placed[None, :, axis]) ** 2 for axis in range(3))
        free = np.flatnonzero((squares > (placed[None, :, 3] + radius) ** 2).all(axis=1))
        if len(free):
            place: np.ndarray = tries[free[0]]
            return place
    return None
