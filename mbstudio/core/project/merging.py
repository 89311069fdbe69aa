"""Bringing together what two programs have made of one project."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.errors import ProjectError
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.project.state import ProjectState

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_generation import SurfaceGeneration
    from mbstudio.core.cloning.surface_style import SurfaceStyle
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.shaping.kept_grain import KeptGrain


@dataclass(frozen=True, eq=False)
class Merge:
    """What came of it.

    Attributes
    ----------
    state : ProjectState
        Ours with theirs in it.
    added : int
        Avatars and kept grains that were only in theirs.
    in_both : tuple of int
        Labels of grains that both have fitted; ours was kept.
    """

    state: ProjectState
    added: int
    in_both: tuple[int, ...]


def merge_states(base: ProjectState | None, ours: ProjectState, theirs: ProjectState) -> Merge:
    """Return our state with what another program has added to the file meanwhile.

    Parameters
    ----------
    base : ProjectState or None
        What the file held when we began; None if that is not known.
    ours : ProjectState
        What we have made of it; what we did not change is the same object as in `base`.
    theirs : ProjectState
        What the file holds now.

    Raises
    ------
    ProjectError
        If the two are not of the same grains, or both have another style-learner or other clones: then
        there is no telling what belongs together.
    """
    begun = base or ProjectState()
    if not _same_scan(ours, theirs) or not _same_grains(ours.grains, theirs.grains):
        raise ProjectError(
            "The grains in the file are others than these, so the avatars cannot be brought together: save a "
            "copy, or open the file anew."
        )
    changed = {label: fit for label, fit in ours.fits.items() if begun.fits.get(label) is not fit}
    removed = begun.fits.keys() - ours.fits.keys()
    fits = {label: fit for label, fit in theirs.fits.items() if label not in removed} | changed
    in_both = [
        label
        for label in changed.keys() & theirs.fits.keys()
        if not same_fit(theirs.fits[label], begun.fits.get(label))
        and not same_fit(theirs.fits[label], changed[label])
    ]
    kept, kept_added = _merged_kept(begun.kept, ours.kept, theirs.kept)
    styled = _styled(begun, ours, theirs)
    settings = theirs.fit_settings if ours.fit_settings is begun.fit_settings else ours.fit_settings
    outdated = {
        label: fit
        for label, fit in fits.items()
        if ours.outdated.get(label) is fit or theirs.outdated.get(label) is fit
    }
    state = replace(
        ours,
        fits=_sorted(fits),
        outdated=_sorted(outdated),
        kept=kept,
        style=styled.style,
        clones=styled.clones,
        surfaces=styled.surfaces,
        surface_clones=styled.surface_clones,
        fit_settings=settings,
        strokes=theirs.strokes if ours.strokes is begun.strokes else ours.strokes,
        packing=theirs.packing if ours.packing is begun.packing else ours.packing,
        classifier=theirs.classifier if ours.classifier is begun.classifier else ours.classifier,
        twin=theirs.twin if ours.twin is begun.twin else ours.twin,
    )
    added = len(fits.keys() - ours.fits.keys()) + kept_added
    return Merge(state, added, tuple(sorted(in_both)))


def _sorted(fits: Mapping[int, FitResult]) -> Mapping[int, FitResult]:
    return MappingProxyType({label: fits[label] for label in sorted(fits)})


def _same_scan(ours: ProjectState, theirs: ProjectState) -> bool:
    if ours.scan is None or theirs.scan is None:
        return ours.scan is theirs.scan
    return ours.scan.identity == theirs.scan.identity


def _same_grains(ours: GrainSet | None, theirs: GrainSet | None) -> bool:
    if ours is None or theirs is None:
        return ours is theirs
    place = (ours.voxel_size, tuple(ours.origin)) == (theirs.voxel_size, tuple(theirs.origin))
    return place and np.array_equal(ours.labels, theirs.labels)


def same_fit(one: FitResult, other: FitResult | None) -> bool:
    """Return whether two fits are of one avatar."""
    return (
        other is not None
        and np.array_equal(one.avatar.centers, other.avatar.centers)
        and np.array_equal(one.avatar.weights, other.avatar.weights)
    )


def _merged_kept(
    base: tuple[KeptGrain, ...], ours: tuple[KeptGrain, ...], theirs: tuple[KeptGrain, ...]
) -> tuple[tuple[KeptGrain, ...], int]:
    """Return ours and those that theirs has besides, under names of their own, and how many those are."""
    names = {grain.name for grain in ours}
    added = []
    for grain in theirs:
        if grain in ours or grain in base:  # there already, or removed by us
            continue
        name, number = grain.name, 2
        while name in names:
            name, number = f"{grain.name} {number}", number + 1
        names.add(name)
        added.append(replace(grain, recipe=replace(grain.recipe, name=name)))
    return (*ours, *added), len(added)


def _styled(base: ProjectState, ours: ProjectState, theirs: ProjectState) -> ProjectState:
    """Return whose style-learner and clones stay, which belong together: those of who changed them."""
    if all(getattr(ours, name) is getattr(base, name) for name in _STYLED):
        return theirs
    for other in (base, ours):
        if (
            _same_latents(theirs.style, other.style)
            and _same_latents(theirs.clones, other.clones)
            and _same_surfaces(theirs.surfaces, other.surfaces)
            and _same_surface_clones(theirs.surface_clones, other.surface_clones)
        ):
            return ours
    raise ProjectError(
        "The file has another style-learner or other clones than these by now: save a copy, or open the file "
        "anew."
    )


_STYLED = ("style", "clones", "surfaces", "surface_clones")


def _same_surfaces(one: SurfaceStyle | None, other: SurfaceStyle | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one.modes, other.modes) and np.array_equal(one.log_diameters, other.log_diameters)


def _same_surface_clones(one: SurfaceGeneration | None, other: SurfaceGeneration | None) -> bool:
    if one is None or other is None:
        return one is other
    return one.names == other.names and all(
        np.array_equal(a.surface.vertices, b.surface.vertices)
        for a, b in zip(one.clones, other.clones, strict=True)
    )


def _same_latents(one: StyleLearner | Generation | None, other: StyleLearner | Generation | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one.latents, other.latents)
