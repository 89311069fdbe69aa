"""How the factors of the meanings change with every control point: exact derivatives of their integrals."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core import formulas
from mbstudio.core.compiled import compiled
from mbstudio.core.metrics.star_factors import star_directions
from mbstudio.core.vae.models.radii import SMALLEST_RADIUS, directions, outermost_radii
from mbstudio.core.vae.serialize.serialization import Serialization
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS, departures, departures_back, share_of_sphere


def factors_and_slopes(
    avatars: Serialization,
) -> tuple[Float64[np.ndarray, "avatars 5"], Float64[np.ndarray, "avatars 5 width"]]:
    """Return the factors of `MEANINGS` and their derivatives.

    Parameters
    ----------
    avatars : Serialization

    Returns
    -------
    factors : float array, shape (avatars, 5)
        Those of :func:`~mbstudio.core.vae.shaping.meaning_factors.meaning_factors`.
    slopes : float array, shape (avatars, 5, 4 n + 1)
        By the centers (x, y, z of the first point, of the second, ...), the ln k, and ln D_n.

    Notes
    -----
    A surface point at radius r along a direction moves by ``dr = -df / (df / dr)`` when the field there
    changes by df. Where a ray meets no solid the radius is fixed, and moves with nothing.
    """
    along, faces = star_directions()
    rays = directions()
    radii = outermost_radii(avatars.centers, avatars.log_weights, along)
    few = outermost_radii(avatars.centers, avatars.log_weights, rays)
    n = avatars.log_weights.shape[1]
    factors, slopes = np.empty((len(avatars), len(MEANINGS))), np.zeros((len(avatars), 5, 4 * n + 1))
    for i in range(len(avatars)):
        factors[i, :4], by_radii = _star_factors_and_slopes(radii[i], along, faces)
        factors[i, 0] += np.log(avatars.diameters[i])
        logs = np.log(few[i])[None]
        left = departures(logs)
        factors[i, 4] = rough = np.sqrt(np.square(left).mean())
        by_logs = departures_back(logs, left / (left.size * max(float(rough), 1e-300)))
        control = np.concatenate([avatars.centers[i].T, np.exp(avatars.log_weights[i])[None]])
        _by_points(control, along, radii[i], by_radii, slopes[i, :4])
        _by_points(control, rays, few[i], by_logs / few[i], slopes[i, 4:])
        slopes[i, 0, -1] = 1.0
    return factors, slopes


def _star_factors_and_slopes(
    radii: np.ndarray, along: np.ndarray, faces: np.ndarray
) -> tuple[Float64[np.ndarray, "4"], Float64[np.ndarray, "4 directions"]]:
    """Return ln of D_n, I / L, CSF and sphericity of a star's mesh, and their derivatives by the radii."""
    volume, area, first, second, dv, da, df, ds = _integrals_and_slopes(along * radii[:, None], along, faces)
    full_volume, full_area = share_of_sphere()
    dm = (
        ds / volume
        - second * (dv / volume**2)[:, None, None]
        - (df[:, :, None] * first + first[:, None] * df[:, None, :]) / volume**2
        + 2.0 * np.outer(first, first) * (dv / volume**3)[:, None, None]
    )
    squares, frame = np.linalg.eigh(second / volume - np.outer(first, first) / volume**2)
    squares = np.maximum(squares, 1e-300)
    changes = 0.5 * np.einsum("ik,vij,jk->kv", frame, dm, frame) / squares[:, None]  # of ln axis
    short, middle, long = np.sqrt(squares)
    volume, area = volume / full_volume, area / full_area
    diameter = formulas.nominal_diameters(volume)
    dv, da = dv / (full_volume * volume), da / (full_area * area)
    elongation = formulas.elongation_ratio(middle, long)
    csf = formulas.corey_shape_factor(short, middle, long)
    sphericity = formulas.sphericity_of_diameter(diameter, area)
    return np.array([np.log(diameter), elongation, csf, sphericity]), np.stack([
        dv / 3.0,
        elongation * (changes[1] - changes[2]),
        csf * (changes[0] - 0.5 * (changes[1] + changes[2])),
        sphericity * (2.0 / 3.0 * dv - da),
    ])  # fmt: skip


@compiled()
def _integrals_and_slopes(
    points: np.ndarray, along: np.ndarray, faces: np.ndarray
) -> tuple[float, float, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return volume, area, first and second moments of a closed mesh, and what each radius changes."""
    count = len(points)
    volume = area = 0.0
    first, second = np.zeros(3), np.zeros((3, 3))
    dv, da, df, ds = np.zeros(count), np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    total, normal = np.empty(3), np.empty(3)
    for f in range(len(faces)):
        for turn in range(3):
            own, after, before = faces[f, turn], faces[f, (turn + 1) % 3], faces[f, (turn + 2) % 3]
            a, b, c, u = points[own], points[after], points[before], along[own]
            if turn == 0:
                for i in range(3):
                    total[i] = a[i] + b[i] + c[i]
                    j, k = (i + 1) % 3, (i + 2) % 3
                    normal[i] = (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j])
                length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
                part = (a[0] * normal[0] + a[1] * normal[1] + a[2] * normal[2]) / 6.0
                volume += part
                area += 0.5 * length
                for i in range(3):
                    first[i] += part * total[i] / 4.0
                    for j in range(3):
                        squares = total[i] * total[j] + a[i] * a[j] + b[i] * b[j] + c[i] * c[j]
                        second[i, j] += part / 20.0 * squares
            grown = turned = 0.0
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                grown += u[i] * (b[j] * c[k] - b[k] * c[j]) / 6.0
                turned += u[i] * ((b[j] - c[j]) * normal[k] - (b[k] - c[k]) * normal[j])
            dv[own] += grown
            if length > 0.0:
                da[own] += 0.5 * turned / length
            for i in range(3):
                df[own, i] += (grown * total[i] + part * u[i]) / 4.0
                for j in range(3):
                    squares = total[i] * total[j] + a[i] * a[j] + b[i] * b[j] + c[i] * c[j]
                    mixed = u[i] * (total[j] + a[j]) + u[j] * (total[i] + a[i])
                    ds[own, i, j] += (grown * squares + part * mixed) / 20.0
    return volume, area, first, second, dv, da, df, ds


@compiled()
def _by_points(
    control: np.ndarray, along: np.ndarray, radii: np.ndarray, by_radii: np.ndarray, out: np.ndarray
) -> None:
    """Add to `out`, shape (rows, 4 n + 1), the derivatives by centers and ln k of what radii change."""
    n, rows = control.shape[1], by_radii.shape[0]
    slopes = np.empty((4, n))
    for v in range(len(along)):
        if radii[v] <= SMALLEST_RADIUS:
            continue
        steep = 0.0
        for i in range(n):
            square = along_it = 0.0
            for x in range(3):
                away = radii[v] * along[v, x] - control[x, i]
                slopes[x, i] = away
                square += away * away
                along_it += away * along[v, x]
            pull = control[3, i] / square
            for x in range(3):
                slopes[x, i] *= 2.0 * pull / square
            slopes[3, i] = pull
            steep -= 2.0 * pull / square * along_it
        # On a ray that touches the surface, no more, the radius has no derivative.
        if steep > -1e-9:
            continue
        for row in range(rows):
            share = -by_radii[row, v] / steep
            for i in range(n):
                for x in range(3):
                    out[row, 3 * i + x] += share * slopes[x, i]
                out[row, 3 * n + i] += share * slopes[3, i]
