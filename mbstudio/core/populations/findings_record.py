"""Findings as plain numbers and words, for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from mbstudio.core.populations.findings import Findings
from mbstudio.core.populations.sieving import SizeDistribution


def record_of(findings: Findings) -> dict[str, Any]:
    """Return findings as mappings, lists, numbers and words; lengths in the population's unit."""
    return {
        "bodies": len(findings.population),
        "measured": int(findings.population.measured.sum()),
        "unit": findings.population.unit,
        "axes": findings.population.axes,
        "surface": findings.population.surface,
        "level": findings.level,
        "precision": findings.precision,
        "seed": findings.seed,
        "sizes": {name: asdict(found) for name, found in findings.sizes.items()},
        "curve": {**_curve(findings.curve), "corrected_for_border": findings.is_corrected},
        "needs": [
            {**asdict(need), "needed": need.needed, "enough": need.is_enough} for need in findings.needs
        ],
        "classes_percent": {scale: dict(shares) for scale, shares in findings.classes.items()},
        "astm_d2487": {"symbol": findings.symbol[0], "because": findings.symbol[1]},
        "indices": [
            {**asdict(one), "sizes": [one.sizes[0], None if one.sizes[1] == float("inf") else one.sizes[1]]}
            for one in findings.indices
        ],
        "laboratory": [
            {
                "name": one.table.name, "read_as": one.table.read_as, "mass_g": one.table.mass,
                "curve": _curve(one.table.curve), "scan": _curve(one.scan),
                "largest_difference_percent": one.gap, "at_mm": one.gap_at,
            }
            for one in findings.against
        ],
    }  # fmt: skip


def _curve(curve: SizeDistribution) -> dict[str, Any]:
    return {
        "unit": curve.unit, "sizes": curve.sizes.tolist(), "percent_finer": curve.finer.tolist(),
        "sieves": curve.sieves,
    }  # fmt: skip
