"""What a DEM engine gets of an avatar, as surfaces to look at: spheres, or a mesh with its edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbstudio.core.dem.preview import ExportPreview
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.scene.surfaces import Surface, avatar_surface, control_points, surface_of

_CELLS = 56


@dataclass(frozen=True, eq=False)
class PreviewSurfaces:
    """An avatar and the shape that stands for it, in the avatar's principal frame.

    Attributes
    ----------
    shape : Surface
        Spheres, mesh, the zero of a grid, or control points.
    envelope : Surface or None
        The avatar itself, to be seen through; None where the shape lies on it, for both would flicker.
    edges : bool
        Whether the triangles of the shape are what matters.
    unit : str
    """

    shape: Surface
    envelope: Surface | None
    edges: bool
    unit: str


def preview_surfaces(preview: ExportPreview) -> PreviewSurfaces:
    """Return what there is to see of a preview; may run in a worker thread."""
    avatar = preview.body.avatar
    if preview.clump is not None:
        shape = clump_surface(preview.clump)
    elif preview.mesh is not None:
        shape = surface_of(preview.mesh)
    else:
        shape = control_points(avatar)
    envelope = None if preview.mesh is not None else avatar_surface(avatar, _CELLS)
    return PreviewSurfaces(shape, envelope, preview.geometry == "mesh", avatar.unit)


def clump_surface(clump: Clump) -> Surface:
    """Return all spheres of a clump, rounder the fewer they are."""
    from trimesh.creation import icosphere

    count = len(clump.radii)
    ball = icosphere(subdivisions=3 if count <= 120 else 2 if count <= 600 else 1)
    directions, faces = np.asarray(ball.vertices, dtype=float), np.asarray(ball.faces, dtype=np.int64)
    points = (clump.centers[:, None] + clump.radii[:, None, None] * directions).reshape(-1, 3)
    starts = np.arange(count)[:, None, None] * len(directions)
    return Surface(
        points.astype(np.float32),
        (faces[None] + starts).reshape(-1, 3),
        np.tile(directions, (count, 1)).astype(np.float32),
    )
