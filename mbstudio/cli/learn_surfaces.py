"""``mbstudio learn --preset surfaces``: a style that keeps the surfaces of its parents."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.cli import console


def learn_surface_style(
    read: Callable[[], tuple[list[Any], list[str]]], title: str, folder: Path, n: int | None, seed: int,
    unit: str | None, processes: int, *, as_json: bool,
) -> None:  # fmt: skip
    """Learn a style of surfaces, save it into a folder and say what it is.

    Parameters
    ----------
    read : callable
        Returns bodies (grains, avatars or meshes) and their names.
    title : str
        What the parents are called.
    folder : Path
    n : int or None
        Control points of each avatar; None: by the residual of few.
    seed : int
    unit : str or None
        Of meshes that carry none.
    processes : int
    as_json : bool
    """
    from mbstudio.core.cloning.parent_avatars import fit_parents
    from mbstudio.core.cloning.surface_style import learn_surfaces
    from mbstudio.core.cloning.surface_style_file import save_surface_style
    from mbstudio.core.metaball.avatar import Avatar

    begun = time.monotonic()
    bodies, names = read()
    solid = [_mesh_of(body) if isinstance(body, Avatar) else body for body in bodies]
    with console.progress("Registering") as report:
        style = learn_surfaces(solid, names, unit=unit, seed=seed, progress=report)
    with console.progress("Fitting avatars") as report:
        style = fit_parents(style, n, processes=processes, progress=report)
    save_surface_style(style, folder)
    errors = np.array([entry.rms for entry in style.avatars])
    summary = {
        "style": str(folder),
        "preset": "surfaces",
        "parents": len(style.parents),
        "control_points": len(style.avatars[0].avatar.weights),
        "warps": len(style.modes),
        "avatars_rms_percent_of_dn": 100 * float(errors.mean()),
        "invalid_avatars": int(sum(not entry.valid for entry in style.avatars)),
        "seconds": round(time.monotonic() - begun, 1),
    }
    if as_json:
        console.print_json(summary)
    else:
        console.print_facts(f"Style of {title}", summary)


def _mesh_of(avatar: Any) -> Any:
    mesh = avatar.mesh(cells=64)
    mesh.units = avatar.unit
    return mesh
