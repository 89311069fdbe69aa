"""The shape factors of one body that are cheap to find."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.units import conversion_factor


@dataclass(frozen=True)
class DetailedFactors:
    """What the field uses beside the core factors (docs/shape-factors.md: formulas and sources).

    Attributes
    ----------
    convexity : float
        V / V_hull, both of the measured surface; 1 for a convex body.
    inscribed, enclosing : float
        Diameters of the largest sphere in the body and of the smallest around it, in unit.
    sheppard : float
        Inscribed over nominal diameter.
    feret_min, feret_mid, feret_max : float
        Caliper diameters in unit: least width, largest width across the direction of `feret_max`, largest.
    roundness : float
        Wadell's in three dimensions: mean radius of curvature of the corners over the inscribed radius. NaN
        where it cannot be told: a grain of fewer than 15 voxels across its inscribed sphere.
    roughness : float
        Root mean square distance to the body smoothed at D_n / 16, over D_n.
    bands : tuple of float, or None
        Energies of the bands 0 to 12 of the radius function, over that of band 0; None where the body is not
        star-shaped about its centre of volume.
    inscribed_centre, enclosing_centre : tuple of float
        Centres (x, y, z) of the two spheres in unit, in the body's frame.
    unit : str
    surface : str
        What was measured: 'avatar', 'mesh', 'smoothed voxels'.
    warning : str
        What to mind about these numbers, in a sentence; empty if nothing.
    """

    convexity: float
    inscribed: float
    enclosing: float
    sheppard: float
    feret_min: float
    feret_mid: float
    feret_max: float
    roundness: float
    roughness: float
    bands: tuple[float, ...] | None
    inscribed_centre: tuple[float, float, float]
    enclosing_centre: tuple[float, float, float]
    unit: str
    surface: str = "mesh"
    warning: str = ""

    def as_dict(self) -> dict[str, float | str | None]:
        """Return name and value of every factor, for tables; None where undefined.

        An added factor that needs core factors too is not among them: populations have it.
        """
        row: dict[str, Any] = {
            name: FACTORS.value(name, vars(self))
            for name in FACTORS.detail
            if name in vars(self) or vars(self).keys() >= set(FACTORS[name].arguments)
        }
        row = {name: None if np.isnan(value) else value for name, value in row.items()}
        for band, name in enumerate(FACTORS.bands, 1):
            row[name] = None if self.bands is None else self.bands[band]
        return {**row, "unit": self.unit, "surface": self.surface, "warning": self.warning}


DETAILED_FACTORS = FACTORS.detail
"""Every number that a `DetailedFactors` has by itself but the bands, by name."""


@dataclass(frozen=True)
class ShapeFactors:
    """Shape factors of a grain, mesh or avatar (docs/shape-factors.md: formulas and sources).

    Attributes
    ----------
    volume : float
        V in unit**3.
    area : float
        Surface area A in unit**2.
    sphericity : float
        pi**(1/3) (6 V)**(2/3) / A.
    circularity : float
        C = pi D_s / P_p, with P_p the perimeter of the maximum projection.
    csf : float
        Corey shape factor L_s / sqrt(L_i L_l).
    dn : float
        Nominal diameter (6 V / pi)**(1/3) in unit.
    ds : float
        Diameter sqrt(4 A_p / pi) of the circle with the maximum projected area, in unit.
    dns : float
        D_n / D_s.
    shortest, intermediate, longest : float
        Axis lengths L_s, L_i, L_l in unit, by `axes`.
    unit : str
    axes : str
        Convention of the axis lengths: 'obb' (edges of the minimum-volume oriented bounding box), 'feret'
        (caliper diameters) or 'inertia' (axes of the homogeneous ellipsoid with the same inertia over mass).
    surface : str
        What the area was measured on: 'avatar', 'mesh', 'crofton voxels', 'smoothed voxels'.
    warning : str
        What to mind about these numbers, in a sentence; empty if nothing.

    Notes
    -----
    The factors that follow from these are attributes as well: `krumbein`, `sneed_folk`, `elongation` and
    `flatness` (Zingg), those of Potticary and of Angelidakis, and what was added to
    :data:`~mbstudio.core.metrics.factor_table.FACTORS`.
    """

    volume: float
    area: float
    sphericity: float
    circularity: float
    csf: float
    dn: float
    ds: float
    dns: float
    shortest: float
    intermediate: float
    longest: float
    unit: str
    axes: str = "obb"
    surface: str = "mesh"
    warning: str = ""

    @property
    def lengths(self) -> tuple[float, float, float]:
        """L_s, L_i, L_l in unit."""
        return self.shortest, self.intermediate, self.longest

    def __getattr__(self, name: str) -> float:
        """Return a factor that follows from those measured: `krumbein`, and whatever else the table has."""
        if name not in FACTORS or FACTORS[name].measured != "core":
            raise AttributeError(f"There is no core factor '{name}'.")
        return float(FACTORS.value(name, vars(self)))

    def as_dict(self) -> dict[str, float | str]:
        """Return name and value of every factor, for tables."""
        stated = {name: getattr(self, name) for name in ("unit", "axes", "surface", "warning")}
        return {**{name: getattr(self, name) for name in FACTORS.core}, **stated}


CORE_FACTORS = FACTORS.core
"""Every number that a `ShapeFactors` has by itself, by name."""


def scale_factors(record: ShapeFactors | DetailedFactors, unit: str, other: str) -> dict[str, Any]:
    """Return the lengths, areas and volumes of a record, which are in one unit, in another."""
    return factors_times(record, conversion_factor(unit, other))


def factors_times(record: ShapeFactors | DetailedFactors, scale: float) -> dict[str, Any]:
    """Return the lengths, areas and volumes of a record with all lengths times `scale`."""
    return {
        field.name: getattr(record, field.name) * scale ** FACTORS[field.name].power
        for field in fields(record)
        if field.name in FACTORS and FACTORS[field.name].power
    }
