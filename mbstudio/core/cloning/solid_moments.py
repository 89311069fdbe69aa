"""Volume, centre and second moments of closed surfaces, and the frame in which all directions are alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int

Points = Float[np.ndarray, "v 3"]
Faces = Int[np.ndarray, "f 3"]

UNIT_BALL_MOMENT = 0.2
"""Mean square coordinate of the solid ball of radius 1."""


class SolidMoments(NamedTuple):
    """Moments of the solid within a closed surface.

    Attributes
    ----------
    volume : float
        Negative where the surface is wound inwards.
    centre : float array, shape (3,)
        Of volume.
    second : float array, shape (3, 3)
        Mean of (x - centre)(x - centre)^T over the solid.
    """

    volume: float
    centre: Float64[np.ndarray, " 3"]
    second: Float64[np.ndarray, "3 3"]


def solid_moments(vertices: Points, faces: Faces) -> SolidMoments:
    """Return the moments of the solid within a closed surface, exact for its triangles.

    Signed tetrahedra towards the mean vertex (Lien & Kajiya 1984).
    """
    origin = vertices.mean(axis=0)
    a, b, c = (vertices[faces[:, corner]] - origin for corner in range(3))
    six = np.einsum("fi,fi->f", a, np.cross(b, c))
    volume = float(six.sum()) / 6.0
    total = a + b + c
    first = six @ total / 24.0 / volume
    second = sum((part * six[:, None]).T @ part for part in (a, b, c, total)) / 120.0 / volume
    return SolidMoments(volume, origin + first, second - np.outer(first, first))


def principal_form(moments: SolidMoments) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]]:
    """Return the semi-axes of the ellipsoid with these second moments, longest first, and their directions.

    Returns
    -------
    semi_axes : float array, shape (3,)
    axes : float array, shape (3, 3)
        Directions as columns, right-handed.
    """
    squares, axes = np.linalg.eigh(moments.second)
    axes = axes[:, ::-1]
    if np.linalg.det(axes) < 0:
        axes = axes * np.array([1.0, 1.0, -1.0])
    return np.sqrt(squares[::-1] / UNIT_BALL_MOMENT), axes


def make_isotropic(
    vertices: Points, faces: Faces
) -> tuple[Float64[np.ndarray, "v 3"], Float64[np.ndarray, "3 3"]]:
    """Return a surface with the second moments of the unit ball, and the symmetric matrix that made it so."""
    moments = solid_moments(vertices, faces)
    squares, axes = np.linalg.eigh(moments.second)
    matrix: np.ndarray = (axes / np.sqrt(squares / UNIT_BALL_MOMENT)) @ axes.T
    return (vertices - moments.centre) @ matrix, matrix
