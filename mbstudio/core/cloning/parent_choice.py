"""Which of many grains become parents: as many as a style needs, spread over the sizes that there are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ENOUGH_PARENTS = 200
"""Parents that a style of surfaces needs at most: each gives clones of any form, and takes time to learn."""


def spread_over_sizes(volumes: Sequence[float], most: int = ENOUGH_PARENTS) -> list[int]:
    """Return the places of some bodies, spread evenly over the ranks of their volumes.

    The smallest and the largest are among them; quantiles of size stay those of all.

    Parameters
    ----------
    volumes : sequence of float
    most : int
        How many at most, 1 or more.

    Returns
    -------
    list of int
        Ascending.

    Raises
    ------
    ValueError
        If `most` is below 1.
    """
    if most < 1:
        raise ValueError(f"At least 1 body must be taken, not {most}.")
    by_size = np.argsort(np.asarray(volumes, dtype=np.float64), kind="stable")
    if len(by_size) <= most:
        return list(range(len(by_size)))
    ranks = np.rint(np.linspace(0, len(by_size) - 1, most)).astype(int)
    return sorted(by_size[ranks].tolist())
