"""A latent vector made into a body to look at, fast enough to follow a slider under the hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.field import field_and_gradient_at, solid_bounds
from mbstudio.core.metaball.surface import sample_solid, volume_and_area_on_grid
from mbstudio.core.metaball.topology import topology
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.shaping.latent import check_latent
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS, meaning_factors

MOVING, AT_REST = 48, 96
"""Grid cells along the longest side while a slider moves, and when it has come to rest."""
_FINEST_MOVING = 64
"""Cells up to which pieces, voids and handles are looked into while a slider moves: a doubtful body must not
hold the hand up; at rest they are looked into in full."""
_MEASURING = 48
"""Cells for volume and area, the same at every level of detail so that the numbers do not jump."""


@dataclass(frozen=True, eq=False)
class LiveGrain:
    """A decoded latent vector with its surface, size, shape factors and validity.

    Attributes
    ----------
    latent : float array, shape (d,)
    avatar : Avatar
        In its principal frame, in the unit of the style-learner.
    points : float32 array, shape (m, 3)
    triangles : int64 array, shape (t, 3)
        Outward.
    normals : float32 array, shape (m, 3)
        Unit vectors out of the body.
    volume, area : float
        In unit**3 and unit**2.
    factors : float array, shape (5,)
        Of :data:`~mbstudio.core.vae.shaping.meaning_factors.MEANINGS`; the first is ln D_n.
    pieces, voids : int
    cells : int
        Grid cells along the longest side of the surface.
    """

    latent: Float64[np.ndarray, " d"]
    avatar: Avatar
    points: Float32[np.ndarray, "m 3"]
    triangles: Int64[np.ndarray, "t 3"]
    normals: Float32[np.ndarray, "m 3"]
    volume: float
    area: float
    factors: Float64[np.ndarray, "5"]
    pieces: int
    voids: int
    cells: int

    @property
    def is_sound(self) -> bool:
        """Whether it is one piece without void: a body that a DEM engine can take."""
        return self.pieces == 1 and self.voids == 0

    @property
    def values(self) -> dict[str, float]:
        """Factors by the name of their meaning; `size` is D_n in the unit of the avatar."""
        found = dict(zip(MEANINGS, (float(value) for value in self.factors), strict=True))
        return {**found, "size": float(np.exp(found["size"]))}


def live_grain(
    learner: StyleLearner, latent: Float[np.ndarray, " d"], cells: int = AT_REST, *, name: str = "grain"
) -> LiveGrain:
    """Decode, mesh and measure one latent vector.

    Parameters
    ----------
    learner : StyleLearner
    latent : float array, shape (d,)
    cells : int
        Grid cells along the longest side of the surface: `MOVING` or `AT_REST`.
    name : str
        Of the avatar.

    Raises
    ------
    StyleError
        If the latent vector is none of this learner.
    """
    vector = check_latent(learner, latent)
    decoded = learner.decode(vector[None], names=(name,))
    avatar = decoded.avatar(0)
    control = avatar.control
    bounds = solid_bounds(control)
    grid = sample_solid(control, cells, bounds)
    points, triangles, normals = surface_on_grid(*grid, control)
    measured = grid if cells == _MEASURING else sample_solid(control, _MEASURING, bounds)
    volume, area = volume_and_area_on_grid(*measured, control)
    made_of = topology(control, MOVING, _FINEST_MOVING) if cells <= MOVING else topology(control)
    return LiveGrain(
        vector, avatar, points, triangles, normals, volume, area, meaning_factors(decoded)[0],
        made_of.pieces, made_of.voids, cells,
    )  # fmt: skip


def surface_on_grid(
    field: np.ndarray, origin: Float64[np.ndarray, "3"], spacing: float, control: Float64[np.ndarray, "4 n"]
) -> tuple[Float32[np.ndarray, "m 3"], Int64[np.ndarray, "t 3"], Float32[np.ndarray, "m 3"]]:
    """Return points, outward triangles and normals of f = 1: the field's gradient moves and shades them.

    One Newton step puts the corners where they belong and the same gradient is their normal, so that the
    surface costs one evaluation of the field more than the grid.
    """
    from skimage.measure import marching_cubes

    with np.errstate(divide="ignore"):
        away = 1.0 / np.sqrt(field)
    # A node exactly on the surface would collapse the triangles around it.
    away[np.abs(away - 1.0) < 1e-4] = np.float32(1.0 - 1e-4)
    corners, faces, _, _ = marching_cubes(away, 1.0, gradient_direction="ascent")
    points = origin + corners[:, ::-1].astype(np.float64) * spacing
    value, gradient = field_and_gradient_at(points, control)
    steepness = np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)
    normals = -gradient / steepness[:, None]
    # u = f**-1/2 is nearly linear: u - 1 over |grad u| = f**-3/2 |grad f| / 2 is the way to the surface.
    way = (value**-0.5 - 1.0) / (0.5 * value**-1.5 * steepness)
    points -= np.clip(way, -0.4 * spacing, 0.4 * spacing)[:, None] * normals
    return points.astype(np.float32), faces.astype(np.int64), normals.astype(np.float32)
