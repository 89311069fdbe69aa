"""A trial: kinds of grains packed with one seed or several, as the window shows and a project keeps it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import PackingError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.packing.comparing import PackingComparison, compare_means, means_of
from mbstudio.core.packing.frame import Watch
from mbstudio.core.packing.grain_kinds import GrainKinds, Progress, prepare_kinds, sphere_avatars
from mbstudio.core.packing.packer import pack
from mbstudio.core.packing.packing import INSET, Measures, Packing

_ROSE_BINS = 9
SPHERES = "spheres"
"""Name of the group of spheres that have the volumes of the first group's avatars."""


@dataclass(frozen=True, eq=False)
class PackingTrial:
    """Packings of one kind of grains or of several.

    Attributes
    ----------
    packings : mapping of str to Packing
        By the name of the kind, the packing of the first seed.
    comparison : PackingComparison or None
        Means over the seeds, and differences to the first kind; None for a single seed.
    inset : float
        Of the measures, see :meth:`~mbstudio.core.packing.packing.Packing.measures`.
    """

    packings: Mapping[str, Packing]
    comparison: PackingComparison | None = None
    inset: float = INSET

    @property
    def first(self) -> Packing:
        """The packing of the first kind."""
        return next(iter(self.packings.values()))


@dataclass(frozen=True, eq=False)
class Findings:
    """What is told of one packing.

    Attributes
    ----------
    summary : mapping
        See :meth:`~mbstudio.core.packing.packing.Packing.summary`.
    measures : Measures
    heights, by_height : float arrays, shape (layers,)
        Porosity by height.
    distances, by_distance : float arrays, shape (steps,)
        Porosity by the distance from the side walls.
    rose : float array, shape (bins,)
        How often normals point 0 to 90 degrees up, over chance.
    """

    summary: Mapping[str, Any]
    measures: Measures
    heights: Float[np.ndarray, " layers"]
    by_height: Float[np.ndarray, " layers"]
    distances: Float[np.ndarray, " steps"]
    by_distance: Float[np.ndarray, " steps"]
    rose: Float[np.ndarray, " bins"]

    @classmethod
    def of(cls, packing: Packing, inset: float = INSET) -> Findings:
        """Measure a packing.

        Raises
        ------
        PackingError
            If it has no inner part.
        """
        measures = packing.measures(inset)
        heights, walls = packing.profile(inset), packing.wall_profile(inset)
        return cls(
            packing.summary(inset),
            measures,
            heights["height"].to_numpy(),
            heights["porosity"].to_numpy(),
            walls["distance"].to_numpy(),
            walls["porosity"].to_numpy(),
            packing.rose(inset, _ROSE_BINS),
        )


def run_trial(
    groups: Mapping[str, Sequence[Avatar]],
    count: int = 200,
    *,
    seeds: int = 1,
    seed: int = 0,
    with_spheres: bool = False,
    spheres_alone: bool = False,
    inset: float = INSET,
    progress: Progress | None = None,
    watch: Watch | None = None,
    **options: Any,
) -> PackingTrial:
    """Pack kinds of grains with the seeds `seed`, `seed` + 1 and so on.

    Parameters
    ----------
    groups : mapping of str to sequence of Avatar
        The others are compared with the first.
    count : int
        Grains of each packing.
    seeds : int
        Packings of each kind; two or more give means, errors and differences.
    seed : int
    with_spheres : bool
        Also pack spheres of the volumes of the first group's avatars.
    spheres_alone : bool
        Pack only these.
    inset : float
    progress : callable(share, message), optional
    watch : callable(frame), optional
    **options
        As for :func:`~mbstudio.core.packing.packer.pack`.

    Raises
    ------
    PackingError
        If grains cannot be packed like that, or packings to be compared have no inner part.
    """
    if seeds < 1:
        raise PackingError(f"A packing needs at least 1 seed, not {seeds}.")
    if not groups or not all(groups.values()):
        raise PackingError("There are no avatars to pack: fit some grains first.")
    tell = progress or (lambda _share, _message: None)
    names = [*groups] if not spheres_alone else []
    names += [SPHERES] if with_spheres or spheres_alone else []
    rounds, prepared = len(names) * seeds, None
    made: dict[str, list[Packing]] = {}
    number = {"spheres": options["spheres"]} if "spheres" in options else {}
    for place, name in enumerate(names):
        start = place * seeds

        def tell_group(share: float, message: str, start: int = start, name: str = name) -> None:
            tell((start + 0.3 * share) / rounds, f"{name}: {message}" if rounds > 1 else message)

        if name == SPHERES and name not in groups:
            first = prepared or _kinds(next(iter(groups.values())), number, tell_group, options)
            kinds = prepare_kinds(sphere_avatars(first.diameters, first.unit))
        else:
            kinds = _kinds(groups[name], number, tell_group, options)
        prepared = prepared or kinds
        for turn in range(seeds):

            def tell_seed(share: float, message: str, done: int = start + turn, name: str = name) -> None:
                part = f"{name}, {done % seeds + 1} of {seeds}: " if rounds > 1 else ""
                tell((done + max(share, 0.3 if done % seeds == 0 else 0.0)) / rounds, part + message)

            packing = pack(kinds, count, seed=seed + turn, progress=tell_seed, watch=watch, **options)
            if seeds > 1:
                packing.measures(inset)  # what is too small to be measured is told at once
            made.setdefault(name, []).append(packing)
    comparison = None
    if seeds > 1:
        comparison = compare_means({name: means_of(packings, inset) for name, packings in made.items()})
    shown = {name: packings[0] for name, packings in made.items()}
    return PackingTrial(MappingProxyType(shown), comparison, inset)


def _kinds(
    avatars: Sequence[Avatar], number: Mapping[str, int], tell: Progress, options: Mapping[str, Any]
) -> GrainKinds:
    return prepare_kinds(
        avatars, spheres=number.get("spheres", 20), progress=tell, processes=options.get("processes")
    )
