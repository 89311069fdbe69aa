"""What the factors of shaped surfaces are called in the window, and how they are written."""

from __future__ import annotations

from mbstudio.core.units import unit_label
from mbstudio.ui.language import mark, tr

TITLES = {
    "size": mark("Size Dₙ"),
    "elongation": mark("Elongation I / L"),
    "flatness": mark("Flatness S / I"),
    "csf": mark("Corey factor S / √(L I)"),
    "sphericity": mark("Sphericity"),
    "convexity": mark("Convexity"),
    "roughness": mark("Roughness"),
}


def title_with_unit(factor: str, unit: str) -> str:
    """Return a factor's title, with the unit where it has one."""
    title = tr(TITLES[factor])
    return f"{title} ({unit_label(unit)})" if factor == "size" else title


def decimals_of(factor: str, typical: float) -> int:
    """Return with how many decimals a factor is written, by a value of it."""
    if factor == "size":
        return 2 if typical > 1 else 3
    return 4 if factor == "roughness" else 3
