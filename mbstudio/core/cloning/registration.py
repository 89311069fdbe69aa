"""Registration: the smooth warp that lays one parent's surface onto another's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial import cKDTree

from mbstudio.core.cloning.kernel_warp import FLIPS, Coefficients, flipped_places, stiffness, weights_at
from mbstudio.core.cloning.parent_surface import ParentSurface

_POINTS = 600
_ROUNDS = 12
_RIDGE = 2e-3
_RIDGE_AT_END = 6e-4
_SOFT_ROUNDS = 6
_FAR = 0.25
"""Distance, in the isotropic frame, at which a pair of points counts half."""


@dataclass(frozen=True, eq=False)
class Registration:
    """A warp from one parent towards another, in the isotropic frame.

    Attributes
    ----------
    coefficients : float array, shape (27, 3)
    flip : int
        Row of `FLIPS`: how the other parent was turned or reflected to lie best.
    before, after : float
        Root mean square distance of the surfaces before and after it, about in radii of the bodies.
    """

    coefficients: Coefficients
    flip: int
    before: float
    after: float


class SurfaceTarget:
    """A parent onto which others are laid: its corners, normals, and a tree to find the nearest."""

    def __init__(self, surface: ParentSurface) -> None:
        self.points = surface.vertices
        self.normals = vertex_normals(surface.vertices, surface.faces)
        self.tree = cKDTree(self.points)

    def best_flip(self, points: Float[np.ndarray, "p 3"]) -> tuple[int, float]:
        """Return the flip in which the surface lies nearest to points, and the distance that it leaves."""
        # Flips are their own inverses: flip the points, which are fewer.
        distances = [float(np.sqrt(np.square(self.tree.query(points * flip)[0]).mean())) for flip in FLIPS]
        best = int(np.argmin(distances))
        return best, distances[best]


def register(surface: ParentSurface, target: SurfaceTarget, rng: np.random.Generator) -> Registration:
    """Return the warp that lays a parent onto another.

    Point-to-plane iterations (Chen & Medioni 1992) on smooth displacements: points of one surface move
    towards the tangent planes of the other at its nearest corners, held back by the displacement's roughness.

    Parameters
    ----------
    surface : ParentSurface
    target : SurfaceTarget
    rng : numpy.random.Generator
        Of the points that are taken of the surface.
    """
    count = len(surface.vertices)
    points = surface.vertices[rng.choice(count, min(_POINTS, count), replace=False)]
    chosen, before = target.best_flip(points)
    # In the other's flip the same warp is found; at the end it is flipped back.
    flip = FLIPS[chosen]
    start = points * flip
    weights = weights_at(start)
    stiff = np.kron(stiffness(), np.eye(3))
    coefficients = np.zeros(stiff.shape[0])
    for round_number in range(_ROUNDS):
        moved = start + weights @ coefficients.reshape(-1, 3)
        distance, nearest = target.tree.query(moved)
        normals = target.normals[nearest]
        gap = np.einsum("pi,pi->p", target.points[nearest] - moved, normals)
        trust = 1.0 / (1.0 + np.square(distance / _FAR))
        rows = (weights[:, :, None] * normals[:, None, :]).reshape(len(start), -1)
        ridge = (_RIDGE if round_number < _SOFT_ROUNDS else _RIDGE_AT_END) * stiff
        matrix = (rows * trust[:, None]).T @ rows / len(start) + ridge
        down = rows.T @ (trust * gap) / len(start) - ridge @ coefficients
        coefficients = coefficients + np.linalg.solve(matrix, down)
    moved = start + weights @ coefficients.reshape(-1, 3)
    nearest = target.tree.query(moved)[1]
    gap = np.einsum("pi,pi->p", target.points[nearest] - moved, target.normals[nearest])
    found = flip_coefficients(coefficients.reshape(-1, 3), chosen)
    return Registration(found, chosen, before, float(np.sqrt(np.square(gap).mean())))


def flip_coefficients(coefficients: Float[np.ndarray, "27 3"], flip: int) -> Float64[np.ndarray, "27 3"]:
    """Return the warp that does to flipped bodies what this one does to bodies as they are."""
    flipped: np.ndarray = coefficients[flipped_places()[flip]] * FLIPS[flip]
    return flipped


def vertex_normals(vertices: Float[np.ndarray, "v 3"], faces: np.ndarray) -> Float64[np.ndarray, "v 3"]:
    """Return unit normals of corners, each the sum of its triangles' areas times their normals."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    lengths = np.linalg.norm(normals, axis=1)
    unit: np.ndarray = normals / np.where(lengths > 0, lengths, 1.0)[:, None]
    return unit
