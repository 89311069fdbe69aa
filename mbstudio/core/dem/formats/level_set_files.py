"""What level-set targets share: a grid with shape, shell, mass and moments in one ``.npz`` a body.

``<name>.npz`` (NumPy, no pickles) holds ``grid`` (nx, ny, nz; float32; negative inside), ``origin`` (3),
``spacing``, ``shell`` (points on the surface, m x 3), ``mass`` in kg, ``moments`` (3, ascending, in kg
unit**2), ``volume`` in unit**3 and ``radius``, that of the bounding sphere about the origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.dem.shapes.level_set import LevelSet, check_level_set, level_set
from mbstudio.core.dem.shapes.remesh import well_shaped_mesh
from mbstudio.core.dem.target import Job, Written
from mbstudio.core.errors import ExportError
from mbstudio.core.options import Option
from mbstudio.core.plain_files import PlainFileError, read_npz
from mbstudio.core.units import METRES_PER_UNIT

OPTIONS = MappingProxyType(
    {
        "cells": Option(32, "grid cells along the longest side of each grain", 12, 200),
        "padding": Option(3, "grid cells around each grain", 2, 20),
        "shell": Option(14, "edges of the contact points' mesh along the longest side", 8, 60),
    }
)
_SHAPES = {
    "grid": 3,
    "origin": 1,
    "spacing": 0,
    "shell": 2,
    "mass": 0,
    "moments": 1,
    "volume": 0,
    "radius": 0,
}


def write_level_sets(job: Job) -> Written:
    """Write one grid file a body and describe it."""
    files, details = [], []
    for index, body in enumerate(job.bodies):
        job.progress(index / len(job.bodies), f"Distances to {body.name}")
        grid = level_set(body.avatar, int(job.options["cells"]), int(job.options["padding"]))
        mesh = well_shaped_mesh(body.avatar, int(job.options["shell"]), body.mass.volume)
        shell = np.asarray(mesh.vertices, dtype=np.float32)
        radius = float(np.linalg.norm(np.asarray(mesh.vertices), axis=1).max()) + grid.spacing
        name = f"{body.name}.npz"
        np.savez(
            job.folder / name,
            grid=grid.values.astype(np.float32),
            origin=grid.origin,
            spacing=grid.spacing,
            shell=shell,
            mass=body.mass.mass,
            moments=body.mass.principal,
            volume=body.mass.volume,
            radius=radius,
        )
        files.append((name,))
        details.append(
            {
                "nodes": list(grid.values.shape),
                "spacing": grid.spacing,
                "shell_points": len(shell),
                "grid_volume": grid.volume,
                "radius": radius,
            }
        )
    return Written(files, details)


def read_level_set(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a grid file; ExportError if it cannot be read or lacks one."""
    try:
        found = read_npz(path)
    except PlainFileError as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error
    for name, dimensions in _SHAPES.items():
        if name not in found:
            raise ExportError(f"{path} lacks '{name}'.")
        if (
            found[name].dtype.kind not in "fiu"
            or found[name].ndim != dimensions
            or not np.isfinite(found[name]).all()
        ):
            raise ExportError(f"'{name}' in {path} has the wrong shape or is not finite.")
    return found


def check_level_set_file(path: Path, item: Mapping[str, Any], unit: str) -> None:
    """Raise ExportError unless a grid file is the body that the manifest describes.

    Raises
    ------
    ExportError
        For what an engine would swallow: a cropped grid, distances with the wrong sign or scale, another
        mass or inertia, contact points off the surface, a bounding sphere that does not bound.
    """
    found = read_level_set(path)
    metres = METRES_PER_UNIT[unit]
    grid = LevelSet(found["grid"], found["origin"], float(found["spacing"]), unit)
    if list(grid.values.shape) != item["details"]["nodes"]:
        raise ExportError(f"The number of nodes in {path} differs from the manifest.")
    check_level_set(str(path), grid, item["volume"])
    stated = [float(found["mass"]), float(found["volume"]), *(found["moments"] * metres**2)]
    if not np.allclose(stated, [item["mass"], item["volume"], *item["moments"]], rtol=1e-9, atol=0):
        raise ExportError(f"Mass, volume or moments in {path} differ from the manifest.")
    check_moments(item["name"], stated[0], stated[2:])
    shell = found["shell"]
    if shell.shape[1:] != (3,) or len(shell) != item["details"]["shell_points"]:
        raise ExportError(f"The number of contact points in {path} differs from the manifest.")
    place = (shell - grid.origin) / grid.spacing
    inside = ((place >= 0) & (place <= np.array(grid.values.shape) - 1)).all()
    nearest = tuple(np.rint(place).astype(int).T) if inside else None
    if nearest is None or np.abs(grid.values[nearest]).max() > grid.spacing:
        raise ExportError(f"{path} has contact points that do not lie on the surface.")
    if np.linalg.norm(shell, axis=1).max() > float(found["radius"]):
        raise ExportError(f"{path} has a bounding sphere that does not hold the grain.")
