"""Surfaces to look at: grains, avatars and whole label volumes, as plain arrays.

Everything here may run in a worker thread, and therefore makes no VTK object: VTK lets go of
Python's lock while it renders, and another thread that makes a VTK object meanwhile can halt
both for ever. :meth:`Surface.poly_data` is for the thread that renders.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv
from jaxtyping import Float32, Int32, Int64
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.scene.label_net import label_net, vertex_normals

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.grains import Grain, GrainSet

LABEL_ARRAY = "label"


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle surface that is not yet VTK's.

    Attributes
    ----------
    points : float32 array, shape (m, 3)
        Vertices (x, y, z).
    triangles : int64 array, shape (t, 3)
    normals : float32 array, shape (m, 3)
        Unit vectors out of the body.
    labels : int32 array, shape (t,), optional
        Grain label of each triangle.
    """

    points: Float32[np.ndarray, "m 3"]
    triangles: Int64[np.ndarray, "t 3"]
    normals: Float32[np.ndarray, "m 3"]
    labels: Int32[np.ndarray, " t"] | None = None

    def poly_data(self) -> pv.PolyData:
        """Return the surface as pyvista's; only in the thread that renders."""
        if not len(self.triangles):
            return pv.PolyData()
        surface = pv.PolyData.from_regular_faces(self.points, self.triangles)
        surface.point_data["Normals"] = self.normals
        surface.point_data.active_normals_name = "Normals"
        if self.labels is not None:
            surface.cell_data[LABEL_ARRAY] = self.labels
        return surface

    def only(self, labels: Collection[int]) -> Surface:
        """Return the triangles with these labels; the vertices stay as they are."""
        if self.labels is None:
            return self
        kept = np.isin(self.labels, list(labels))
        return Surface(self.points, self.triangles[kept], self.normals, self.labels[kept])

    def fill(self, mesh: pv.PolyData) -> None:
        """Put points, triangles and normals into a mesh that is shown already, without copies.

        While a slider moves this happens thirty times a second; a new mesh for its mapper takes ten times
        as long. Only in the thread that renders.
        """
        points, polygons = vtkPoints(), vtkCellArray()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(self.points)))
        polygons.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(self.triangles).ravel()))
        normals = numpy_to_vtk(np.ascontiguousarray(self.normals))
        normals.SetName("Normals")
        mesh.SetPoints(points)
        mesh.SetPolys(polygons)
        mesh.GetPointData().SetNormals(normals)
        mesh.Modified()


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    """Return a triangle mesh with normals weighted by area."""
    points, triangles = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    return Surface(points.astype(np.float32), triangles, vertex_normals(points, triangles))


def grain_surface(grain: Grain) -> Surface:
    """Return the grain's smoothed surface in its frame and unit."""
    return surface_of(grain.surface_mesh())


def avatar_surface(avatar: Avatar, cells: int = 64) -> Surface:
    """Return the avatar's surface with normals taken from the gradient of its field.

    Parameters
    ----------
    cells : int
        Cells along the longest side: 64 to look at closely, 32 while a fit runs.
    """
    mesh = avatar.mesh(cells=cells)
    points = np.asarray(mesh.vertices, dtype=float)
    normals = -np.asarray(avatar.gradient(points))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(lengths > 0, lengths, 1)
    return Surface(
        points.astype(np.float32), np.asarray(mesh.faces, dtype=np.int64), normals.astype(np.float32)
    )


def surface_of_body(body: Avatar | trimesh.Trimesh, cells: int = 64, most: int | None = None) -> Surface:
    """Return the surface of an avatar, or a mesh as it is.

    Parameters
    ----------
    body : Avatar or trimesh.Trimesh
    cells : int
        Along the longest side of an avatar.
    most : int, optional
        Triangles of a mesh above which a coarser one is shown in its place.
    """
    if isinstance(body, Avatar):
        return avatar_surface(body, cells)
    points, triangles = np.asarray(body.vertices, dtype=float), np.asarray(body.faces, dtype=np.int64)
    if most is not None and len(triangles) > most:
        points, triangles = _coarser(points, triangles, most)
    return Surface(points.astype(np.float32), triangles, vertex_normals(points, triangles))


