"""The coarsest mesh that stays within a distance of its avatar, and how far a mesh lies off."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.shapes.remesh import well_shaped_mesh
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surface_distance import VerticesFaces, farthest_distance
from mbstudio.core.metrics.surfaces import project_to_surface, subdivide

if TYPE_CHECKING:
    import trimesh

FEWEST_CELLS, MOST_CELLS = 8, 200
_FIRST_CELLS = 24
_REFERENCE_CELLS = 64
_CLOSE = 1.06
"""Numbers of cells nearer to each other than this are not told apart: their meshes have as many triangles."""


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """A mesh of an avatar for an engine.

    Attributes
    ----------
    mesh : trimesh.Trimesh
    cells : int
        Edges along the longest side that it was made with.
    error : float
        Hausdorff distance to the avatar over its D_n.
    warning : str
        Why it misses what was asked; empty where it does not.
    """

    mesh: trimesh.Trimesh
    cells: int
    error: float
    warning: str = ""


class MeshErrors:
    """Measures how far meshes lie off one avatar.

    Parameters
    ----------
    avatar : Avatar
    diameter : float
        Its D_n in its unit.
    """

    def __init__(self, avatar: Avatar, diameter: float) -> None:
        self._avatar, self._diameter = avatar, diameter
        fine = avatar.mesh(cells=_REFERENCE_CELLS)
        reach = float(np.ptp(np.asarray(fine.vertices), axis=0).max()) / _REFERENCE_CELLS
        self._points = project_to_surface(avatar, np.array(fine.vertices, dtype=float), reach)

    def measure(self, surface: VerticesFaces) -> float:
        """Return the Hausdorff distance of a surface to the avatar over its D_n.

        A triangle is asked at its corners, at the middles of its sides and at its own: there a flat triangle
        lies farthest off a rounded surface. The avatar is asked at the vertices of a fine mesh.
        """
        vertices, faces = surface
        middles, _ = subdivide(vertices, faces)
        points = np.concatenate([vertices, middles, vertices[faces].mean(axis=1)])
        outwards = float(np.abs(self._avatar.signed_distance(points, iterated=True)).max())
        return max(outwards, farthest_distance(self._points, surface)) / self._diameter


def mesh_of(
    body: DemBody, cells: int, error: float = 0.0, on_try: Callable[[int], None] | None = None
) -> BodyMesh:
    """Return the mesh of a body: of so many cells, or the coarsest that is as near as was asked.

    Parameters
    ----------
    body : DemBody
    cells : int
        Edges along its longest side.
    error : float
        The largest Hausdorff distance to the avatar over D_n; `cells` then counts for nothing. 0: any.
    on_try : callable(cells), optional
        Called before each mesh that is made; raising in it cancels.

    Returns
    -------
    BodyMesh
        With a warning where not even `MOST_CELLS` are near enough. A surface of record is taken as it is.
    """
    if body.surface is not None:
        import trimesh

        return BodyMesh(trimesh.Trimesh(*body.surface, process=False), 0, 0.0)
    errors = MeshErrors(body.avatar, nominal_diameter(body.mass.volume))

    def made(tried: int) -> BodyMesh:
        if on_try is not None:
            on_try(tried)
        return _measured(body, tried, errors)

    return made(cells) if error <= 0 else _coarsest(made, error)


def _measured(body: DemBody, cells: int, errors: MeshErrors) -> BodyMesh:
    mesh = well_shaped_mesh(body.avatar, cells, body.mass.volume)
    return BodyMesh(mesh, cells, errors.measure((np.asarray(mesh.vertices), np.asarray(mesh.faces))))


def _coarsest(make: Callable[[int], BodyMesh], error: float) -> BodyMesh:
    """Close in on the number of cells: a flat triangle's distance falls with the square of its side."""
    best, worst, too_few = None, None, FEWEST_CELLS - 1
    cells = _FIRST_CELLS
    while True:
        made = make(cells)
        if made.error <= error:
            best = made if best is None or made.cells < best.cells else best
        else:
            too_few = max(too_few, cells)
            worst = made if worst is None or made.error < worst.error else worst
        most = MOST_CELLS if best is None else best.cells - 1
        if too_few >= most or (best is not None and best.cells <= _CLOSE * (too_few + 1)):
            break
        guess = math.ceil(1.02 * cells * math.sqrt(made.error / error))
        cells = min(max(guess, too_few + 1), most)
    if best is not None:
        return best
    assert worst is not None
    told = (
        f"A mesh of {worst.cells} edges along the longest side lies {100 * worst.error:.2g} % of D_n off, "
        f"more than the {100 * error:g} % asked: ask for less."
    )
    return BodyMesh(worst.mesh, worst.cells, worst.error, told)
