"""The surface of a grain as a mesh file gave it: exact, where its voxels are a picture of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.meshes.edges import pieces_of, signed_volume

if TYPE_CHECKING:
    import trimesh

MOST_KEPT = 20_000_000
"""Triangles that a grain set keeps in all, some 500 MB; of more, the voxels alone are kept."""


@dataclass(frozen=True, eq=False)
class GrainMesh:
    """Closed triangles of one grain, in the frame and unit of its grain set.

    Attributes
    ----------
    vertices : float array, shape (v, 3)
        Points (x, y, z).
    faces : int array, shape (f, 3)
        Rows of `vertices`, wound outwards; cavities that were kept are wound inwards.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]

    @property
    def has_voids(self) -> bool:
        """Whether it keeps cavities, as shells that are wound inwards."""
        piece = pieces_of(self.faces, len(self.vertices))
        shells = (self.faces[piece == number] for number in range(int(piece.max()) + 1))
        return any(signed_volume(self.vertices, shell) < 0 for shell in shells)

    def to_trimesh(self, unit: str) -> trimesh.Trimesh:
        """Return a copy that knows its unit and may be changed."""
        import trimesh

        mesh = trimesh.Trimesh(self.vertices.copy(), self.faces.copy(), process=False, validate=False)
        mesh.units = unit
        return mesh
