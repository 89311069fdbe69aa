"""The shape factors of one body that are cheap to find."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from mbstudio.core.metrics import factors


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
    The factors that follow from the axis lengths alone are properties: `krumbein`, `sneed_folk`,
    `elongation` and `flatness` (Zingg), those of Potticary and of Angelidakis.
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

    @property
    def krumbein(self) -> float:
        """Krumbein's intercept sphericity."""
        return factors.krumbein_sphericity(*self.lengths)

    @property
    def sneed_folk(self) -> float:
        """Sneed and Folk's maximum projection sphericity."""
        return factors.sneed_folk_sphericity(*self.lengths)

    @property
    def elongation(self) -> float:
        """Zingg's b/a: L_i / L_l."""
        return self.intermediate / self.longest

    @property
    def flatness(self) -> float:
        """Zingg's c/b: L_s / L_i."""
        return self.shortest / self.intermediate

    @property
    def potticary_elongation(self) -> float:
        """Potticary's elongation, 0 to 1."""
        return factors.potticary_elongation(*self.lengths)

    @property
    def potticary_flatness(self) -> float:
        """Potticary's flatness, 0 to 1."""
        return factors.potticary_flatness(*self.lengths)

    @property
    def angelidakis_elongation(self) -> float:
        """Angelidakis' elongation, 0 to 1."""
        return factors.angelidakis_elongation(*self.lengths)

    @property
    def angelidakis_flatness(self) -> float:
        """Angelidakis' flatness, 0 to 1."""
        return factors.angelidakis_flatness(*self.lengths)

    def as_dict(self) -> dict[str, float | str]:
        """Return name and value of every factor, for tables."""
        found = asdict(self)
        stated = {name: found.pop(name) for name in ("unit", "axes", "surface", "warning")}
        return {**found, **{name: getattr(self, name) for name in AXIS_FACTORS}, **stated}


AXIS_FACTORS = (
    "krumbein",
    "sneed_folk",
    "elongation",
    "flatness",
    "potticary_elongation",
    "potticary_flatness",
    "angelidakis_elongation",
    "angelidakis_flatness",
)
"""Factors that follow from the three axis lengths."""

CORE_FACTORS = (
    "volume",
    "area",
    "sphericity",
    "circularity",
    "csf",
    "dn",
    "ds",
    "dns",
    "shortest",
    "intermediate",
    "longest",
    *AXIS_FACTORS,
)
"""Every number in a `ShapeFactors`, by name."""
