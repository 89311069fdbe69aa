"""Where a twin starts: the avatars fitted to the labels, those of small grains with fewer control points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from mbstudio.core.batch.many_fits import fit_many
from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar

_VOXELS_PER_POINT = 70
_VOXELS_PER_NOISE = (
    1200  # times the noise in contrasts: with fewer the noise decides where a control point lies
)
_NUMBERS = (1, 2, 3, 4, 6, 8, 10, 12, 15, 18, 21, 25, 30, 35)
_WORTH_PROCESSES = 16  # grains


def number_for(voxels: int, n: int, noise: float) -> int:
    """Return how many control points a grain of so many voxels gets where `n` are asked for.

    Parameters
    ----------
    voxels, n : int
    noise : float
        Standard deviation of the scan's noise in contrasts.
    """
    most = voxels / max(_VOXELS_PER_POINT, _VOXELS_PER_NOISE * noise)
    if most >= n:
        return n
    return max((number for number in _NUMBERS if number <= min(most, n)), default=1)


def ball_for(grain: Grain) -> Avatar:
    """Return the ball of a grain's volume about its centroid: what a grain of a few voxels starts from."""
    radius = 0.5 * grain.nominal_diameter
    return Avatar(
        np.asarray(grain.centroid)[None], np.array([radius**2]), grain.unit, grain.label, grain.name
    )


class LabelFits:
    """The avatars from which a twin starts: iterate to fit those that are missing to their labels.

    Parameters
    ----------
    grains : GrainSet
    known : mapping of int to Avatar or FitResult
        Avatars that are there already, by label.
    labels : list of int
    n : int
        Control points of the others, fewer for small grains.
    noise : float
        Of the scan in contrasts.
    seed, workers
        As in :func:`~mbstudio.core.batch.many_fits.fit_many`.

    Attributes
    ----------
    fits : dict of int to FitResult
        The fits to labels, where there are some.
    """

    def __init__(
        self,
        grains: GrainSet,
        known: Mapping[int, Avatar | FitResult],
        labels: list[int],
        n: int,
        noise: float,
        seed: int,
        workers: int | None,
    ) -> None:
        wanted = set(labels)
        self.fits = {
            label: fit for label, fit in known.items() if label in wanted and isinstance(fit, FitResult)
        }
        self._found = {
            label: fit.avatar if isinstance(fit, FitResult) else fit
            for label, fit in known.items()
            if label in wanted
        }
        self._grains, self._labels, self._n, self._noise = grains, labels, n, noise
        self._seed, self._workers = seed, workers

    @property
    def avatars(self) -> dict[int, Avatar]:
        """An avatar of each grain, in the order of the labels; after the iteration."""
        return {label: self._found[label] for label in self._labels}

    def __iter__(self) -> Iterator[float]:
        """Fit the missing ones; yield after each which share of them is done."""
        grains, n = self._grains, self._n
        voxels = dict(zip(grains.table["label"].tolist(), grains.table["voxels"].tolist(), strict=True))
        by_number: dict[int, list[int]] = {}
        for label in self._labels:
            if label not in self._found:
                by_number.setdefault(number_for(int(voxels[label]), n, self._noise), []).append(label)
        missing, done = sum(map(len, by_number.values())), 0
        for number, some in sorted(by_number.items(), reverse=True):
            hands = self._workers if len(some) >= _WORTH_PROCESSES else 0
            with closing(fit_many(grains, some, n=number, seed=self._seed, workers=hands)) as items:  # type: ignore[type-var]  # a generator
                for item in items:
                    if item.result is not None:
                        self._found[item.label] = item.result.avatar
                        self.fits[item.label] = replace(item.result, n=n)
                    else:
                        self._found[item.label] = ball_for(grains.grain(item.label))
                    done += 1
                    yield done / missing


def middle_and_radius(control: Float64[np.ndarray, "4 n"]) -> tuple[Float64[np.ndarray, "3"], float]:
    """Return the middle of control points by their weights, and the radius of a ball of all weights."""
    weights = control[3] / control[3].sum()
    return control[:3] @ weights, float(np.sqrt(control[3].sum()))
