"""Measure the detailed factors of a grain, an avatar or a mesh: one code for the three."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core import formulas
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.axes import convex_hull
from mbstudio.core.metrics.bodies import UNITLESS, MeasuredBody, prepare_measured_body
from mbstudio.core.metrics.curvature import roughness, smooth_body
from mbstudio.core.metrics.feret import feret_diameters
from mbstudio.core.metrics.harmonics import band_energies
from mbstudio.core.metrics.roundness import roundness
from mbstudio.core.metrics.shape_factors import DetailedFactors, factors_times, scale_factors
from mbstudio.core.metrics.spheres import enclosing_sphere, inscribed_sphere
from mbstudio.core.metrics.surfaces import signed_volumes
from mbstudio.core.threads import one_thread
from mbstudio.core.units import conversion_factor, parse_unit

if TYPE_CHECKING:
    import trimesh


def measure_detail(body: Grain | Avatar | trimesh.Trimesh, *, unit: str | None = None) -> DetailedFactors:
    """Return spheres, Feret diameters, convexity, roundness, roughness and band energies of one body.

    A grain is measured on its lightly smoothed surface, an avatar on a fine mesh with every vertex on its
    surface.

    Parameters
    ----------
    body : Grain, Avatar or trimesh.Trimesh
    unit : str, optional
        As for `measure`.

    Raises
    ------
    MeshError, MeasureError
        As `measure`; also MeasureError for a thread too long for the grid of the curvature.
    """
    found = detailed_factors(prepare_measured_body(body, unit, "smoothed"))
    return found if unit is None or found.unit == UNITLESS else convert_detail(found, unit)


def convert_detail(measured: DetailedFactors, unit: str) -> DetailedFactors:
    """Return the same factors with lengths in another unit."""
    unit = parse_unit(unit)
    f = conversion_factor(measured.unit, unit)
    x, y, z = measured.inscribed_centre
    u, v, w = measured.enclosing_centre
    return replace(
        measured,
        **scale_factors(measured, measured.unit, unit),
        inscribed_centre=(x * f, y * f, z * f),
        enclosing_centre=(u * f, v * f, w * f),
        unit=unit,
    )


@one_thread()
def detailed_factors(body: MeasuredBody) -> DetailedFactors:
    """Return the detailed factors of a body from :func:`prepare_measured_body`."""
    # In lengths of its own: some of what follows takes small numbers for none.
    length = body.own_length
    found = _factors_of(body.scaled(1.0 / length))
    return replace(
        found,
        **factors_times(found, length),
        inscribed_centre=_triple(length * np.array(found.inscribed_centre)),
        enclosing_centre=_triple(length * np.array(found.enclosing_centre)),
    )


def _factors_of(body: MeasuredBody) -> DetailedFactors:
    vertices, faces = body.outline
    hull = convex_hull(vertices)
    dn = formulas.nominal_diameter(body.volume)
    smooth = smooth_body(vertices, faces, dn)
    inner = inscribed_sphere(vertices, faces, smooth.inside, smooth.edge, smooth.origin)
    outer = enclosing_sphere(hull.points[hull.vertices])
    feret_min, feret_mid, feret_max = (float(length) for length in feret_diameters(hull).lengths)
    round_ = roundness(vertices, faces, inner.radius, body.voxel_edge)
    energies = band_energies(vertices, faces, body.centre)
    return DetailedFactors(
        convexity=float(signed_volumes(vertices, faces).sum()) / float(hull.volume),
        inscribed=2 * inner.radius,
        enclosing=2 * outer.radius,
        sheppard=formulas.sheppard_ratio(2 * inner.radius, dn),
        feret_min=feret_min,
        feret_mid=feret_mid,
        feret_max=feret_max,
        roundness=round_,
        roughness=roughness(smooth, vertices, faces, dn),
        bands=None if energies is None else tuple(float(energy) for energy in energies),
        inscribed_centre=_triple(inner.centre),
        enclosing_centre=_triple(outer.centre),
        unit=body.unit,
        surface=body.surface,
        warning=" ".join(said for said in (body.warning, _doubt(round_, body)) if said),
    )


def _doubt(roundness: float, body: MeasuredBody) -> str:
    if not np.isnan(roundness):
        return ""
    if body.voxel_edge:
        return "The grain has fewer than 15 voxels across its largest sphere: its roundness cannot be told."
    return "The body is too thin and wide: its roundness cannot be told."


def _triple(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
