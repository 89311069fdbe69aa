"""Measure a grain, an avatar or a mesh: one code for the three."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from mbstudio.core import formulas
from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.axes import (
    BoundingBox,
    box_along,
    convex_hull,
    inertia_lengths,
    minimum_bounding_box,
    sort_edges,
)
from mbstudio.core.metrics.bodies import UNITLESS, MeasuredBody, VoxelSurface, prepare_measured_body
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.metrics.feret import feret_diameters
from mbstudio.core.metrics.projection import maximum_projection
from mbstudio.core.metrics.shape_factors import ShapeFactors, factors_times, scale_factors
from mbstudio.core.threads import one_thread
from mbstudio.core.units import parse_unit

if TYPE_CHECKING:
    import trimesh

AxisConvention = Literal["obb", "feret", "inertia"]


def measure(
    body: Grain | Avatar | trimesh.Trimesh,
    *,
    unit: str | None = None,
    axes: AxisConvention = "obb",
    surface: VoxelSurface | None = None,
    along: Float[np.ndarray, "3 3"] | None = None,
) -> ShapeFactors:
    """Return the shape factors of one body.

    A grain's volume is that of its voxels; its area follows from Crofton's formula, corrected for missed
    chords, or is that of its lightly smoothed surface, on which everything else is measured. An avatar is
    measured on two nested meshes with every vertex on its surface, volume
    and area extrapolated to zero edge length (within 0.1 %, usually 0.01 %).

    Parameters
    ----------
    body : Grain, Avatar or trimesh.Trimesh
    unit : str, optional
        Unit of the result. For a mesh that carries none, the unit that its numbers are in;
        without either the factors carry the unit 'unitless'.
    axes : {"obb", "feret", "inertia"}
        What the three axis lengths are: edges of the oriented bounding box of least volume; smallest,
        middle and largest caliper diameter; axes of the homogeneous ellipsoid with the same
        principal moments of inertia over mass. The record states it.
    surface : {"crofton", "smoothed"}, optional
        How the area of a voxel grain is found: by the corrected Crofton formula, which counts the roughness
        of a noisy outline, or as that of the smoothed surface, which cuts off edges (a cube 24 voxels
        wide loses 5 %). By default smoothed for grains of a segmented scan, else Crofton. The record
        states it.
    along : float array, shape (3, 3), optional
        Orthogonal unit vectors (rows) along which the edges of the box lie, for `axes` = 'obb', instead of
        the box of least volume: to compare a body with another along the edges of that one's smallest box
        (:func:`bounding_box`). Two boxes of a body can have the same volume but for a thousandth, and quite
        different edges.

    Raises
    ------
    MeshError
        If a mesh is not one closed body.
    MeasureError
        If the body is flat, empty, in several pieces, or a grain that is one voxel thick; if `along` is not
        orthogonal, or `axes` another than 'obb' beside it.

    References
    ----------
    Zhao et al. (2023), Computers and Geotechnics 161, 105564, section 3.2; docs/shape-factors.md.
    """
    if axes not in get_args(AxisConvention):
        raise MeasureError(f"axes='{axes}' is not known: use 'obb', 'feret' or 'inertia'.")
    if along is not None and axes != "obb":
        raise MeasureError(f"along= applies only to axes='obb', not to axes='{axes}'.")
    result = core_factors(prepare_measured_body(body, unit, surface), axes, along)
    return result if unit is None or result.unit == UNITLESS else in_unit(result, unit)


def bounding_box(
    body: Grain | Avatar | trimesh.Trimesh, *, unit: str | None = None, surface: VoxelSurface | None = None
) -> BoundingBox:
    """Return the oriented bounding box of least volume, as :func:`measure` finds it.

    Parameters
    ----------
    body, unit, surface
        As in :func:`measure`; lengths are in the body's unit.

    Raises
    ------
    MeshError, MeasureError
        As :func:`measure`.
    """
    return smallest_box(prepare_measured_body(body, unit, surface))


@one_thread()
def smallest_box(body: MeasuredBody) -> BoundingBox:
    """Return the oriented box of least volume of a body from :func:`prepare_measured_body`."""
    return _box(body, convex_hull(body.outline[0]), None)


def in_unit(measured: ShapeFactors, unit: str) -> ShapeFactors:
    """Return the same factors with lengths, area and volume in another unit."""
    unit = parse_unit(unit)
    return replace(measured, **scale_factors(measured, measured.unit, unit), unit=unit)


@one_thread()
def core_factors(
    body: MeasuredBody, axes: AxisConvention = "obb", along: Float[np.ndarray, "3 3"] | None = None
) -> ShapeFactors:
    """Return the shape factors of a body from :func:`prepare_measured_body`."""
    # In lengths of its own: some of what follows takes small numbers for none.
    length = body.own_length
    found = _factors_of(body.scaled(1.0 / length), axes, along)
    return replace(found, **factors_times(found, length))


def _factors_of(
    body: MeasuredBody, axes: AxisConvention, along: Float[np.ndarray, "3 3"] | None
) -> ShapeFactors:
    hull = convex_hull(body.outline[0])
    shortest, intermediate, longest = (float(length) for length in _axis_lengths(body, hull, axes, along))
    coarser = hull if body.coarse is None else convex_hull(body.coarse[0])
    shadow = maximum_projection(*body.outline, coarser, coarse=body.coarse)
    found = {
        "volume": body.volume,
        "area": body.area,
        "circularity": formulas.circularity(shadow.area, shadow.perimeter),
        "ds": formulas.projected_diameter(shadow.area),
        "shortest": shortest,
        "intermediate": intermediate,
        "longest": longest,
    }
    for name in ("sphericity", "csf", "dn", "dns"):
        found[name] = float(FACTORS.value(name, found))
    return ShapeFactors(**found, unit=body.unit, axes=axes, surface=body.surface, warning=body.warning)


def _axis_lengths(
    body: MeasuredBody, hull: ConvexHull, axes: AxisConvention, along: Float[np.ndarray, "3 3"] | None
) -> Float[np.ndarray, " 3"]:
    """Return L_s, L_i, L_l by a convention."""
    if axes == "inertia":
        return inertia_lengths(body.second)
    if axes == "feret":
        return feret_diameters(hull).lengths
    return _box(body, hull, along).lengths


def _box(body: MeasuredBody, hull: ConvexHull, along: Float[np.ndarray, "3 3"] | None) -> BoundingBox:
    """Return the smallest box, or that along these directions, its edges in ascending order.

    The coarser outline of an avatar falls short of its tips by up to 1 %: enough to take another of two
    boxes of nearly the same volume for the smallest.
    """
    box = minimum_bounding_box(hull) if along is None else box_along(body.outline[0], along)
    if body.coarse is None:
        return box
    coarser = np.ptp(body.coarse[0] @ box.directions.T, axis=0)
    return sort_edges((4.0 * box.lengths - coarser) / 3.0, box.directions)
