"""What an export would hand over of one avatar, to look at before anything is written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.formats.clump_files import CLUMP_GOAL
from mbstudio.core.dem.formats.meshes import describe_mesh
from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.dem.shapes.clump_goal import clump_for_target
from mbstudio.core.dem.shapes.level_set import LevelSet, level_set
from mbstudio.core.dem.shapes.mesh_target import BodyMesh, mesh_of
from mbstudio.core.dem.target import Geometry, Progress, complete_options, find_target
from mbstudio.core.formulas import nominal_diameter

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class ExportPreview:
    """One avatar as a target gets it.

    Attributes
    ----------
    geometry : {"clump", "mesh", "grid", "metaball"}
    body : DemBody
        The avatar in its principal frame; all lengths are in its unit.
    figures : mapping of str to float
        How true it is. Errors are shares; lengths end in ``_length``.

        - clump: spheres, iou, volume_error, inertia_error, hausdorff (over D_n), hausdorff_length,
          smallest_radius_length;
        - mesh: cells, triangles, smallest_angle (degrees), watertight (0 or 1), euler_number,
          mean_edge_length, longest_edge_length, volume_error, hausdorff (over D_n), hausdorff_length;
        - grid: nodes, spacing_length, volume_error;
        - metaball: control_points.
    clump : Clump or None
    mesh : trimesh.Trimesh or None
        Of a mesh; of a grid its zero.
    warning : str
        That a clump misses its target, or a mesh the error asked for; else empty.
    """

    geometry: Geometry
    body: DemBody
    figures: Mapping[str, float]
    clump: Clump | None = None
    mesh: trimesh.Trimesh | None = None
    warning: str = ""


def preview(
    body: DemBody, target: str, options: Mapping[str, Any], progress: Progress | None = None
) -> ExportPreview:
    """Make of one avatar what an export with these options would hand over.

    Parameters
    ----------
    body : DemBody
    target : str
    options : mapping
        Of the target; those that are missing are at their defaults.
    progress : callable(fraction, message), optional
        Raising in it cancels.

    Raises
    ------
    ExportError
        If target or options are none.
    """
    chosen = find_target(target)
    given = complete_options(chosen, options)
    if chosen.geometry == "clump":
        return _clump(body, given, progress)
    if chosen.geometry == "mesh":
        made = mesh_of(body, int(given["cells"]), given["error"] / 100, _make_try_callback(progress))
        return ExportPreview("mesh", body, _mesh_figures(made, body), mesh=made.mesh, warning=made.warning)
    if chosen.geometry == "grid":
        grid = level_set(body.avatar, int(given["cells"]), int(given["padding"]))
        figures = {
            "nodes": float(grid.values.size),
            "spacing_length": grid.spacing,
            "volume_error": grid.volume / body.mass.volume - 1,
        }
        return ExportPreview("grid", body, figures, mesh=_zero_of(grid))
    return ExportPreview("metaball", body, {"control_points": float(body.avatar.n)})


def _clump(body: DemBody, given: Mapping[str, Any], progress: Progress | None) -> ExportPreview:
    warning = ""
    if given[CLUMP_GOAL]:
        found = clump_for_target(body.avatar, given[CLUMP_GOAL], progress=progress)
        clump, warning = found.clump, found.warning
    else:
        clump = sphere_clump(body.avatar, int(given["spheres"]))
    diameter = nominal_diameter(body.mass.volume)
    figures = {
        "spheres": float(len(clump.radii)),
        "iou": clump.iou,
        "volume_error": clump.volume_ratio - 1,
        "inertia_error": clump.inertia_error,
        "hausdorff": clump.hausdorff / diameter,
        "hausdorff_length": clump.hausdorff,
        "smallest_radius_length": float(clump.radii.min()),
    }
    return ExportPreview("clump", body, figures, clump=clump, warning=warning)


def _make_try_callback(progress: Progress | None) -> Callable[[int], None] | None:
    """Return what lets a mesh within an error be cancelled between two tries."""
    return None if progress is None else lambda cells: progress(-1.0, f"Trying {cells} cells across")


def _mesh_figures(made: BodyMesh, body: DemBody) -> dict[str, float]:
    mesh, said = made.mesh, describe_mesh(made.mesh)
    return {
        "cells": float(made.cells),
        "triangles": float(said["triangles"]),
        "smallest_angle": said["smallest_angle_degrees"],
        "watertight": float(mesh.is_watertight and mesh.is_winding_consistent),
        "euler_number": float(said["euler_number"]),
        "mean_edge_length": said["mean_edge"],
        "longest_edge_length": said["longest_edge"],
        "volume_error": said["volume"] / body.mass.volume - 1,
        "hausdorff": made.error,
        "hausdorff_length": made.error * nominal_diameter(body.mass.volume),
    }


def _zero_of(grid: LevelSet) -> trimesh.Trimesh:
    """Return the surface that the grid stands for, between its nodes."""
    import trimesh
    from skimage.measure import marching_cubes

    vertices, faces, _, _ = marching_cubes(np.asarray(grid.values), 0.0, gradient_direction="descent")
    return trimesh.Trimesh(vertices * grid.spacing + grid.origin, faces, process=False)
