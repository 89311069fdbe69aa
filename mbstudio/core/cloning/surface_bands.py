"""A surface as the sum of a ball, its coarse form, its edges and its roughness.

Each is what one smoothing takes away from another: heat that has spread for a time on the surface has
levelled what is finer than a length (Desbrun et al. 1999). The bands add up to the surface again, so that a
grain with all gains at one is its parent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.cloning.solid_moments import Faces, Points, make_isotropic

_FINE, _EDGES = 1 / 156, 1 / 20
"""Times of spreading, in squared radii: a half is left of harmonics of degree 12, and of degree 4."""
_LARGEST_WEIGHT = 20.0
"""Of an edge: narrow triangles would tie their corners together."""


class Smoothing:
    """Heat on a surface: cotangent weights, implicit steps of two lengths, ready to be applied.

    Parameters
    ----------
    vertices : float array, shape (v, 3)
        In the isotropic frame.
    faces : int array, shape (f, 3)
    """

    def __init__(self, vertices: Points, faces: Faces) -> None:
        from scipy.sparse import diags
        from scipy.sparse.linalg import splu

        stiff, mass = laplacian(vertices, faces)
        self._faces, self._mass = faces, mass[:, None]
        self._solvers = tuple(
            splu((diags(mass) + time * stiff).tocsc(), permc_spec="MMD_AT_PLUS_A") for time in (_FINE, _EDGES)
        )

    def layers(self, vertices: Points) -> Float64[np.ndarray, "3 v 3"]:
        """Return a surface of this mesh as it is, without roughness, and without edges.

        Each again has the second moments of a ball: smoothing shrinks.
        """
        found = [np.asarray(vertices, dtype=np.float64)]
        for solver in self._solvers:
            smooth = vertices
            for _ in range(2):
                smooth = solver.solve(self._mass * smooth)
            found.append(make_isotropic(smooth, self._faces)[0])
        layers: np.ndarray = np.stack(found)
        return layers


@dataclass(frozen=True)
class Gains:
    """How much of each band of the parent is left: one keeps it as it is, none takes it away.

    Attributes
    ----------
    coarse : float
        Of what makes the body without edges differ from an ellipsoid.
    edges : float
        Of edges, faces and hollows.
    fine : float
        Of roughness.
    """

    coarse: float = 1.0
    edges: float = 1.0
    fine: float = 1.0


def combine(layers: Float[np.ndarray, "3 v 3"], gains: Gains) -> Float64[np.ndarray, "v 3"]:
    """Return the surface in which the bands have other gains."""
    raw, light, heavy = layers
    ball = heavy / np.linalg.norm(heavy, axis=1, keepdims=True)
    found: np.ndarray = (
        ball + gains.coarse * (heavy - ball) + gains.edges * (light - heavy) + gains.fine * (raw - light)
    )
    return found


def laplacian(vertices: Points, faces: Faces) -> tuple[Any, Float64[np.ndarray, " v"]]:
    """Return stiffness and lumped mass of linear elements on a surface (Pinkall & Polthier 1993)."""
    from scipy.sparse import coo_matrix, diags

    count = len(vertices)
    corners = [vertices[faces[:, corner]] for corner in range(3)]
    across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    doubled = np.maximum(np.linalg.norm(across, axis=1), 1e-12)
    rows: list[Int[np.ndarray, " f"]] = []
    columns: list[Int[np.ndarray, " f"]] = []
    weights: list[Float64[np.ndarray, " f"]] = []
    for corner in range(3):
        one, other = (corner + 1) % 3, (corner + 2) % 3
        a, b = corners[one] - corners[corner], corners[other] - corners[corner]
        cotangent = np.clip(np.einsum("fi,fi->f", a, b) / doubled, 0.0, _LARGEST_WEIGHT)
        rows += [faces[:, one], faces[:, other]]
        columns += [faces[:, other], faces[:, one]]
        weights += [0.5 * cotangent, 0.5 * cotangent]
    ties = coo_matrix(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count)
    ).tocsr()
    stiff = diags(np.asarray(ties.sum(axis=1)).ravel()) - ties
    mass = np.bincount(faces.ravel(), np.repeat(doubled / 6.0, 3), minlength=count)
    return stiff, np.maximum(mass, 1e-12)
