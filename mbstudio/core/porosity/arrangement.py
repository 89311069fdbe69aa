"""Where which sizes lie: size of the grains against height and against the distance from the axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.populations.population import Population
from mbstudio.core.populations.significance import adjust_by_holm

_BINS = 8
_FEWEST = 10


@dataclass(frozen=True, eq=False)
class SizeProfile:
    """Size of grains along one direction.

    Attributes
    ----------
    along : str
        'height' (z) or 'radius' (distance from the axis through the middle of the scan along z).
    places, sizes : float array, shape (grains,)
        Of each grain, in `unit`.
    bins : float array, shape (bins + 1,)
        With about as many grains each.
    mean, error : float array, shape (bins,)
        Mean size in each, and its standard error.
    numbers : int array, shape (bins,)
    rank_correlation : float
        Spearman's, of place and size.
    p : float
        Probability of such a one by chance, adjusted after Holm for both directions.
    unit : str
    """

    along: str
    places: Float[np.ndarray, " grains"]
    sizes: Float[np.ndarray, " grains"]
    bins: Float[np.ndarray, " edges"]
    mean: Float[np.ndarray, " bins"]
    error: Float[np.ndarray, " bins"]
    numbers: Int[np.ndarray, " bins"]
    rank_correlation: float
    p: float
    unit: str


def size_profiles(
    population: Population, grains: GrainSet, factor: str = "intermediate"
) -> dict[str, SizeProfile]:
    """Return a size of grains against their height and their distance from the axis.

    Parameters
    ----------
    population : Population
        Grains of this set, measured.
    grains : GrainSet
    factor : str
        Any factor; the size that sieves tell by default.

    Raises
    ------
    MeasureError
        If fewer than ten grains have the factor, a label is not there, or the grains are bodies of mesh
        files.
    """
    from scipy.stats import spearmanr

    if grains.is_of_meshes:
        raise MeasureError("Bodies of mesh files have no place in a specimen.")
    table = grains.table.set_index("label")
    values = population.column(factor)
    there = np.isfinite(values)
    if int(there.sum()) < _FEWEST:
        raise MeasureError(f"Only {int(there.sum())} grains have the factor '{factor}': a profile needs ten.")
    missing = sorted(set(population.labels[there].tolist()) - set(table.index))
    if missing:
        raise MeasureError(f"There is no grain {missing[0]}.")
    rows = table.loc[population.labels[there].tolist()]
    middle = [
        grains.origin[place] + grains.voxel_size.xyz[place] * (grains.label_volume.shape[2 - place] - 1) / 2
        for place in (0, 1)
    ]
    heights = rows["z"].to_numpy(dtype=float)
    radii = np.hypot(rows["x"].to_numpy(dtype=float) - middle[0], rows["y"].to_numpy(dtype=float) - middle[1])
    sizes = values[there]
    found = {}
    tests = {}
    for along, places in (("height", heights), ("radius", radii)):
        alike = np.ptp(places) == 0 or np.ptp(sizes) == 0
        tests[along] = (0.0, 1.0) if alike else tuple(float(x) for x in spearmanr(places, sizes))
    adjusted = dict(zip(tests, adjust_by_holm([p for _, p in tests.values()]), strict=True))
    for along, places in (("height", heights), ("radius", radii)):
        bins = _bins(places)
        place = np.clip(np.searchsorted(bins, places, side="right") - 1, 0, len(bins) - 2)
        groups = [sizes[place == k] for k in range(len(bins) - 1)]
        found[along] = SizeProfile(
            along, places, sizes, bins,
            np.array([group.mean() if len(group) else np.nan for group in groups]),
            np.array([group.std(ddof=1) / np.sqrt(len(group)) if len(group) > 1 else np.nan for group in
            groups]),
            np.array([len(group) for group in groups]), tests[along][0], adjusted[along], grains.unit,
        )  # fmt: skip
    return found


def _bins(places: Float[np.ndarray, " grains"]) -> Float[np.ndarray, " edges"]:
    count = max(2, min(_BINS, len(places) // 5))
    edges = np.unique(np.quantile(places, np.linspace(0, 1, count + 1)))
    return edges if len(edges) > 1 else np.array([edges[0] - 0.5, edges[0] + 0.5])
