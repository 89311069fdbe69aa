"""Grains shaped by hand, kept among the clones of their style."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mbstudio.core.cloning.clone_maker import CloneOptions, CloneRecipe
from mbstudio.core.cloning.surface_generation import SurfaceClone, SurfaceGeneration
from mbstudio.core.cloning.surface_studio import GrainShape, ShapedGrain, SurfaceStudio
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.populations.measuring import measure_population
from mbstudio.core.populations.population import Population

_KEPT = "shaped by hand"


def keep_shape(
    studio: SurfaceStudio, grain: ShapedGrain, clones: SurfaceGeneration | None
) -> SurfaceGeneration:
    """Return clones with a shaped grain added at their end, measured and with a metaball.

    Parameters
    ----------
    studio : SurfaceStudio
    grain : ShapedGrain
    clones : SurfaceGeneration or None
        Those there are already, of the same style.

    Raises
    ------
    CloningError
        If no metaball can be fitted.
    """
    taken = set() if clones is None else set(clones.names)
    number = next(k for k in range(1, len(taken) + 2) if f"shaped_{k}" not in taken)
    kept = keep_shapes(studio, [grain], [f"shaped_{number}"])
    if clones is None:
        return kept
    return replace(
        clones, clones=(*clones.clones, *kept.clones), factors=_joined(clones.factors, kept.factors)
    )


def keep_shapes(
    studio: SurfaceStudio,
    grains: Sequence[ShapedGrain],
    names: Sequence[str],
    progress: Callable[[float, str], None] | None = None,
) -> SurfaceGeneration:
    """Return shaped grains as clones, measured and each with a metaball.

    Parameters
    ----------
    studio : SurfaceStudio
    grains : sequence of ShapedGrain
        One at least.
    names : sequence of str
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work.

    Raises
    ------
    CloningError
        If no metaball can be fitted to one of them.
    """
    clones = []
    for place, (grain, name) in enumerate(zip(grains, names, strict=True)):
        if progress is not None:
            progress(place / len(grains), name)
        clones.append(_clone_of(studio, grain, name))
    factors = measure_population(
        [clone.mesh() for clone in clones], range(1, len(clones) + 1), name="clones", kind="clones",
        unit=studio.style.unit, workers=0,
    )  # fmt: skip
    return SurfaceGeneration(tuple(clones), factors, len(clones), _KEPT, (), 0, CloneOptions())


def _clone_of(studio: SurfaceStudio, grain: ShapedGrain, name: str) -> SurfaceClone:
    style, shape = studio.style, grain.shape
    recipe = CloneRecipe(
        shape.parent, shape.form, shape.turn, shape.warp, shape.diameter, shape.detail_stretch
    )
    told = describe_shape(shape, style) or _KEPT
    parent = style.parents[shape.parent].name
    return SurfaceClone(name, grain.surface, recipe, parent, style.unit, studio.fit(grain), told)


def describe_shape(shape: GrainShape, style: SurfaceStyle) -> str:
    """Return what was done to a parent beyond size, form and warp, in words; empty if nothing was."""
    told = []
    if shape.other is not None and shape.share > 0:
        told.append(f"{100 * shape.share:.0f} % of {style.parents[shape.other].name}")
    for name in ("coarse", "edges", "fine"):
        gain = getattr(shape.gains, name)
        if abs(gain - 1) > 1e-9:
            told.append(f"{name} x {gain:.3f}")
    return ", ".join(told)


def _joined(first: Population, second: Population) -> Population:
    """Return the rows of both, labelled from 1; what the second was not measured for is NaN."""
    count = len(first) + len(second)
    nothing = np.full(len(second), np.nan)
    return replace(
        first,
        labels=np.arange(1, count + 1),
        factors={
            name: np.concatenate([column, second.factors.get(name, nothing)])
            for name, column in first.factors.items()
        },
        reasons=(*first.reasons, *second.reasons),
        warnings=(*first.warnings, *second.warnings),
    )
