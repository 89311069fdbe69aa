"""What the mesh targets (STL, OBJ, PLY) share: making the meshes and checking them when read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.dem.formats.shape_checks import MESH_SCRIPT, check_script, write_script
from mbstudio.core.dem.shapes.mesh_target import FEWEST_CELLS, MOST_CELLS, mesh_of
from mbstudio.core.dem.shapes.remesh import angles_of
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError
from mbstudio.core.metrics.mass import volume_integrals
from mbstudio.core.options import Option

if TYPE_CHECKING:
    import trimesh

ERROR = Option(
    0.0,
    "largest distance of mesh and avatar in % of D_n: as few cells as stay within it, up to "
    f"{MOST_CELLS}; 0: as many as 'cells' says",
    0.0,
    20.0,
    unit="% of Dₙ",
    step=0.1,
)
OPTIONS = MappingProxyType(
    {
        "cells": Option(
            32,
            "edges along the longest side of each grain: more give a finer mesh",
            FEWEST_CELLS,
            MOST_CELLS,
        ),
        "error": ERROR,
    }
)
ACCEPTED_ANGLE = 1.0
"""Engines reject slivers; LIGGGHTS draws the line at 0.256 degrees."""


WriteMesh = Callable[["trimesh.Trimesh", Path, Mapping[str, Any]], None]


def mesh_target(suffix: str, write_one: WriteMesh, further: Mapping[str, Option] | None = None) -> Target:
    """Return the target of a mesh format: one file a body, and a script that checks them all.

    Parameters
    ----------
    suffix : str
        Of the files; also the target's name.
    write_one : callable(mesh, path, options)
        Writes one mesh.
    further : mapping of str to Option, optional
        Options beside those of every mesh.
    """

    def write(job: Job) -> Written:
        written = write_meshes(job, suffix, write_one)
        return Written(written.item_files, written.item_details, (write_script(job.folder, MESH_SCRIPT),))

    return Target(
        name=suffix,
        title=f"{suffix.upper()} meshes",
        geometry="mesh",
        needs_density=False,
        default_unit="m",
        write=write,
        validate=validate_meshes,
        options=MappingProxyType({**OPTIONS, **(further or {})}),
    )


def write_meshes(job: Job, suffix: str, write_one: WriteMesh) -> Written:
    """Write one mesh file a body and describe it; no example beside them."""
    files, details = [], []
    for index, body in enumerate(job.bodies):
        tell = partial(_tell, job, index / len(job.bodies), body.name)
        made = mesh_of(body, int(job.options["cells"]), job.options["error"] / 100, tell)
        name = f"{body.name}.{suffix}"
        write_one(made.mesh, job.folder / name, job.options)
        files.append((name,))
        details.append({**describe_mesh(made.mesh), "cells": made.cells, "hausdorff_over_Dn": made.error})
        if made.warning:
            details[-1]["warnings"] = [f"{body.name}: {made.warning}"]
    return Written(files, details)


def _tell(job: Job, fraction: float, name: str, cells: int) -> None:
    job.progress(fraction, f"Meshing {name}, {cells} cells across")


def describe_mesh(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """Return what the manifest says about a mesh."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    angles = np.degrees(angles_of(vertices, faces))
    edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2)
    return {
        "vertices": len(vertices),
        "triangles": len(faces),
        "euler_number": len(vertices) - len(faces) // 2,
        "smallest_angle_degrees": float(angles.min()),
        "mean_smallest_angle_degrees": float(angles.min(axis=1).mean()),
        "mean_edge": float(edges.mean()),
        "longest_edge": float(edges.max()),
        "volume": float(volume_integrals(vertices, faces)[0]),
    }


def validate_meshes(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read every mesh back: closed, outward, without slivers, of the stated volume, centred.

    Raises
    ------
    ExportError
        Naming the file and what is wrong with it.
    """
    for item in manifest["items"]:
        (name,) = item["files"]
        check_mesh(folder / name, read_mesh(folder / name), item)
    check_script(folder, MESH_SCRIPT)


def check_mesh(path: Path, mesh: trimesh.Trimesh, item: Mapping[str, Any]) -> None:
    """Raise ExportError unless a mesh is the closed body that the manifest describes.

    Parameters
    ----------
    path : Path
        For messages.
    mesh : trimesh.Trimesh
    item : mapping
        The manifest's entry.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if not len(faces) or not np.isfinite(vertices).all():
        raise ExportError(f"{path} has no faces, or vertices that are not finite numbers.")
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        raise ExportError(f"{path} is not a closed, consistently oriented surface.")
    if len(faces) != item["details"]["triangles"]:
        raise ExportError(
            f"{path} has {len(faces)} triangles; the manifest says {item['details']['triangles']}."
        )
    integrals = volume_integrals(vertices, faces)
    if integrals[0] <= 0:
        raise ExportError(f"{path} is inside out: its volume is {integrals[0]:g}.")
    if abs(integrals[0] / item["volume"] - 1) > 0.02:
        raise ExportError(
            f"{path} has a volume of {integrals[0]:g}, the avatar {item['volume']:g}: give more 'cells'."
        )
    size = float(np.ptp(vertices, axis=0).max())
    if np.abs(integrals[1:4] / integrals[0]).max() > 0.005 * size:
        raise ExportError(f"{path} does not have its centre of mass at the origin.")
    if float(np.degrees(angles_of(vertices, faces)).min()) < ACCEPTED_ANGLE:
        raise ExportError(
            f"{path} has triangles thinner than {ACCEPTED_ANGLE:g} degree, which engines refuse."
        )


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Read a mesh file with vertices of the same place merged; ExportError if it cannot be read."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=True, merge_norm=True, merge_tex=True)
    except Exception as error:  # trimesh raises whatever its parsers meet
        raise ExportError(f"{path} cannot be read back ({error}).") from error
    if not isinstance(mesh, trimesh.Trimesh):
        raise ExportError(f"{path} does not contain exactly one mesh.")
    return mesh
