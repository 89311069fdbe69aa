"""Correcting the voxel size afterwards: every length of a project follows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.errors import ProjectError
from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.project.state import ProjectState
from mbstudio.core.units import VoxelSize, conversion_factor

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_style import SurfaceStyle
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.metaball.avatar import Avatar
    from mbstudio.core.populations.population import Population
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.serialize.serialization import Serialization

_ONE_FACTOR = 1e-9
"""Relative difference of the edges' ratios below which voxels keep their form."""
_OF_THESE_GRAINS = 0.05
"""Median relative difference of parents' and grains' D_n below which a style is one of these grains."""


@dataclass(frozen=True)
class VoxelSizeCorrection:
    """What a correction of the voxel size does.

    Attributes
    ----------
    state : ProjectState
        With all lengths corrected.
    before, after : VoxelSize
    factor : float or None
        By which all lengths are multiplied, taken in one unit; None where voxels change their form.
    median_diameters : tuple of float, or None
        Median nominal diameter of the grains before and after, in the unit of each; None without grains.
    notes : tuple of str
        What cannot follow, and what becomes of it.
    """

    state: ProjectState
    before: VoxelSize
    after: VoxelSize
    factor: float | None
    median_diameters: tuple[float, float] | None
    notes: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        return f"Correct the voxel size to {self.after}"


def correct_voxel_size(state: ProjectState, size: VoxelSize) -> VoxelSizeCorrection:
    """Return a project's state as if its scan had been opened with another voxel size.

    Scan, grains and their measures follow exactly. Where voxels keep their form, avatars, the style-learner
    of these grains, its clones and the grains kept of it are scaled; else they cannot follow, and go.

    Raises
    ------
    ProjectError
        If there is neither scan nor grains, the grains come from meshes, or nothing would change.
    """
    before = state.scan.voxel_size if state.scan is not None else None
    if before is None and state.grains is not None:
        before = state.grains.voxel_size
    if before is None:
        raise ProjectError("The project has neither scan nor grains whose voxel size could be corrected.")
    if state.grains is not None and state.grains.is_of_meshes:
        raise ProjectError(
            "These grains come from mesh files, whose lengths are exact: open the files again in their unit."
        )
    ratios = np.array(size.zyx) * conversion_factor(size.unit, before.unit) / np.array(before.zyx)
    if size.unit == before.unit and np.abs(ratios - 1).max() < _ONE_FACTOR:
        raise ProjectError(f"The voxel size is {before} already.")
    factor = float(ratios[0]) if np.ptp(ratios) <= _ONE_FACTOR * ratios[0] else None
    state_of_scan = _with_scan_and_grains(state, before, size)
    if factor is None:
        found, notes = _without_bodies(state_of_scan, state)
    else:
        found, notes = _with_scaled_bodies(state_of_scan, state, before, size, factor)
    if found.packing is not None:
        found = replace(found, packing=None)
        notes = (*notes, "The packing was of grains of other sizes: it is removed. Pack them again.")
    return VoxelSizeCorrection(found, before, size, factor, _medians(state.grains, found.grains), notes)


def _medians(before: GrainSet | None, after: GrainSet | None) -> tuple[float, float] | None:
    if before is None or after is None or not len(before):
        return None
    first, second = (
        float(np.median(nominal_diameters(one.table["volume"].to_numpy(float)))) for one in (before, after)
    )
    return first, second


# ---- scan and grains -----------------------------------------------------------------------------


def _moved(
    origin: tuple[float, float, float], before: VoxelSize, after: VoxelSize
) -> tuple[float, float, float]:
    """Return an origin (x, y, z) so many voxels from that of the scanner as it was."""
    x, y, z = (float(at / old * new) for at, old, new in zip(origin, before.xyz, after.xyz, strict=True))
    return x, y, z


