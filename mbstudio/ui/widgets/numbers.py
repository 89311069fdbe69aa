"""Numbers as people read them."""

from __future__ import annotations

import math

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


def four_digits(value: float) -> str:
    """Return a number by four digits in little room, a dash where there is none.

    >>> four_digits(0.8), four_digits(7162.3), four_digits(47404.0), four_digits(0.000081234)
    ('0.8000', '7162', '47,400', '8.12e-5')
    """
    if not math.isfinite(value):
        return "–"
    if value and not 1e-3 <= abs(value) < 1e7:
        digits, exponent = f"{value:.2e}".split("e")
        return f"{digits}e{int(exponent)}"
    text = f"{value:#.4g}".rstrip(".")
    return f"{float(text):,.0f}" if abs(value) >= 9999.5 else text


def readable_time(seconds: float) -> str:
    """Return a duration in words: "12 s", "3 min", "1 h 20 min"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
