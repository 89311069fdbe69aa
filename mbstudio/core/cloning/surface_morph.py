"""One parent's surface laid onto another's, corner by corner: the way from grain to grain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from mbstudio.core.cloning.kernel_warp import FLIPS, displacement
from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.registration import SurfaceTarget, register, vertex_normals
from mbstudio.core.cloning.surface_bands import laplacian

_ROUNDS = 12
_STIFF, _LOOSE = 0.05, 2e-4
"""Times of spreading by which corners are held to neighbours, at first and at last, in squared radii."""
_ALIKE = 0.3
"""Cosine of the normals from which on a nearest place is believed to be the right one."""


@dataclass(frozen=True, eq=False)
class Morph:
    """The surface of one parent with another's form, in the isotropic frame.

    Attributes
    ----------
    vertices : float array, shape (v, 3)
        Corners of the first parent, laid onto the second.
    misfit : float
        Root mean square distance that is left, about in radii of the bodies.
    """

    vertices: Float64[np.ndarray, "v 3"]
    misfit: float


def lay_onto(surface: ParentSurface, target: ParentSurface, seed: int = 0) -> Morph:
    """Return a parent's surface laid onto another's.

    A smooth registration first (:func:`~mbstudio.core.cloning.registration.register`), then corners go to the
    nearest places of the other, held to their neighbours less and less (Amberg et al. 2007). Where normals
    disagree, neighbours alone say where a corner goes.

    Parameters
    ----------
    surface, target : ParentSurface
    seed : int
        Of the points that the registration takes.
    """
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    onto = SurfaceTarget(target)
    found = register(surface, onto, np.random.default_rng(seed))
    flip = FLIPS[found.flip]
    start = surface.vertices
    # The other parent comes to the first one's side: flips are their own inverses.
    points, normals = onto.points * flip, onto.normals * flip
    tree = onto.tree
    stiff, mass = laplacian(start, surface.faces)
    moved = start + displacement(start, found.coefficients)
    for time in np.geomspace(_STIFF, _LOOSE, _ROUNDS):
        own = vertex_normals(moved, surface.faces)
        # The tree knows the target unflipped; distances do not mind.
        _, near = tree.query(moved * flip)
        # Towards the tangent plane: corners need not meet corners.
        across = np.einsum("vi,vi->v", points[near] - moved, normals[near])
        gap = across[:, None] * normals[near]
        trust = np.where(np.einsum("vi,vi->v", own, normals[near]) > _ALIKE, 1.0, 1e-3)
        weight = mass * trust
        solver = splu((diags(weight) + time * stiff).tocsc(), permc_spec="MMD_AT_PLUS_A")
        moved = moved + solver.solve(weight[:, None] * gap)
    _, near = tree.query(moved * flip)
    along = np.einsum("vi,vi->v", points[near] - moved, normals[near])
    return Morph(moved, float(np.sqrt(np.square(along).mean())))
