"""Formulas of size and shape, each written once: numbers in, numbers out.

docs/shape-factors.md names their sources. Where a formula takes arrays, it works element by element.
"""

from __future__ import annotations

import math
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", float, NDArray[np.float64])


def nominal_diameter(volume: float) -> float:
    """Return D_n, the diameter of the sphere of this volume."""
    return float(_cubed_nominal_diameter(volume) ** (1.0 / 3.0))


@overload
def nominal_diameters(volumes: float) -> np.float64: ...
@overload
def nominal_diameters(volumes: NDArray[np.float64]) -> NDArray[np.float64]: ...
def nominal_diameters(volumes: float | NDArray[np.float64]) -> np.float64 | NDArray[np.float64]:
    """Return D_n of one or many bodies by np.cbrt.

    It can differ from the power in :func:`nominal_diameter` by the last bit. Serialized styles and what is
    computed from them rest on this one, fits and measurements of single bodies on that one.
    """
    diameters: np.float64 | NDArray[np.float64] = np.cbrt(_cubed_nominal_diameter(volumes))
    return diameters


def _cubed_nominal_diameter(volume: Any) -> Any:
    return 6.0 * volume / math.pi


def sphericity(volume: float, area: float) -> float:
    """Return Wadell's sphericity: area of the sphere of the same volume over the body's area."""
    ratio: float = math.pi ** (1.0 / 3.0) * (6.0 * volume) ** (2.0 / 3.0) / area
    return ratio


def sphericity_of_diameter(diameter: float, area: float) -> float:
    """Return Wadell's sphericity from D_n: pi D_n**2 / A."""
    return math.pi * diameter**2 / area


def projected_diameter(projected_area: float) -> float:
    """Return D_s, the diameter of the circle with the maximum projected area."""
    return math.sqrt(4.0 * projected_area / math.pi)


def circularity(projected_area: float, perimeter: float) -> float:
    """Return C = pi D_s / P_p, with P_p the perimeter of that same projection."""
    return math.pi * projected_diameter(projected_area) / perimeter


def diameter_ratio(dn: Number, ds: Number) -> Number:
    """Return D_n / D_s, Zhao et al. (2023)."""
    return dn / ds


def corey_shape_factor(shortest: Number, intermediate: Number, longest: Number) -> Number:
    """Return L_s / sqrt(L_i L_l), Corey (1949)."""
    return shortest / np.sqrt(intermediate * longest)  # type: ignore[no-any-return]


def elongation_ratio(intermediate: Number, longest: Number) -> Number:
    """Return L_i / L_l, Zingg's b/a (1935)."""
    return intermediate / longest


def flatness_ratio(shortest: Number, intermediate: Number) -> Number:
    """Return L_s / L_i, Zingg's c/b (1935)."""
    return shortest / intermediate


def krumbein_sphericity(shortest: Number, intermediate: Number, longest: Number) -> Number:
    """Return (L_s L_i / L_l**2)**(1/3), Krumbein (1941)."""
    return _cube_root(shortest * intermediate / longest**2)


def sneed_folk_sphericity(shortest: Number, intermediate: Number, longest: Number) -> Number:
    """Return the maximum projection sphericity (L_s**2 / (L_l L_i))**(1/3), Sneed & Folk (1958)."""
    return _cube_root(shortest**2 / (longest * intermediate))


def potticary_elongation(shortest: Number, intermediate: Number, longest: Number) -> Number:
    """Return (L_l - L_i) / (L_l + L_i + L_s), Potticary et al. (2015): 0 for a plate, 1 for a needle."""
    return (longest - intermediate) / (longest + intermediate + shortest)


def potticary_flatness(shortest: Number, intermediate: Number, longest: Number) -> Number:
    """Return 2 (L_i - L_s) / (L_l + L_i + L_s), Potticary et al. (2015): 1 for a plate, 0 for a needle."""
    return 2.0 * (intermediate - shortest) / (longest + intermediate + shortest)


def angelidakis_elongation(shortest: Number, intermediate: Number, longest: Number) -> Number:
    """Return L_l L_s / (L_l L_s + L_i**2) - L_s / (L_l + L_s), Angelidakis et al. (2022)."""
    product = longest * shortest
    return product / (product + intermediate**2) - shortest / (longest + shortest)


def angelidakis_flatness(shortest: Number, intermediate: Number, longest: Number) -> Number:
    """Return L_i**2 / (L_l L_s + L_i**2) - L_s / (L_l + L_s), Angelidakis et al. (2022)."""
    squared = intermediate**2
    return squared / (longest * shortest + squared) - shortest / (longest + shortest)


def sheppard_ratio(inscribed: Number, dn: Number) -> Number:
    """Return the diameter of the largest sphere in the body over D_n."""
    return inscribed / dn


def _cube_root(value: Number) -> Number:
    """Return the cube root: of one number as a power, of many by np.cbrt (see :func:`nominal_diameters`)."""
    root: Number = np.cbrt(value) if isinstance(value, np.ndarray) else value ** (1.0 / 3.0)
    return root
