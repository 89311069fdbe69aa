"""How far a surface reaches in each direction, and how that is spread over spherical harmonics."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.compiled import compiled
from mbstudio.core.metrics.harmonics import real_harmonics

HIGHEST = 20
_RINGS = 40
"""Of the Gauss-Legendre grid: exact for products of harmonics up to degree 39."""


def outer_radii(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    directions: Float[np.ndarray, "d 3"],
) -> Float64[np.ndarray, " d"]:
    """Return the distance from the origin of the outermost place of a surface in each direction.

    0 where a ray meets no triangle: only where the origin lies outside the body.
    """
    order = np.argsort(directions[:, 2], kind="stable")
    found = np.zeros(len(directions))
    radii = np.empty(len(directions))
    _outermost(
        np.ascontiguousarray(vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int64),
        np.ascontiguousarray(directions[order]), found,
    )  # fmt: skip
    radii[order] = found
    return radii


@cache
def quadrature() -> tuple[Float64[np.ndarray, "d 3"], Float64[np.ndarray, "k d"]]:
    """Return directions, and the matrix that takes radii in them to coefficients of harmonics by degree."""
    heights, shares = np.polynomial.legendre.leggauss(_RINGS)
    azimuths = (np.arange(2 * _RINGS) + 0.5) * np.pi / _RINGS
    across = np.sqrt(1 - heights**2)
    directions = np.stack([
        np.outer(across, np.cos(azimuths)), np.outer(across, np.sin(azimuths)),
        np.repeat(heights[:, None], len(azimuths), axis=1),
    ], axis=-1).reshape(-1, 3)  # fmt: skip
    weights = np.repeat(shares * np.pi / _RINGS, len(azimuths))
    return directions, real_harmonics(directions, HIGHEST) * weights


def band_amplitudes(radii: Float[np.ndarray, " d"]) -> Float64[np.ndarray, " l"]:
    """Return the root mean square over the sphere of each degree 0 to 20 of radii in :func:`quadrature`.

    It does not depend on the pose.
    """
    coefficients = quadrature()[1] @ radii
    degree = np.floor(np.sqrt(np.arange(len(coefficients)) + 0.5)).astype(int)
    amplitudes: np.ndarray = np.sqrt(np.bincount(degree, weights=coefficients**2) / (4 * np.pi))
    return amplitudes


@compiled(error_model="numpy")
def _outermost(vertices: np.ndarray, faces: np.ndarray, along: np.ndarray, radii: np.ndarray) -> None:
    heights = along[:, 2].copy()
    for face in range(faces.shape[0]):
        a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
        ab = np.cross(a, b)
        bc = np.cross(b, c)
        ca = np.cross(c, a)
        nx, ny, nz = ab[0] + bc[0] + ca[0], ab[1] + bc[1] + ca[1], ab[2] + bc[2] + ca[2]
        volume = a[0] * bc[0] + a[1] * bc[1] + a[2] * bc[2]
        if volume == 0.0:
            continue
        # The triangle's cone lies in the cap about its middle that holds the three corners.
        la, lb, lc = np.sqrt((a * a).sum()), np.sqrt((b * b).sum()), np.sqrt((c * c).sum())
        middle = a / la + b / lb + c / lc
        middle /= np.sqrt((middle * middle).sum())
        cosine = min((middle * a).sum() / la, (middle * b).sum() / lb, (middle * c).sum() / lc)
        first, last = 0, len(heights)
        if cosine > 0.1:
            reach = np.arccos(min(cosine, 1.0)) + 1e-9
            polar = np.arccos(min(max(middle[2], -1.0), 1.0))
            first = np.searchsorted(heights, np.cos(min(polar + reach, np.pi)) - 1e-12)
            last = np.searchsorted(heights, np.cos(max(polar - reach, 0.0)) + 1e-12)
        for d in range(first, last):
            x, y, z = along[d, 0], along[d, 1], along[d, 2]
            if cosine > 0.1 and x * middle[0] + y * middle[1] + z * middle[2] < cosine - 1e-9:
                continue
            u = x * ab[0] + y * ab[1] + z * ab[2]
            v = x * bc[0] + y * bc[1] + z * bc[2]
            w = x * ca[0] + y * ca[1] + z * ca[2]
            if (u >= 0 and v >= 0 and w >= 0) if volume > 0 else (u <= 0 and v <= 0 and w <= 0):
                slope = x * nx + y * ny + z * nz
                if slope != 0.0:
                    radii[d] = max(radii[d], volume / slope)