def _with_scan_and_grains(state: ProjectState, before: VoxelSize, after: VoxelSize) -> ProjectState:
    scan, grains = state.scan, state.grains
    if scan is not None:
        scan = replace(scan, voxel_size=after, origin=_moved(scan.origin, before, after))
    if grains is not None:
        old, origin = grains.voxel_size, _moved(grains.origin, grains.voxel_size, after)
        table = grains.table.copy()
        table["volume"] = table["voxels"] * after.volume
        for place, axis in enumerate("xyz"):
            voxels = (table[axis] - grains.origin[place]) / old.xyz[place]
            table[axis] = origin[place] + voxels * after.xyz[place]
        grains = replace(grains, voxel_size=after, origin=origin, table=table)
    return replace(state, scan=scan, grains=grains)


# ---- avatars, styles, clones ---------------------------------------------------------------------


def _without_bodies(state: ProjectState, before: ProjectState) -> tuple[ProjectState, tuple[str, ...]]:
    """Take out what was fitted to grains of another form."""
    notes = []
    if state.fits:
        which = "an avatar no longer lies on its grain: it is removed"
        if len(state.fits) > 1:
            which = f"{len(state.fits)} avatars no longer lie on their grains: they are removed"
        notes.append(f"The voxels change their form, so that {which}. Fit the grains again.")
    if state.twin is not None:
        notes.append("The twin and its contacts go too.")
    empty: Mapping[int, FitResult] = MappingProxyType({})
    found = replace(state, fits=empty, outdated=empty, twin=None)
    if state.style is not None:
        if _is_of_these_grains(state.style, before):
            notes.append("The style of these grains, its clones and the grains kept of it go too.")
            found = replace(found, style=None, clones=None, kept=())
        else:
            notes.append(_OTHER_STYLE)
    if state.surfaces is not None:
        if _has_surfaces_of_these_grains(state.surfaces, before):
            notes.append("The style of these grains and its clones go too.")
            found = replace(found, surfaces=None, surface_clones=None)
        else:
            notes.append(_OTHER_STYLE)
    return found, tuple(notes)


_OTHER_STYLE = "The style was not learned from these grains: its sizes, and its clones, stay as they are."


def _with_scaled_bodies(
    state: ProjectState, before: ProjectState, old: VoxelSize, new: VoxelSize, factor: float
) -> tuple[ProjectState, tuple[str, ...]]:
    fits = {label: _scaled_fit(fit, new.unit, factor) for label, fit in state.fits.items()}
    outdated = {label: fits[label] for label, fit in state.outdated.items() if state.fits.get(label) is fit}
    twin = None if state.twin is None else state.twin.scaled(new.unit, factor)
    found = replace(state, fits=MappingProxyType(fits), outdated=MappingProxyType(outdated), twin=twin)
    if state.surfaces is not None:
        if not _has_surfaces_of_these_grains(state.surfaces, before):
            return found, (_OTHER_STYLE,)
        clones_of_surfaces = state.surface_clones
        if clones_of_surfaces is not None:
            factors = _scaled_population(clones_of_surfaces.factors, factor)
            assert factors is not None
            clones_of_surfaces = replace(clones_of_surfaces.scaled(factor), factors=factors)
        return replace(found, surfaces=state.surfaces.scaled(factor), surface_clones=clones_of_surfaces), ()
    if state.style is None:
        return found, ()
    if not _is_of_these_grains(state.style, before):
        return found, (_OTHER_STYLE,)
    from mbstudio.core.vae.shaping.latent_recipe import style_digest  # late: torch is not needed without

    told = f"All sizes were multiplied by {factor:.6g} when the voxel size was corrected from {old} to {new}."
    style = _scaled_style(state.style, factor, told)
    mine = style_digest(state.style)
    kept = tuple(
        replace(one, factors=(one.factors[0] * factor, *one.factors[1:])) if one.recipe.style == mine else one
        for one in state.kept
    )
    clones = None if state.clones is None else _scaled_clones(state.clones, factor)
    return replace(found, style=style, clones=clones, kept=kept), ()


