"""Whether two kinds of grains pack alike: packings of several seeds, their means, errors and differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t as student

from mbstudio.core.errors import PackingError
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.mass import mass_properties
from mbstudio.core.packing.grain_kinds import GrainKinds, Progress, prepare_kinds, sphere_avatars
from mbstudio.core.packing.packer import pack
from mbstudio.core.packing.packing import INSET, Packing

MEASURES = ("porosity", "coordination", "anisotropy")
_LEVEL = 0.05


@dataclass(frozen=True)
class Mean:
    """A mean over packings of several seeds.

    Attributes
    ----------
    value : float
    error : float
        Standard error: the scatter of the packings over the root of their number.
    values : tuple of float
        Of each packing.
    """

    value: float
    error: float
    values: tuple[float, ...]

    @classmethod
    def of(cls, values: Sequence[float]) -> Mean:
        """Return the mean of two values or more."""
        array = np.asarray(values, dtype=float)
        return cls(float(array.mean()), float(array.std(ddof=1) / np.sqrt(len(array))), tuple(array.tolist()))


@dataclass(frozen=True)
class Difference:
    """How far two groups differ in one measure.

    Attributes
    ----------
    measure, first, second : str
    value : float
        Mean of the second less that of the first.
    error : float
        Standard error of it.
    chance : float
        Of so large a difference among packings that are alike (Welch's test, both sides).
    """

    measure: str
    first: str
    second: str
    value: float
    error: float
    chance: float

    @property
    def differs(self) -> bool:
        """Whether chance alone makes so large a difference less than once in twenty."""
        return self.chance < _LEVEL

    @property
    def within_an_error(self) -> bool:
        """Whether the means lie within one standard error of each other."""
        return abs(self.value) <= self.error


@dataclass(frozen=True)
class PackingComparison:
    """Groups of packings and how they differ.

    Attributes
    ----------
    means : mapping of str to mapping of str to Mean
        By group, then by measure.
    differences : tuple of Difference
        Of every group to the first, by measure.
    """

    means: Mapping[str, Mapping[str, Mean]]
    differences: tuple[Difference, ...]

    def difference(self, measure: str, second: str) -> Difference:
        """Return the difference of one measure between a group and the first."""
        return next(d for d in self.differences if d.measure == measure and d.second == second)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "groups": {
                name: {
                    measure: {"mean": mean.value, "error": mean.error, "values": list(mean.values)}
                    for measure, mean in measures.items()
                }
                for name, measures in self.means.items()
            },
            "differences": [
                {
                    "measure": one.measure,
                    "first": one.first,
                    "second": one.second,
                    "difference": one.value,
                    "error": one.error,
                    "chance": one.chance,
                    "differs": one.differs,
                }
                for one in self.differences
            ],
        }


def compare_packings(
    groups: Mapping[str, Sequence[Packing] | Sequence[Avatar]],
    *,
    seeds: int = 3,
    with_spheres: bool = False,
    inset: float = INSET,
    progress: Progress | None = None,
    **options: Any,
) -> PackingComparison:
    """Compare how kinds of grains pack.

    Parameters
    ----------
    groups : mapping of str to sequence of Packing or of Avatar
        For example ``{"parents": ..., "clones": ...}``; the others are compared with the first. Avatars are
        packed first, with the seeds 0, 1 and so on.
    seeds : int
        Packings of each group of avatars, at least 2.
    with_spheres : bool
        Add a group ``spheres``: those of the volumes of the first group's avatars.
    inset : float
        See :meth:`~mbstudio.core.packing.packing.Packing.measures`.
    progress : callable(share, message), optional
    **options
        As for :func:`~mbstudio.core.packing.packer.pack`.

    Raises
    ------
    PackingError
        If there are fewer than two groups, fewer than two packings in one, or two called "spheres".
    """
    waiting: dict[str, Sequence[Packing] | Sequence[Avatar] | GrainKinds] = dict(groups)
    if with_spheres:
        if "spheres" in waiting:
            raise PackingError(
                "A group is called 'spheres', as those of the comparison are: name it otherwise."
            )
        waiting["spheres"] = _spheres_of(next(iter(groups.values()), ()))
    if len(waiting) < 2:
        raise PackingError("A comparison needs two groups of grains, or one and spheres of the same sizes.")
    tell = progress or (lambda _share, _message: None)
    packings: dict[str, Sequence[Packing]] = {}
    for number, (name, group) in enumerate(waiting.items()):

        def tell_group(share: float, message: str, done: int = number, name: str = name) -> None:
            tell((done + share) / len(waiting), f"{name}: {message}")

        packings[name] = _packings_of(group, seeds, tell_group, options)
        if len(packings[name]) < 2:
            raise PackingError(
                f"'{name}' has {len(packings[name])} packings: an error needs at least 2 seeds."
            )
    return compare_means({name: means_of(group, inset) for name, group in packings.items()})


def _spheres_of(group: Sequence[Packing] | Sequence[Avatar]) -> Sequence[Avatar]:
    if group and isinstance(group[0], Packing):
        return sphere_avatars(group[0].kinds.diameters, group[0].unit)
    avatars = [body for body in group if isinstance(body, Avatar)]
    unit = avatars[0].unit
    volumes = [mass_properties(avatar.to(unit), 1.0).volume for avatar in avatars]
    return sphere_avatars([nominal_diameter(volume) for volume in volumes], unit)


def _packings_of(
    group: Sequence[Packing] | Sequence[Avatar] | GrainKinds,
    seeds: int,
    tell: Progress,
    options: Mapping[str, Any],
) -> Sequence[Packing]:
    """Return packings as they are, or pack avatars with several seeds."""
    if not isinstance(group, GrainKinds):
        made = [body for body in group if isinstance(body, Packing)]
        if len(made) == len(group):
            return made
        avatars = [body for body in group if isinstance(body, Avatar)]
        spheres = {"spheres": options["spheres"]} if "spheres" in options else {}
        group = prepare_kinds(avatars, progress=tell, **spheres)
    packings = []
    for seed in range(seeds):

        def tell_seed(share: float, message: str, done: int = seed) -> None:
            tell((done + share) / seeds, f"seed {done}: {message}")

        packings.append(pack(group, seed=seed, progress=tell_seed, **options))
    return packings


def means_of(packings: Sequence[Packing], inset: float = INSET) -> dict[str, Mean]:
    """Return the means of two packings or more, by measure."""
    found = [packing.measures(inset) for packing in packings]
    return {name: Mean.of([getattr(measures, name) for measures in found]) for name in MEASURES}


def compare_means(means: Mapping[str, Mapping[str, Mean]]) -> PackingComparison:
    """Return how groups differ from the first one, by their means."""
    first, *others = means
    differences = []
    for measure in MEASURES:
        reference = means[first][measure]
        for other in others:
            mean = means[other][measure]
            differences.append(
                Difference(
                    measure,
                    first,
                    other,
                    mean.value - reference.value,
                    float(np.hypot(mean.error, reference.error)),
                    _chance(reference, mean),
                )
            )
    return PackingComparison(means, tuple(differences))


def _chance(a: Mean, b: Mean) -> float:
    """Return how often packings that are alike have means so far apart (Welch's t test, both sides)."""
    squares = np.array([a.error**2, b.error**2])
    if not squares.any():
        return float(a.value == b.value)
    freedom = squares.sum() ** 2 / sum(
        square**2 / (len(mean.values) - 1) for square, mean in zip(squares, (a, b), strict=True)
    )
    return 2.0 * float(student.sf(abs(b.value - a.value) / np.sqrt(squares.sum()), freedom))
