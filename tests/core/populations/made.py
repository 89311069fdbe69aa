"""Populations of stated factors, for known answers."""

from __future__ import annotations

import numpy as np

from mbstudio.core.populations import Population


def population(kind="grains", unit="mm", labels=None, axes="obb", reasons=None, **factors) -> Population:
    """Return a population of these columns."""
    columns = {name: np.atleast_1d(np.asarray(column, dtype=float)) for name, column in factors.items()}
    count = len(next(iter(columns.values())))
    return Population(
        kind, kind, np.arange(1, count + 1) if labels is None else np.array(labels), columns, unit, axes,
        "mesh", tuple(reasons or [""] * count), ("",) * count,
    )  # fmt: skip


def spheres(*diameters, counts=None, unit="mm") -> Population:
    """Return spheres, so many of each diameter."""
    d = np.repeat(np.array(diameters, dtype=float), counts or [1] * len(diameters))
    return population(unit=unit, shortest=d, intermediate=d, longest=d, volume=np.pi / 6 * d**3)
