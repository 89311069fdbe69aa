"""The surfaces that are measured: closed meshes, and avatars at two nested resolutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mbstudio.core.errors import MeasureError
from mbstudio.core.meshes.bodies import closed_body
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.field import own_length
from mbstudio.core.metaball.topology import pieces_of

if TYPE_CHECKING:
    import trimesh

_COARSE_CELLS = 32

VerticesFaces = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


@dataclass(frozen=True, eq=False)
class NestedSurface:
    """Two meshes of one smooth surface, every vertex on it; the fine one splits each coarse face in four.

    An integral I over the surface or the body then has errors of order h**2 with the ratio 4,
    so that ``(4 I_fine - I_coarse) / 3`` is exact to order h**4.
    """

    coarse: VerticesFaces
    fine: VerticesFaces

    def extrapolate(self, coarse: float, fine: float) -> float:
        """Return the Richardson limit of one number measured on both meshes."""
        return (4.0 * fine - coarse) / 3.0


def avatar_surface(avatar: Avatar, cells: int = _COARSE_CELLS) -> NestedSurface:
    """Mesh an avatar with `cells` cells along its longest side, project, subdivide, project again.

    Raises
    ------
    MeasureError
        If the avatar is in several pieces: shape factors are those of one body.
    """
    _require_one_piece(avatar, pieces_of(avatar.control))
    # In lengths of its own, so that squares and cubes stay within numbers.
    length = own_length(avatar.control)
    avatar = avatar.scaled(1.0 / length)
    mesh = avatar.mesh(cells=cells)
    faces = np.asarray(mesh.faces)
    size = float(np.ptp(mesh.vertices, axis=0).max())
    vertices = project_to_surface(avatar, np.asarray(mesh.vertices, dtype=float), size / cells)
    _require_one_piece(avatar, outer_pieces(vertices, faces))
    middles, split = subdivide(vertices, faces)
    fine = np.concatenate([vertices, project_to_surface(avatar, middles, size / cells)])
    return NestedSurface((length * vertices, faces), (length * fine, split))


def _require_one_piece(avatar: Avatar, pieces: int) -> None:
    if pieces != 1:
        raise MeasureError(
            f"Avatar '{avatar.name}' is in {pieces} pieces: shape factors are defined for one body. "
            "Fit it again with more control points."
        )


def project_to_surface(
    avatar: Avatar, points: Float[np.ndarray, "m 3"], reach: float, steps: int = 3
) -> Float[np.ndarray, "m 3"]:
    """Move points along the gradient onto f = 1, by Newton steps on f**(-1/2) (linear for one control point).

    Parameters
    ----------
    points : float array, shape (m, 3)
        Points near the surface.
    reach : float
        No point moves further than this in one step.
    """
    moved = points.copy()
    for _ in range(steps):
        value = np.asarray(avatar.field(moved))
        slope = np.asarray(avatar.gradient(moved))
        squared = np.maximum(np.einsum("ij,ij->i", slope, slope), 1e-300)
        # With u = f**(-1/2), grad u = -u**3 grad f / 2; the step is (1 - u) grad u / |grad u|**2.
        u = value**-0.5
        shift = (-2.0 * (1.0 - u) / (u**3 * squared))[:, None] * slope
        length = np.linalg.norm(shift, axis=1)
        shift *= np.minimum(1.0, reach / np.maximum(length, 1e-300))[:, None]
        moved += shift
        if length.max() < 1e-6 * reach:
            break
    return moved


def subdivide(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "e 3"], Int[np.ndarray, "g 3"]]:
    """Split each face in four. Returns the edge midpoints (numbered after the vertices) and the new faces."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    keys, place = np.unique(edges[:, 0] * len(vertices) + edges[:, 1], return_inverse=True)
    first, second = np.divmod(keys, len(vertices))
    middles = 0.5 * (vertices[first] + vertices[second])
    ab, bc, ca = (place.reshape(-1, 3) + len(vertices)).T
    a, b, c = faces.T
    split = np.stack([a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca], axis=1).reshape(-1, 3)
    return middles, split


def split_to_edges(corners: Float[np.ndarray, "f 3 3"], longest: float) -> Float[np.ndarray, "g 3 3"]:
    """Split triangles in four, those with an edge longer than `longest` again and again, at most eight times.

    Where a split triangle meets one that is not, the corner between them lies on its edge: no gap opens.
    """
    done = []
    for _ in range(8):
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        done.append(corners[edges <= longest])
        a, b, c = corners[edges > longest].transpose(1, 0, 2)
        if not len(a):
            break
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    else:
        done.append(corners)
    return np.concatenate(done)


def outer_pieces(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> int:
    """Return how many solid pieces a closed mesh has; cavities (shells of negative volume) do not count."""
    return pieces_and_voids(vertices, faces)[0]


def pieces_and_voids(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> tuple[int, int]:
    """Return how many shells of positive and of negative volume a closed mesh has."""
    rows, columns = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]]).T
    graph = coo_array(
        (np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(len(vertices), len(vertices))
    )
    count, of_vertex = connected_components(graph + graph.T, directed=False)
    if count == 1:  # whichever way it is wound
        return 1, 0
    volumes = np.bincount(of_vertex[faces[:, 0]], weights=signed_volumes(vertices, faces), minlength=count)
    return int(np.count_nonzero(volumes > 0)), int(np.count_nonzero(volumes < 0))


def signed_volumes(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, " f"]:
    """Return the signed volume of the tetrahedron between each face and the mean of the vertices."""
    centred = vertices - vertices.mean(axis=0)
    a, b, c = (centred[faces[:, corner]] for corner in range(3))
    volumes: np.ndarray = np.einsum("fi,fi->f", a, np.cross(b, c)) / 6.0
    return volumes


def surface_area(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Return the area of a triangle mesh."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def check_mesh(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh that is one closed body seen from outside, its cavities kept.

    Corners at equal places are joined, copied and degenerate faces dropped, and faces turned outwards where
    needed.

    Raises
    ------
    MeshError
        If it is empty, not closed, encloses no volume, is in several pieces, or has vertices that are not
        finite.
    """
    name = getattr(mesh, "metadata", {}).get("file_name") or "The mesh"
    if not hasattr(mesh, "faces"):
        return closed_body(mesh, name)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if len(faces) and np.isfinite(vertices).all() and mesh.is_watertight and mesh.is_winding_consistent:
        pieces, voids = pieces_and_voids(vertices, faces)
        if (pieces, voids) == (1, 0) and signed_volumes(vertices, faces).sum() > 0:
            return mesh
    return closed_body(mesh, name)
