"""Numbers as people read them."""

from __future__ import annotations

from mbstudio.core.units import METRES_PER_UNIT, conversion_factor


def readable_power_unit(value: float, unit: str, power: int) -> str:
    """Return the length unit in which `value` (in ``unit**power``) is nearest to one digit before the point.

    >>> readable_power_unit(1.1e8, "um", 3)
    'mm'
    """
    best, least = unit, float("inf")
    for name in METRES_PER_UNIT:
        if name == "cm":
            continue
        size = abs(value) * conversion_factor(unit, name) ** power
        # From 0.01 to 10000 a number needs no exponent and no run of zeros.
        excess = max(0.01 / size if size else 1.0, size / 1e4, 1.0)
        if excess < least or (excess == least and name == unit):
            best, least = name, excess
    return best


def readable_time(seconds: float) -> str:
    """Return a duration in words: "12 s", "3 min", "1 h 20 min"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
