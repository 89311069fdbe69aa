"""Formulas of the shape factors: numbers in, numbers out."""

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
