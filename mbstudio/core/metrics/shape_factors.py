"""The shape factors of one body, as the paper defines them."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class ShapeFactors:
    """Shape factors of a grain, mesh or avatar (Zhao et al. 2023, section 3.2).

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
        Convention of the axis lengths: 'obb' (minimum-volume oriented bounding box).
    surface : str
        Which surface was measured: 'avatar', 'mesh', 'smoothed voxels'.
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

    def as_dict(self) -> dict[str, float | str]:
        """Return name and value of every factor, for tables."""
        return asdict(self)