def _coarser(points: np.ndarray, triangles: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a surface to look at from afar: corners in one cell of a grid become their mean.

    Vertex clustering (Rossignac & Borrel 1993): fast, and good enough where a triangle is a few pixels.
    """
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    # Triangles of a clustered surface are about twice its cells, which lie on a shell.
    side = float(np.cbrt(np.prod(size))) * math.sqrt(2 * math.pi / most)
    cells = np.floor((points - low) / side).astype(np.int64)
    _, place, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    place = place.ravel()
    middle = np.stack([np.bincount(place, points[:, axis]) for axis in range(3)], axis=1) / count[:, None]
    coarse = place[triangles]
    apart = (coarse != np.roll(coarse, 1, axis=1)).all(axis=1)
    return middle, coarse[apart]


def avatars_surface(avatars: Iterable[Avatar], cells: int = 24) -> Surface:
    """Return many avatars as one surface, each triangle with its avatar's label (0: none)."""
    return merge([(avatar_surface(avatar, cells), avatar.label or 0) for avatar in avatars])


def merge(parts: list[tuple[Surface, int]]) -> Surface:
    """Return labelled surfaces as one."""
    if not parts:
        nothing = np.zeros((0, 3))
        return Surface(nothing.astype(np.float32), nothing.astype(np.int64), nothing.astype(np.float32))
    starts = np.cumsum([0, *(len(part.points) for part, _ in parts[:-1])])
    return Surface(
        np.concatenate([part.points for part, _ in parts]),
        np.concatenate([part.triangles + start for (part, _), start in zip(parts, starts, strict=True)]),
        np.concatenate([part.normals for part, _ in parts]),
        np.concatenate([np.full(len(part.triangles), label, dtype=np.int32) for part, label in parts]),
    )


def control_points(avatar: Avatar) -> Surface:
    """Return small spheres at the control points, a fiftieth of the avatar's size in radius."""
    centers = np.asarray(avatar.centers)
    extent = float(np.linalg.norm(np.ptp(centers, axis=0))) if len(centers) > 1 else 0.0
    radius = 0.018 * max(extent, 2 * math.sqrt(float(np.max(avatar.weights))))
    directions, triangles = _ball()
    points = (centers[:, None] + radius * directions[None]).reshape(-1, 3)
    starts = np.arange(len(centers))[:, None, None] * len(directions)
    return Surface(
        points.astype(np.float32),
        (triangles[None] + starts).reshape(-1, 3),
        np.tile(directions, (len(centers), 1)).astype(np.float32),
    )


def label_surface(grains: GrainSet, longest: int = 200, only: Collection[int] | None = None) -> Surface:
    """Return all grains as one smoothed surface; each triangle knows its grain's label.

    Parameters
    ----------
    longest : int
        The label volume is thinned to every k-th voxel until no side is longer than this: a
        picture of two thousand grains has no use for more.
    only : collection of int, optional
        Labels to show; all by default. Where they touch others they are closed, too.
    """
    step = max(1, math.ceil(max(grains.labels.shape) / longest))
    labels = grains.labels[::step, ::step, ::step]
    if only is not None:
        labels = np.where(np.isin(labels, list(only)), labels, 0)
    net = label_net(labels)
    points = net.points * (np.array(grains.voxel_size.xyz) * step) + np.asarray(grains.origin)
    return Surface(
        points.astype(np.float32), net.triangles, vertex_normals(points, net.triangles), net.labels
    )


def _ball(rings: int = 8, around: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and outward triangles of a unit ball."""
    polar = np.linspace(0, np.pi, rings + 1)[:, None]
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)[None]
    directions = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0 * turn], axis=-1
    ).reshape(-1, 3)
    ring, place = (index.ravel() for index in np.mgrid[:rings, :around])
    here, beside = ring * around + place, ring * around + (place + 1) % around
    below, below_beside = here + around, beside + around
    triangles = np.concatenate(
        [np.column_stack([here, below, below_beside]), np.column_stack([here, below_beside, beside])]
    )
    return directions, triangles.astype(np.int64)
