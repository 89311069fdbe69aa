"""How factors are called in tables and figures, and which power of a length they are."""

from __future__ import annotations

from dataclasses import dataclass

from mbstudio.core.metrics.bodies import UNITLESS
from mbstudio.core.metrics.shape_factors import BANDS
from mbstudio.core.units import unit_label

_EXPONENTS = {1: "", 2: "²", 3: "³"}


@dataclass(frozen=True)
class FactorName:
    """What a factor is called.

    Attributes
    ----------
    title : str
        In words, with a capital.
    symbol : str
        As in docs/shape-factors.md; empty where the field has none.
    power : int
        3 for a volume, 2 for an area, 1 for a length, 0 for a number without unit.
    """

    title: str
    symbol: str = ""
    power: int = 0

    def unit(self, length: str) -> str:
        """Return the factor's unit as people write it (``mm²``); empty without one."""
        if not self.power or length == UNITLESS:
            return ""
        return unit_label(length) + _EXPONENTS[self.power]

    def heading(self, length: str) -> str:
        """Return title, symbol and unit: the label of an axis or a column."""
        words = f"{self.title} {self.symbol}".strip()
        unit = self.unit(length)
        return f"{words} ({unit})" if unit else words


FACTOR_NAMES: dict[str, FactorName] = {
    "volume": FactorName("Volume", "V", 3),
    "area": FactorName("Surface area", "A", 2),
    "sphericity": FactorName("Sphericity", "ψ"),
    "circularity": FactorName("Circularity", "C"),
    "csf": FactorName("Corey shape factor", "CSF"),
    "dn": FactorName("Nominal diameter", "Dₙ", 1),
    "ds": FactorName("Projected diameter", "Dₛ", 1),
    "dns": FactorName("Diameter ratio", "Dₙ/Dₛ"),
    "shortest": FactorName("Shortest axis", "c", 1),
    "intermediate": FactorName("Intermediate axis", "b", 1),
    "longest": FactorName("Longest axis", "a", 1),
    "krumbein": FactorName("Krumbein sphericity", "ψ_K"),
    "sneed_folk": FactorName("Sneed-Folk sphericity", "ψ_p"),
    "elongation": FactorName("Elongation ratio", "b/a"),
    "flatness": FactorName("Flatness ratio", "c/b"),
    "potticary_elongation": FactorName("Potticary elongation"),
    "potticary_flatness": FactorName("Potticary flatness"),
    "angelidakis_elongation": FactorName("Angelidakis elongation"),
    "angelidakis_flatness": FactorName("Angelidakis flatness"),
    "convexity": FactorName("Convexity"),
    "inscribed": FactorName("Inscribed diameter", "", 1),
    "enclosing": FactorName("Enclosing diameter", "", 1),
    "sheppard": FactorName("Inscribed over nominal diameter"),
    "feret_min": FactorName("Smallest Feret diameter", "", 1),
    "feret_mid": FactorName("Middle Feret diameter", "", 1),
    "feret_max": FactorName("Largest Feret diameter", "", 1),
    "roundness": FactorName("Roundness"),
    "roughness": FactorName("Roughness"),
    **{f"band_{band}": FactorName(f"Band {band} energy") for band in range(1, BANDS + 1)},
}
"""Names of every core and detailed factor; the powers say what a change of unit does to each."""


def column_name(factor: str, unit: str) -> str:
    """Return a table's column of a factor, its unit in the name: ``volume_mm3``, ``sphericity``."""
    power = FACTOR_NAMES[factor].power
    if not power or unit == UNITLESS:
        return factor
    return f"{factor}_{unit}{power if power > 1 else ''}"
