"""The avatar: a grain as a metaball of n control points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Float64

from mbstudio.core.errors import AvatarError
from mbstudio.core.units import conversion_factor, parse_unit

if TYPE_CHECKING:
    import trimesh


_LONGEST = 1e30
_FARTHEST = 1e10  # from the origin, in radii of the sphere of all weights together


def _require_lengths(name: str, centers: np.ndarray, weights: np.ndarray) -> None:
    """Refuse lengths whose cubes, or whose rounding, would make numbers silently wrong."""
    away, radius = float(np.abs(centers).max()), float(np.sqrt(weights.max()))
    if max(away, radius) > _LONGEST or radius < 1 / _LONGEST:
        raise AvatarError(
            f"Avatar '{name}' has control points {away:.3g} from the origin and a largest k of "
            f"{weights.max():.3g}: lengths, and roots of k, must be between {1 / _LONGEST:g} and "
            f"{_LONGEST:g}. Check the unit."
        )
    if away > _FARTHEST * (thick := float(np.sqrt(weights.sum()))):
        raise AvatarError(
            f"Avatar '{name}' has control points {away:.3g} from the origin and is only about {thick:.3g} "
            "thick: rounding would change its shape. Move them nearer to the origin and to each other."
        )


@dataclass(frozen=True, eq=False)
class Avatar:
    """The solid ``f(x) >= 1`` of the metaball function ``f(x) = sum_i k_i / |x - x_i|**2``.

    Attributes
    ----------
    centers : float array, shape (n, 3)
        Control points x_i as (x, y, z) in `unit`, in the frame of the grain (so that the
        avatar lies over its scan). Read-only.
    weights : float array, shape (n,)
        Positive coefficients k_i in unit**2. Read-only.
    unit : str
        Canonical length unit.
    label : int or None
        Label of the grain that it was fitted to.
    name : str
        A short name for tables and file names.

    Raises
    ------
    AvatarError
        If shapes disagree, values are not finite, a weight is not positive, or lengths are beyond what can be
        computed with: larger than 1e30 or all smaller than 1e-30, or so far from the origin or from each
        other that rounding leaves less than six digits of the body.

    References
    ----------
    Zhao et al. (2023), Computers and Geotechnics 161, 105564, Eq. (1).
    """

    centers: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n"]
    unit: str
    label: int | None = None
    name: str = "avatar"

    def __post_init__(self) -> None:
        centers = np.array(self.centers, dtype=np.float64)
        weights = np.array(self.weights, dtype=np.float64)
        if (
            centers.ndim != 2
            or centers.shape[1] != 3
            or weights.shape != centers.shape[:1]
            or not len(centers)
        ):
            raise AvatarError(
                f"Avatar '{self.name}' has control points of shape {centers.shape} and weights of shape "
                f"{weights.shape}: they must be (n, 3) and (n,) with n >= 1."
            )
        if not (np.isfinite(centers).all() and np.isfinite(weights).all()):
            raise AvatarError(
                f"Avatar '{self.name}' has control points or weights that are not finite numbers: check them."
            )
        if weights.min() <= 0:
            raise AvatarError(
                f"Avatar '{self.name}' has a weight of {weights.min():g}: every k must be positive."
            )
        _require_lengths(self.name, centers, weights)
        centers.flags.writeable = weights.flags.writeable = False
        object.__setattr__(self, "centers", centers)
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "unit", parse_unit(self.unit))

    @property
    def n(self) -> int:
        """Number of control points."""
        return len(self.weights)

    @cached_property
    def control(self) -> Float64[np.ndarray, "4 n"]:
        """Control points as contiguous rows x, y, z, k: what the kernels of `field` take."""
        from mbstudio.core.metaball.field import control_rows

        return control_rows(self.centers, self.weights)

    def field(self, points: Float[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m"]:
        """Return f at points (x, y, z) in `unit`; infinite on a control point."""
        from mbstudio.core.metaball.field import field_at

        return field_at(points, self.control)

    def gradient(self, points: Float[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        """Return the gradient of f, in 1/unit, at points (x, y, z) in `unit`; NaN on a control point."""
        from mbstudio.core.metaball.field import field_and_gradient_at

        return field_and_gradient_at(points, self.control)[1]

    def contains(self, points: Float[np.ndarray, "m 3"]) -> Bool[np.ndarray, "m"]:
        """Return whether each point (x, y, z) in `unit` lies in the solid f >= 1."""
        return self.field(points) >= 1.0

    def signed_distance(
        self, points: Float[np.ndarray, "m 3"], *, iterated: bool = False
    ) -> Float64[np.ndarray, "m"]:
        """Return the distance of points to the surface in `unit`, negative inside.

        Parameters
        ----------
        points : float array, shape (m, 3)
        iterated : bool
            False: first order, good near the surface and ten times faster. True: to the nearest
            point of the surface.
        """
        from mbstudio.core.metaball import signed_distance

        if iterated:
            return signed_distance.closest_points(points, self.control)[1]
        return signed_distance.first_order_distance(points, self.control)

    def closest_points(self, points: Float[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        """Return the surface points nearest to points (x, y, z) in `unit`."""
        from mbstudio.core.metaball import signed_distance

        return signed_distance.closest_points(points, self.control)[0]

    def first_hits(
        self, origins: Float[np.ndarray, "m 3"], directions: Float[np.ndarray, "m 3"]
    ) -> Float64[np.ndarray, "m"]:
        """Return how far along each ray, in `unit`, the surface is first crossed; infinity for a miss."""
        from mbstudio.core.metaball.rays import first_hits

        return first_hits(origins, directions, self.control)

    def bounds(self) -> Float64[np.ndarray, "2 3"]:
        """Return a box (lowest, highest corner, in `unit`) that surely holds the solid, and little more."""
        from mbstudio.core.metaball.field import solid_bounds

        return solid_bounds(self.control)

    def mesh(self, cells: int = 64) -> trimesh.Trimesh:
        """Return the closed surface f = 1, triangles facing outward, in `unit` and the avatar's frame.

        Parameters
        ----------
        cells : int
            Grid cells along the longest side: 64 for figures, more for factors of angular grains.
        """
        from mbstudio.core.metaball.surface import surface_mesh

        mesh = surface_mesh(self.control, cells)
        if not len(mesh.faces):
            raise AvatarError(f"Avatar '{self.name}' is too thin for {cells} cells: mesh it with more.")
        mesh.units = self.unit
        return mesh

    def to(self, unit: str) -> Avatar:
        """Return the same avatar in another length unit."""
        return replace(self.scaled(conversion_factor(self.unit, unit)), unit=unit)

    def scaled(self, factor: float) -> Avatar:
        """Return the avatar with all lengths times `factor`, about the origin of its frame.

        Raises
        ------
        AvatarError
            If `factor` is not a positive finite number.
        """
        if not (np.isfinite(factor) and factor > 0):
            raise AvatarError(f"The scale of avatar '{self.name}' must be a positive number, not {factor}.")
        return replace(self, centers=self.centers * factor, weights=self.weights * factor**2)

    def transformed(
        self,
        rotation: Float[np.ndarray, "3 3"] | None = None,
        translation: Float[np.ndarray, "3"] | None = None,
    ) -> Avatar:
        """Return the avatar turned by `rotation`, then moved by `translation` (in `unit`).

        Raises
        ------
        AvatarError
            If `rotation` is not an orthogonal matrix, or a value is not finite.
        """
        centers = self.centers
        if rotation is not None:
            matrix = np.asarray(rotation, dtype=np.float64)
            if matrix.shape != (3, 3) or not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-8):
                raise AvatarError(f"Avatar '{self.name}' can only be rotated by an orthogonal 3 x 3 matrix.")
            centers = centers @ matrix.T
        if translation is not None:
            centers = centers + np.asarray(translation, dtype=np.float64)
        return replace(self, centers=centers)
