"""The shape factors of one body that take longer to find."""

from __future__ import annotations

from dataclasses import dataclass


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
        Wadell's in three dimensions: mean radius of curvature of the corners over the inscribed radius, at a
        scale of D_n / 16.
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
        """Return name and value of every factor, for tables; `band_1` and so on are None where undefined."""
        row: dict[str, float | str | None] = {name: getattr(self, name) for name in DETAILED_FACTORS}
        for band in range(1, BANDS + 1):
            row[f"band_{band}"] = None if self.bands is None else self.bands[band]
        return {**row, "unit": self.unit, "surface": self.surface, "warning": self.warning}


BANDS = 12
"""Highest band of spherical harmonics."""

DETAILED_FACTORS = (
    "convexity",
    "inscribed",
    "enclosing",
    "sheppard",
    "feret_min",
    "feret_mid",
    "feret_max",
    "roundness",
    "roughness",
)
"""Every number in a `DetailedFactors` but the bands, by name."""