def _scaled_avatar(avatar: Avatar, unit: str, factor: float) -> Avatar:
    scale = factor * conversion_factor(avatar.unit, unit)
    return replace(avatar, centers=avatar.centers * scale, weights=avatar.weights * scale**2, unit=unit)


def _scaled_fit(fit: FitResult, unit: str, factor: float) -> FitResult:
    scale = factor * conversion_factor(fit.avatar.unit, unit)
    verdict = fit.verdict
    said = f"{verdict.rms:.3g} {fit.avatar.unit} (rms)"
    rms = verdict.rms * scale
    verdict = replace(
        verdict,
        rms=rms,
        smallest_neck=None if verdict.smallest_neck is None else verdict.smallest_neck * scale,
        reasons=tuple(reason.replace(said, f"{rms:.3g} {unit} (rms)") for reason in verdict.reasons),
    )
    return replace(
        fit,
        avatar=_scaled_avatar(fit.avatar, unit, factor),
        rms_history=np.asarray(fit.rms_history) * scale,
        verdict=verdict,
    )


def _is_of_these_grains(style: StyleLearner, state: ProjectState) -> bool:
    """Whether a style was learned from avatars of the project, by their names and sizes."""
    grains = state.grains
    if grains is None:
        return False
    volumes = dict(zip(grains.table["label"].tolist(), grains.table["volume"].tolist(), strict=True))
    own = {
        fit.avatar.name: float(nominal_diameters(np.array([volumes[label]]))[0])
        for label, fit in state.fits.items()
        if label in volumes
    }
    to_own = conversion_factor(style.parents.unit, grains.unit)
    differences = [
        abs(diameter * to_own / own[name] - 1)
        for name, diameter in zip(style.parents.names, style.parents.diameters.tolist(), strict=True)
        if name in own
    ]
    known = 2 * len(differences) > len(style.parents)
    return known and float(np.median(differences)) < _OF_THESE_GRAINS


def _has_surfaces_of_these_grains(style: SurfaceStyle, state: ProjectState) -> bool:
    """Whether a style of surfaces was learned from grains of the project, by their names and sizes."""
    grains = state.grains
    if grains is None:
        return False
    labels, volumes = grains.table["label"].tolist(), grains.table["volume"].to_numpy(float)
    own = dict(zip((f"grain {label}" for label in labels), nominal_diameters(volumes).tolist(), strict=True))
    to_own = conversion_factor(style.unit, grains.unit)
    differences = [
        abs(parent.diameter * to_own / own[parent.name] - 1) for parent in style.parents if parent.name in own
    ]
    known = 2 * len(differences) > len(style.parents)
    return known and float(np.median(differences)) < _OF_THESE_GRAINS


def _scaled_style(style: StyleLearner, factor: float, told: str) -> StyleLearner:
    card = style.card
    card = replace(
        card,
        smallest=card.smallest * factor,
        largest=card.largest * factor,
        notes=(*card.notes, told),
        quality={},  # it compares lengths
    )
    return replace(
        style,
        model=style.model.with_sizes(factor),
        parents=_scaled_bodies(style.parents, factor),
        card=card,
    )


def _scaled_bodies(bodies: Serialization, factor: float) -> Serialization:
    return replace(bodies, diameters=bodies.diameters * factor)


def _scaled_clones(clones: Generation, factor: float) -> Generation:
    return replace(
        clones,
        clones=_scaled_bodies(clones.clones, factor),
        factors=_scaled_population(clones.factors, factor),
        parent_factors=_scaled_population(clones.parent_factors, factor),
        reached=(),  # what was asked for was asked in other lengths
    )


def _scaled_population(population: Population | None, factor: float) -> Population | None:
    if population is None:
        return None
    factors = {name: values * factor ** FACTORS[name].power for name, values in population.factors.items()}
    return replace(population, factors=factors)
