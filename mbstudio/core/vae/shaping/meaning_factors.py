"""The factors that the meaning directions of the latent space are named after."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core import formulas
from mbstudio.core.compiled import compiled
from mbstudio.core.metrics.factor_table import LATENT_MEANINGS
from mbstudio.core.metrics.star_factors import star_directions
from mbstudio.core.vae.models.radii import directions, log_radii, outermost_radii
from mbstudio.core.vae.serialize.serialization import Serialization

MEANINGS = tuple(LATENT_MEANINGS)
"""ln D_n; intermediate over longest axis; Corey shape factor; sphericity; fine roughness."""
COARSEST = 5
"""Degree of the coarsest spherical harmonics that count as roughness."""
_LEAST = 1e-2
"""Least r**-2 of the ellipsoid fitted to a body, over that of the mean radius."""


def meaning_factors(avatars: Serialization) -> Float64[np.ndarray, "avatars 5"]:
    """Return the factors of `MEANINGS` of serialized avatars, by rays from their centres.

    Returns
    -------
    float array, shape (avatars, 5)
        ln of D_n in the unit of the avatars; I / L and CSF, both of the ellipsoid of equal inertia,
        whose axes change smoothly with the body as those of the smallest box do not; Wadell's
        sphericity; and the roughness of :func:`roughness`.
    """
    along, faces = star_directions()
    radii = outermost_radii(avatars.centers, avatars.log_weights, along)
    out = np.empty((len(avatars), len(MEANINGS)))
    out[:, 4] = roughness(avatars)
    full_volume, full_area = share_of_sphere()
    for i in range(len(avatars)):
        volume, area, moments = _integrals(along * radii[i][:, None], faces)
        volume, area = volume / full_volume, area / full_area
        diameter = formulas.nominal_diameters(volume)
        # Of a solid ellipsoid the second moment along an axis is V a**2 / 5.
        short, middle, long = np.sqrt(np.maximum(np.linalg.eigvalsh(moments), 1e-300))
        out[i, :4] = (
            np.log(diameter * avatars.diameters[i]),
            formulas.elongation_ratio(middle, long),
            formulas.corey_shape_factor(short, middle, long),
            formulas.sphericity_of_diameter(diameter, area),
        )
    return out


def roughness(avatars: Serialization) -> Float64[np.ndarray, " avatars"]:
    """Return the rms of what is finer than form in ln r: beyond an ellipsoid and harmonics up to degree 4.

    Form, roundness and texture are matters of scale (Barrett 1980). What is coarser than degree 5 tells on
    sphericity too, so that grains can be rougher at the same form and sphericity.
    """
    rms: np.ndarray = np.sqrt(np.square(departures(log_radii(avatars))).mean(axis=1))
    return rms


def departures(logs: Float[np.ndarray, "avatars 144"]) -> Float64[np.ndarray, "avatars 144"]:
    """Return what of ln r neither the nearest ellipsoid nor harmonics up to degree `COARSEST` - 1 take up.

    Parameters
    ----------
    logs : float array, shape (avatars, 144)
        ln r in the directions of :func:`~mbstudio.core.vae.models.radii.directions`.

    Notes
    -----
    The ellipsoid is found by least squares on r**-2, a quadratic form of the direction; terms of odd order
    take up that its centre may lie beside the origin. What is left of an elongated body by harmonics alone
    would tell its form: ln r of an ellipsoid has all even degrees.
    """
    terms, coarse = _ellipsoid_terms(), _coarse_terms()
    level = logs - logs.mean(axis=1, keepdims=True)
    fitted = np.maximum(np.exp(-2.0 * level) @ terms @ terms.T, _LEAST)
    left = level + 0.5 * np.log(fitted)
    return np.asarray(left - left @ coarse @ coarse.T)


def departures_back(
    logs: Float[np.ndarray, "avatars 144"], slopes: Float[np.ndarray, "avatars 144"]
) -> Float64[np.ndarray, "avatars 144"]:
    """Return derivatives by ln r of something whose derivatives by :func:`departures` are `slopes`."""
    terms, coarse = _ellipsoid_terms(), _coarse_terms()
    slopes = slopes - slopes @ coarse @ coarse.T
    form = np.exp(-2.0 * (logs - logs.mean(axis=1, keepdims=True)))
    fitted = form @ terms @ terms.T
    through = np.where(fitted > _LEAST, 0.5 * slopes / np.maximum(fitted, _LEAST), 0.0)
    slopes = slopes - 2.0 * form * (through @ terms @ terms.T)
    return np.asarray(slopes - slopes.mean(axis=1, keepdims=True))


@cache
def _ellipsoid_terms() -> Float64[np.ndarray, "144 9"]:
    """Return an orthonormal basis of what an ellipsoid's r**-2 consists of."""
    x, y, z = directions().T
    terms = np.stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z], axis=1)
    basis: Float64[np.ndarray, "144 9"] = np.linalg.qr(terms)[0]
    return basis


@cache
def _coarse_terms() -> Float64[np.ndarray, "144 terms"]:
    """Return an orthonormal basis of the harmonics below degree `COARSEST`: polynomials on the sphere."""
    x, y, z = directions().T
    most = COARSEST - 1
    # On the sphere all monomials of the two highest orders span those of the lower ones too.
    powers = [(i, j, order - i - j) for order in (most - 1, most)
              for i in range(order + 1) for j in range(order + 1 - i)]  # fmt: skip
    basis: Float64[np.ndarray, "144 terms"] = np.linalg.qr(
        np.stack([x**i * y**j * z**k for i, j, k in powers], axis=1)
    )[0]
    return basis


@cache
def share_of_sphere() -> tuple[float, float]:
    """Return volume and area of the star's mesh of a sphere over those of the sphere."""
    along, faces = star_directions()
    volume, area, _ = _integrals(along, faces)
    return volume / (4.0 * np.pi / 3.0), area / (4.0 * np.pi)


@compiled()
def _integrals(points: np.ndarray, faces: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Return volume, area and central second moments of a closed mesh."""
    volume = area = 0.0
    first, second = np.zeros(3), np.zeros((3, 3))
    for f in range(len(faces)):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area += 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
        part = (a[0] * nx + a[1] * ny + a[2] * nz) / 6.0
        volume += part
        for i in range(3):
            total = a[i] + b[i] + c[i]
            first[i] += part * total / 4.0
            for j in range(3):
                other = a[j] + b[j] + c[j]
                second[i, j] += part / 20.0 * (total * other + a[i] * a[j] + b[i] * b[j] + c[i] * c[j])
    moments = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            moments[i, j] = second[i, j] / volume - first[i] * first[j] / volume**2
    return volume, area, moments
