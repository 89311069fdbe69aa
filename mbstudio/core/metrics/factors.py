"""Formulas of the shape factors: numbers in, numbers out. docs/shape-factors.md names their sources."""

from __future__ import annotations

import math


def nominal_diameter(volume: float) -> float:
    """Return D_n, the diameter of the sphere of this volume."""
    return (6.0 * volume / math.pi) ** (1.0 / 3.0)


def sphericity(volume: float, area: float) -> float:
    """Return Wadell's sphericity: area of the sphere of the same volume over the body's area."""
    return math.pi ** (1.0 / 3.0) * (6.0 * volume) ** (2.0 / 3.0) / area


def projected_diameter(projected_area: float) -> float:
    """Return D_s, the diameter of the circle with the maximum projected area."""
    return math.sqrt(4.0 * projected_area / math.pi)


def circularity(projected_area: float, perimeter: float) -> float:
    """Return C = pi D_s / P_p, with P_p the perimeter of that same projection."""
    return math.pi * projected_diameter(projected_area) / perimeter


def corey_shape_factor(shortest: float, intermediate: float, longest: float) -> float:
    """Return L_s / sqrt(L_i L_l)."""
    return shortest / math.sqrt(intermediate * longest)


def krumbein_sphericity(shortest: float, intermediate: float, longest: float) -> float:
    """Return (L_s L_i / L_l**2)**(1/3), Krumbein (1941)."""
    return (shortest * intermediate / longest**2) ** (1.0 / 3.0)


def sneed_folk_sphericity(shortest: float, intermediate: float, longest: float) -> float:
    """Return the maximum projection sphericity (L_s**2 / (L_l L_i))**(1/3), Sneed & Folk (1958)."""
    return (shortest**2 / (longest * intermediate)) ** (1.0 / 3.0)


def potticary_elongation(shortest: float, intermediate: float, longest: float) -> float:
    """Return (L_l - L_i) / (L_l + L_i + L_s), Potticary et al. (2015): 0 for a plate, 1 for a needle."""
    return (longest - intermediate) / (longest + intermediate + shortest)


def potticary_flatness(shortest: float, intermediate: float, longest: float) -> float:
    """Return 2 (L_i - L_s) / (L_l + L_i + L_s), Potticary et al. (2015): 1 for a plate, 0 for a needle."""
    return 2.0 * (intermediate - shortest) / (longest + intermediate + shortest)


def angelidakis_elongation(shortest: float, intermediate: float, longest: float) -> float:
    """Return L_l L_s / (L_l L_s + L_i**2) - L_s / (L_l + L_s), Angelidakis et al. (2022)."""
    product = longest * shortest
    return product / (product + intermediate**2) - shortest / (longest + shortest)


def angelidakis_flatness(shortest: float, intermediate: float, longest: float) -> float:
    """Return L_i**2 / (L_l L_s + L_i**2) - L_s / (L_l + L_s), Angelidakis et al. (2022)."""
    squared = intermediate**2
    return squared / (longest * shortest + squared) - shortest / (longest + shortest)
