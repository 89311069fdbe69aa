"""Measure a grain, an avatar or a mesh: one code for the three."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics import factors
from mbstudio.core.metrics.axes import convex_hull, minimum_bounding_box
from mbstudio.core.metrics.projection import maximum_projection
from mbstudio.core.metrics.shape_factors import ShapeFactors
from mbstudio.core.metrics.surfaces import (
    VerticesFaces,
    avatar_surface,
    checked_mesh,
    signed_volumes,
    surface_area,
)
from mbstudio.core.units import conversion_factor, parse_unit

if TYPE_CHECKING:
    import trimesh

UNITLESS = "unitless"


@dataclass(frozen=True, eq=False)
class _Body:
    """What the factors are computed from."""

    volume: float
    area: float
    outline: VerticesFaces
    coarse: VerticesFaces | None
    unit: str
    surface: str


def measure(body: Grain | Avatar | trimesh.Trimesh, *, unit: str | None = None) -> ShapeFactors:
    """Return the shape factors of one body.

    A grain's volume is that of its voxels, everything else is measured on its lightly smoothed
    surface. An avatar is measured on two nested meshes with every vertex on its surface, volume
    and area extrapolated to zero edge length (within 0.1 %, usually 0.01 %).

    Parameters
    ----------
    body : Grain, Avatar or trimesh.Trimesh
    unit : str, optional
        Unit of the result. For a mesh that carries none, the unit that its numbers are in;
        without either the factors carry the unit 'unitless'.

    Raises
    ------
    MeshError
        If a mesh is not one closed body.
    MeasureError
        If the body is flat, empty, or an avatar in several pieces.

    References
    ----------
    Zhao et al. (2023), Computers and Geotechnics 161, 105564, section 3.2.
    """
    if isinstance(body, Grain):
        measured = _of_grain(body)
    elif isinstance(body, Avatar):
        measured = _of_avatar(body)
    else:
        measured = _of_mesh(body, unit)
    result = _factors_of(measured)
    return result if unit is None or result.unit == UNITLESS else in_unit(result, unit)


def in_unit(measured: ShapeFactors, unit: str) -> ShapeFactors:
    """Return the same factors with lengths, area and volume in another unit."""
    unit = parse_unit(unit)
    f = conversion_factor(measured.unit, unit)
    return replace(
        measured,
        volume=measured.volume * f**3,
        area=measured.area * f**2,
        dn=measured.dn * f,
        ds=measured.ds * f,
        shortest=measured.shortest * f,
        intermediate=measured.intermediate * f,
        longest=measured.longest * f,
        unit=unit,
    )


def _factors_of(body: _Body) -> ShapeFactors:
    if not body.volume > 0:
        raise MeasureError("The body has no volume, so no shape factors.")
    hull = convex_hull((body.coarse or body.outline)[0])
    box = minimum_bounding_box(hull, None if body.coarse is None else body.outline[0])
    shadow = maximum_projection(*body.outline, hull, coarse=body.coarse)
    shortest, intermediate, longest = (float(length) for length in box.lengths)
    dn = factors.nominal_diameter(body.volume)
    ds = factors.projected_diameter(shadow.area)
    return ShapeFactors(
        volume=body.volume,
        area=body.area,
        sphericity=factors.sphericity(body.volume, body.area),
        circularity=factors.circularity(shadow.area, shadow.perimeter),
        csf=factors.corey_shape_factor(shortest, intermediate, longest),
        dn=dn,
        ds=ds,
        dns=dn / ds,
        shortest=shortest,
        intermediate=intermediate,
        longest=longest,
        unit=body.unit,
        axes="obb",
        surface=body.surface,
    )


def _of_avatar(avatar: Avatar) -> _Body:
    nested = avatar_surface(avatar)
    volumes = [float(signed_volumes(*mesh).sum()) for mesh in (nested.coarse, nested.fine)]
    areas = [surface_area(*mesh) for mesh in (nested.coarse, nested.fine)]
    return _Body(
        nested.extrapolate(*volumes),
        nested.extrapolate(*areas),
        nested.fine,
        nested.coarse,
        avatar.unit,
        "avatar",
    )


def _of_grain(grain: Grain) -> _Body:
    mesh = grain.surface_mesh()
    outline = (np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces))
    return _Body(grain.volume, surface_area(*outline), outline, None, grain.unit, "smoothed voxels")


def _of_mesh(mesh: trimesh.Trimesh, unit: str | None) -> _Body:
    mesh = checked_mesh(mesh)
    outline = (np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces))
    carried = parse_unit(mesh.units) if mesh.units else None
    stated = carried or (parse_unit(unit) if unit else UNITLESS)
    return _Body(float(signed_volumes(*outline).sum()), surface_area(*outline), outline, None, stated, "mesh")
