"""How a star-shaped body's radius is spread over the bands of spherical harmonics."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.metrics.factor_table import BANDS
from mbstudio.core.metrics.surfaces import split_to_edges

_TURNED_AWAY = 2e-3
"""Of the sphere that may be covered by faces turned towards the centre: ripples of a rough surface."""


def band_energies(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    centre: Float[np.ndarray, " 3"],
    bands: int = BANDS,
) -> Float[np.ndarray, " l"] | None:
    """Return the energy of each band of the radius function, over that of the mean radius.

    With r(n) = sum c_lm Y_lm(n) about the centre, E_l = sum over m of c_lm**2, over E_0. It does not depend
    on the pose; E_1 stems from the centre's place, E_2 from the form, higher bands from angularity.

    Parameters
    ----------
    vertices, faces
        A closed surface, outward.
    centre : float array, shape (3,)
        Centre of volume.
    bands : int
        Highest degree.

    Returns
    -------
    float array, shape (bands + 1,), or None
        E_0 = 1 first. None where the body is not star-shaped about its centre.

    References
    ----------
    Kazhdan, Funkhouser & Rusinkiewicz (2003), Rotation invariant spherical harmonic representation of 3D
    shape descriptors, Symposium on Geometry Processing; for grains: Zhou & Wang (2017), Generation of a
    realistic 3D sand assembly using X-ray micro-CT and spherical harmonic-based principal component
    analysis, Int. J. Numer. Anal. Methods Geomech. 41, 93-109.
    """
    corners = (vertices - centre)[faces]
    angles = solid_angles(corners)
    if -angles[angles < 0].sum() > _TURNED_AWAY * 4 * np.pi or abs(angles.sum() / (4 * np.pi) - 1) > 1e-6:
        return None
    # Small next to the finest harmonic, so that the value in the middle stands for the triangle.
    corners = split_to_edges(corners, 0.1 * float(np.linalg.norm(corners, axis=2).mean()))
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(middle, axis=1)
    values = real_harmonics(middle / radius[:, None], bands)
    coefficients = values @ (solid_angles(corners) * radius)
    degree = np.floor(np.sqrt(np.arange(len(coefficients)) + 0.5)).astype(int)
    energies = np.bincount(degree, weights=coefficients**2)
    shares: np.ndarray = energies / energies[0]
    return shares


def solid_angles(corners: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, " f"]:
    """Return the signed solid angle of each triangle seen from the origin (Van Oosterom & Strackee 1983)."""
    a, b, c = corners.transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    numerator = np.einsum("fi,fi->f", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("fi,fi->f", p, q) for p, q in ((a, b), (b, c), (c, a)))
    angles: np.ndarray = 2.0 * np.arctan2(numerator, la * lb * lc + ab * lc + bc * la + ca * lb)
    return angles


def real_harmonics(directions: Float[np.ndarray, "f 3"], bands: int) -> Float[np.ndarray, "k f"]:
    """Return the orthonormal real harmonics by degree, shape ((bands + 1)**2, f).

    By the stable recurrence of the normalised associated Legendre functions (Holmes & Featherstone 2002).
    """
    height = directions[:, 2]
    turn = directions[:, 0] + 1j * directions[:, 1]  # sin(polar) e^(i azimuth)
    rows: list[list[np.ndarray]] = [[] for _ in range(bands + 1)]
    diagonal = np.full(len(directions), np.sqrt(1 / (4 * np.pi)))
    rotation = np.ones(len(directions), dtype=complex)
    for order in range(bands + 1):
        if order:
            diagonal = diagonal * np.sqrt((2 * order + 1) / (2 * order))
            rotation = rotation * turn
        before, value = np.zeros_like(diagonal), diagonal
        for degree in range(order, bands + 1):
            if degree > order:
                a = np.sqrt((4 * degree**2 - 1) / (degree**2 - order**2))
                b = np.sqrt(((degree - 1) ** 2 - order**2) / (4 * (degree - 1) ** 2 - 1))
                before, value = value, a * (height * value - b * before)
            if order:
                rows[degree] += [np.sqrt(2.0) * value * part for part in (rotation.real, rotation.imag)]
            else:
                rows[degree].append(value)
    return np.concatenate([np.stack(group) for group in rows])
