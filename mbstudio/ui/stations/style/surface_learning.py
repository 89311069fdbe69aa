"""Learning a style of surfaces: parents are read, registered to each other, and each gets a metaball."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.project import ProjectState
from mbstudio.core.threads import one_thread
from mbstudio.ui.language import tr
from mbstudio.ui.stations.style.parents import Parents
from mbstudio.ui.workers import Control

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_style import SurfaceStyle

SURFACES = "surfaces"
"""Name of the preset, as on the command line."""
_CELLS = 64  # along the longest side of an avatar whose surface is a parent
_MANY = 16  # parents for which starting processes pays
_READ, _REGISTERED = 0.08, 0.25  # shares of the work after which that is done


def learned_surfaces(
    state: ProjectState, parents: Parents, n: int | None, seed: int, control: Control,
    onto: SurfaceStyle | None = None,
) -> tuple[SurfaceStyle, tuple[str, ...]]:  # fmt: skip
    """Return the style of a request's parents with their metaballs, and what is to be said of it.

    Parameters
    ----------
    state : ProjectState
    parents : Parents
    n : int or None
        Control points of each metaball; None: by what few leave.
    seed : int
    control : Control
        Told of the progress; its reports are places to pause and to cancel.
    onto : SurfaceStyle, optional
        Whose parents stay, and to which those of the request are added.
    """
    from mbstudio.core.cloning.parent_avatars import fit_parents
    from mbstudio.core.cloning.parents_gap import find_gap
    from mbstudio.core.cloning.surface_style import style_of

    kept = [] if onto is None else list(onto.parents)
    bodies, names = _bodies(state, parents)
    for place, (body, name) in enumerate(zip(bodies, names, strict=True)):
        control.progress(_READ * place / len(bodies), tr("Reading {name}", name=name))
        kept.append(_parent(body, name, parents.unit))
    with one_thread():
        style = style_of(
            kept,
            seed=seed,
            progress=lambda share, told: control.progress(_READ + (_REGISTERED - _READ) * share, told),
        )
    processes = usable_cores() if len(kept) >= _MANY else 1
    style = fit_parents(
        style,
        n,
        known=() if onto is None else onto.avatars,
        processes=processes,
        progress=lambda share, told: control.progress(_REGISTERED + (1 - _REGISTERED) * share, told),
    )
    gap = find_gap(style)
    return style, () if gap is None else (str(gap),)


def _bodies(state: ProjectState, parents: Parents) -> tuple[list[Any], list[str]]:
    if parents.source == "folder":
        from mbstudio.core.vae.serialize.mesh_folder import read_parents

        return read_parents(parents.folder or Path(), parents.unit)
    names = [f"grain {label}" for label in parents.labels]
    if parents.source == "avatars":
        return [state.fits[label].avatar for label in parents.labels], names
    assert state.grains is not None
    return [state.grains.body(label, fill_cavities=True) for label in parents.labels], names


def _parent(body: Any, name: str, unit: str | None) -> Any:
    from mbstudio.core.cloning.parent_surface import ParentSurface
    from mbstudio.core.grains.grain import Grain
    from mbstudio.core.metaball.avatar import Avatar

    if isinstance(body, Grain):
        return ParentSurface.from_grain(body, name)
    if isinstance(body, Avatar):
        mesh = body.mesh(cells=_CELLS)
        mesh.units = body.unit
        return ParentSurface.from_mesh(mesh, name)
    return ParentSurface.from_mesh(body, name, unit)
