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
from mbstudio.core.twin.residuals import CONVERGED

MOST_PEAK = 0.12
"""Residual in contrasts, as means of 3 x 3 x 3 voxels: a larger one is no noise on a clean scan."""
_MOST_OF_PEAKS = 2.0  # times the median over the grains: where all grains are rough or full of minerals
_MOST_OF_MOVES = 3.0  # likewise
MOST_BURIED = 0.15
"""Share of the surface inside other grains."""
_MOST_VOLUME = 0.05  # by which labels may be off before it is told


def usual_limits(residuals: pd.DataFrame) -> pd.Series:
    """Return the ``peak`` and the ``moved`` above which a grain stands out from the others of its scan.

    Parameters
    ----------
    residuals : pandas.DataFrame
        Of the twin.
    """
    # Of two grains the better one is what is usual.
    usual = residuals[["peak", "moved"]].quantile(0.5, interpolation="lower")
    peak = max(MOST_PEAK, _MOST_OF_PEAKS * float(usual["peak"]))
    moved = max(CONVERGED, _MOST_OF_MOVES * float(usual["moved"]))
    return pd.Series({"peak": peak, "moved": moved})


def _verdict(avatar: Avatar, grain: Grain, row: pd.Series, limits: pd.Series, edge: float) -> Verdict:
    """Judge an avatar by its own shape: its grain's voxels are what it was fitted to get away from."""
    shape, outside = check(avatar, rms=float(row["shift"]) * edge), points_outside(avatar, grain)
    reasons, warnings = list(shape.reasons), list(shape.warnings)
    if outside:
        reasons.append(f"{outside} control points lie outside the grain: fit it to its labels again.")
    volume = volume_and_area(avatar.control)[0] / grain.volume - 1.0
    if abs(volume) > _MOST_VOLUME:
        warnings.append(f"The grey values differ from the labels by {100 * volume:+.1f} % of the volume.")
    if row["peak"] > limits["peak"]:
        warnings.append(
            f"The scan differs from the avatar by {row['peak']:.2f} of the contrast somewhere: look whether "
            "these are several grains, or a bright mineral."
        )
    if row["buried"] > MOST_BURIED:
        warnings.append(
            f"{100 * row['buried']:.0f} % of the surface lies inside other grains: look whether this is part "
            "of one."
        )
    if row["moved"] > limits["moved"]:
        warnings.append("The surface still moved in the last sweep: look at its labels.")
    return replace(
        shape, valid=not reasons, points_outside=outside, volume_error=float(volume), reasons=tuple(reasons),
        warnings=tuple(warnings),
    )  # fmt: skip


def fit_of_twin(
    avatar: Avatar,
    grain: Grain,
    row: pd.Series,
    limits: pd.Series,
    before: FitResult | None,
    edge: float,
) -> FitResult:
    """Return an avatar of a twin as a fit.

    Parameters
    ----------
    avatar : Avatar
        In the unit of its grain.
    grain : Grain
    row : pandas.Series
        Its row of the residuals.
    limits : pandas.Series
        See :func:`usual_limits`.
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
    verdict = _verdict(avatar, grain, row, limits, edge)
    start = before or FitResult(avatar, np.empty(0), np.empty(0), verdict, "fast", avatar.n, 0)
    return replace(start, avatar=avatar, verdict=verdict, fitted_to="grey values")
