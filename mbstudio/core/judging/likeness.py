"""How near clones are to their parents, beside how near true grains are to one another."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from mbstudio.core.judging.features import Features
from mbstudio.core.judging.judgement import Likeness
from mbstudio.core.vae.generate.novelty import COPY
from mbstudio.core.vae.models.radii import direction_exchange, novelty_distances


def radii_correlations(
    ours: Float[np.ndarray, "n 144"], theirs: Float[np.ndarray, "m 144"]
) -> Float64[np.ndarray, "n m"]:
    """Return the correlation of the radii of each two bodies, over the eight flips the largest.

    Parameters
    ----------
    ours, theirs : float array
        ln r in the principal frame.
    """
    first, second = (_standardised(np.exp(logs)) for logs in (ours, theirs))
    found = np.full((len(ours), len(theirs)), -np.inf)
    for exchange in direction_exchange():
        np.maximum(found, first @ second[:, exchange].T, out=found)
    return found


def _standardised(radii: Float[np.ndarray, "n d"]) -> Float64[np.ndarray, "n d"]:
    centred = radii - radii.mean(axis=1, keepdims=True)
    unit: np.ndarray = centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-12)
    return unit


def nearest_rows(bodies: Sequence[Features], others: Sequence[Features]) -> Int[np.ndarray, " n"]:
    """Return which of the others is nearest to each body."""
    rows: np.ndarray = novelty_distances(_logs(bodies), _logs(others)).argmin(axis=1)
    return rows


def find_likeness(
    true: Sequence[Features],
    true_groups: Sequence[Hashable],
    clones: Sequence[Features],
    clone_parents: Sequence[Hashable] | None,
    parents: Sequence[Features],
    parent_groups: Sequence[Hashable],
) -> Likeness:
    """Return how near clones are to parents, and true grains to other true grains.

    Parameters
    ----------
    true, true_groups
        Grains, and the group of relatives of each: relatives do not count as others.
    clones, clone_parents
        Clones, and the group of the parent of each, where known.
    parents, parent_groups
        Grains that clones may have been made of.
    """
    among_distance = novelty_distances(_logs(true), _logs(true))
    among_correlation = radii_correlations(_logs(true), _logs(true))
    related = _equal(true_groups, true_groups)
    among_distance[related], among_correlation[related] = np.inf, -np.inf
    distance = novelty_distances(_logs(clones), _logs(parents))
    correlation = radii_correlations(_logs(clones), _logs(parents))
    nearest_true = among_distance.min(axis=1)
    source_distance = source_correlation = float("nan")
    if clone_parents is not None:
        is_source = _equal(clone_parents, parent_groups)
        known = is_source.any(axis=1)
        if known.any():
            source_distance = float(np.median(np.where(is_source, distance, np.inf).min(axis=1)[known]))
            source_correlation = float(np.median(np.where(is_source, correlation, -2.0).max(axis=1)[known]))
    unit = float(np.median(nearest_true))
    nearest = distance.min(axis=1)
    return Likeness(
        distance=(unit, float(np.median(nearest))),
        correlation=(
            float(np.median(among_correlation.max(axis=1))),
            float(np.median(correlation.max(axis=1))),
        ),
        source_distance=source_distance,
        source_correlation=source_correlation,
        copies=float(np.mean(nearest < COPY * unit)),
    )


def _logs(bodies: Sequence[Features]) -> Float64[np.ndarray, "n 144"]:
    return np.array([body.log_radii for body in bodies])


def _equal(one: Sequence[Hashable], other: Sequence[Hashable]) -> Bool[np.ndarray, "n m"]:
    number: dict[Hashable, int] = {}
    first, second = (
        np.array([number.setdefault(group, len(number)) for group in groups]) for groups in (one, other)
    )
    equal: np.ndarray = first[:, None] == second[None]
    return equal
