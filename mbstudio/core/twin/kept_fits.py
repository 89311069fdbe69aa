"""The avatars of a twin as fits, with a verdict of what grey values say about them and their grains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.surface import volume_and_area
from mbstudio.core.metaball.validity import Verdict, check, points_outside

MOST_PEAK = 0.12
"""Residual in contrasts, as means of 3 x 3 x 3 voxels: a larger one is no noise."""
MOST_BURIED = 0.15
"""Share of the surface inside other grains."""
_MOST_VOLUME = 0.05  # by which labels may be off before it is told


def _verdict(avatar: Avatar, grain: Grain, row: pd.Series, edge: float) -> Verdict:
    """Judge an avatar by its own shape: its grain's voxels are what it was fitted to get away from."""
    shape, outside = check(avatar, rms=float(row["shift"]) * edge), points_outside(avatar, grain)
    reasons, warnings = list(shape.reasons), list(shape.warnings)
    if outside:
        reasons.append(f"{outside} control points lie outside the grain: fit it to its labels again.")
    volume = volume_and_area(avatar.control)[0] / grain.volume - 1.0
    if abs(volume) > _MOST_VOLUME:
        warnings.append(f"The grey values differ from the labels by {100 * volume:+.1f} % of the volume.")
    if row["peak"] > MOST_PEAK:
        warnings.append(
            f"The scan differs from the avatar by {row['peak']:.2f} of the contrast somewhere: look whether "
            "these are several grains."
        )
    if row["buried"] > MOST_BURIED:
        warnings.append(
            f"{100 * row['buried']:.0f} % of the surface lies inside other grains: look whether this is part "
            "of one."
        )
    if not row["converged"]:
        warnings.append("The surface still moved in the last sweep: look at its labels.")
    return replace(
        shape, valid=not reasons, points_outside=outside, volume_error=float(volume), reasons=tuple(reasons),
        warnings=tuple(warnings),
    )  # fmt: skip


def fit_of_twin(
    avatar: Avatar, grain: Grain, row: pd.Series, before: FitResult | None, edge: float
) -> FitResult:
    """Return an avatar of a twin as a fit.

    Parameters
    ----------
    avatar : Avatar
        In the unit of its grain.
    grain : Grain
    row : pandas.Series
        Its row of the residuals.
    before : FitResult or None
        The fit to its labels that it started from.
    edge : float
        A voxel's in that unit.

    Returns
    -------
    FitResult
        Its verdict's `rms` is how far the surface lies off the labels' avatar, and a volume other than that
        of the labels makes it not invalid.
    """
    verdict = _verdict(avatar, grain, row, edge)
    start = before or FitResult(avatar, np.empty(0), np.empty(0), verdict, "fast", avatar.n, 0)
    return replace(start, avatar=avatar, verdict=verdict, fitted_to="grey values")
