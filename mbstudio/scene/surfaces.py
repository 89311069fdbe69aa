"""Surfaces to look at: grains, avatars and whole label volumes as pyvista meshes.

Building a mesh renders nothing, so that all of this may run in a worker thread.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.grains import Grain, GrainSet
    from mbstudio.core.metaball import Avatar

LABEL_ARRAY = "label"


def poly_data(mesh: trimesh.Trimesh) -> pv.PolyData:
    """Return a triangle mesh as pyvista's, with point normals."""
    surface = pv.PolyData.from_regular_faces(
        np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.int64)
    )
    if surface.n_points:
        surface = surface.compute_normals(
            cell_normals=False, point_normals=True, split_vertices=False, consistent_normals=False
        )
    return surface


def grain_surface(grain: Grain) -> pv.PolyData:
    """Return the grain's smoothed surface in its frame and unit."""
    return poly_data(grain.surface_mesh())


def avatar_surface(avatar: Avatar, cells: int = 64) -> pv.PolyData:
    """Return the avatar's surface with normals taken from the gradient of its field.

    Parameters
    ----------
    cells : int
        Cells along the longest side: 64 to look at closely, 32 while a fit runs.
    """
    mesh = avatar.mesh(cells=cells)
    surface = pv.PolyData.from_regular_faces(
        np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.int64)
    )
    if surface.n_points:
        normals = -np.asarray(avatar.gradient(np.asarray(mesh.vertices, dtype=float)))
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals /= np.where(lengths > 0, lengths, 1)
        surface.point_data["Normals"] = normals.astype(np.float32)
        surface.point_data.active_normals_name = "Normals"
    return surface


def avatars_surface(avatars: Iterable[Avatar], cells: int = 24) -> pv.PolyData:
    """Return many avatars as one surface, each cell with its avatar's label (0: none)."""
    parts = []
    for avatar in avatars:
        part = avatar_surface(avatar, cells)
        part.cell_data[LABEL_ARRAY] = np.full(part.n_cells, avatar.label or 0, dtype=np.int32)
        parts.append(part)
    if not parts:
        return pv.PolyData()
    return parts[0] if len(parts) == 1 else pv.merge(parts, merge_points=False)


def control_points(avatar: Avatar) -> pv.PolyData:
    """Return small spheres at the control points, a fortieth of the avatar's size across."""
    centers = np.asarray(avatar.centers)
    extent = float(np.linalg.norm(np.ptp(centers, axis=0))) if len(centers) > 1 else 0.0
    radius = 0.018 * max(extent, 2 * math.sqrt(float(np.max(avatar.weights))))
    cloud = pv.PolyData(centers)
    return cloud.glyph(
        geom=pv.Sphere(radius=radius, theta_resolution=12, phi_resolution=12), scale=False, orient=False
    )


def label_surface(grains: GrainSet, longest: int = 200) -> pv.PolyData:
    """Return all grains as one smoothed surface; each cell knows its grain's label.

    Parameters
    ----------
    longest : int
        The label volume is thinned to every k-th voxel until no side is longer than this: a
        picture of two thousand grains has no use for more.

    Notes
    -----
    Surface nets (Frisken, 2022, JCGT 11(1)) as VTK has them: all labels in one pass, shared
    boundaries once.
    """
    step = max(1, math.ceil(max(grains.labels.shape) / longest))
    thinned = np.ascontiguousarray(grains.labels[::step, ::step, ::step], dtype=np.int32)
    if not thinned.any():
        return pv.PolyData()
    # A margin of background closes the grains that the scan's box cuts.
    padded = np.pad(thinned, 1)
    spacing = np.array(grains.voxel_size.xyz) * step
    image = pv.ImageData(
        dimensions=padded.shape[::-1],
        spacing=tuple(spacing),
        origin=tuple(np.asarray(grains.origin) - spacing),
    )
    image.point_data[LABEL_ARRAY] = padded.ravel()
    surface = image.contour_labels(
        boundary_style="external", smoothing=True, output_mesh_type="triangles", scalars=LABEL_ARRAY
    )
    sides = np.asarray(surface.cell_data["boundary_labels"])
    labels = sides.max(axis=1) if sides.ndim == 2 else sides
    surface.clear_data()
    surface = surface.compute_normals(
        cell_normals=False, point_normals=True, split_vertices=False, consistent_normals=False
    )
    surface.cell_data[LABEL_ARRAY] = labels.astype(np.int32)
    return surface
