"""The fast search: Levenberg-Marquardt on ln k and x against the distance to the surface.

The lowest value of the paper's loss alone belongs to avatars that fall into pieces or turn inside
out. This search therefore minimises, in the working frame, the sum of squares of

- the first-order distance of hull points to the surface, ``2 (1 - u) / g`` with ``u = f**-1/2``
  and ``g = |grad f| / f`` held between bounds and lagged by one step; and that of the grain's tips,
  which are too few to count among the hull points, yet decide on its calipers and its box;
- a hinge that keeps f above 1 at points inside the grain (no voids);
- a hinge that keeps every control point at some depth (no control point outside, no islands);
- the volume error, as one mean normal displacement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.depths import depths_of, least_depths, push_in, settle_in
from mbstudio.core.imaging.fast.levenberg_marquardt import (
    add_normal_matrix,
    curvature_of_rows,
    field_of_rows,
    jacobian_of_rows,
    solve_damped,
    steepness_of_rows,
    weighted_sums_of_rows,
)
from mbstudio.core.imaging.fast.rows import (
    InteriorPoints,
    Residuals,
    SolidRows,
    SurfacePoints,
    SurfaceRows,
)
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.metaball.field import solid_bounds
from mbstudio.core.metaball.surface import mesh_area, volume_and_area


@dataclass(frozen=True)
class RefineSettings:
    """Constants of the fast search; lengths are in working lengths (RMS radius 1).

    Attributes
    ----------
    steepness_floor, steepness_roof, steepness_roof_of_few : float
        Bounds of g = abs(grad f) / f; a higher floor makes the search more cautious where f is flat. The
        roof is that of few up to 24 control points and rises with their number: few cannot follow steep
        places, and spread better over the body where these count less.
    start_damping : float
        Lambda of the first step.
    tip_weight, interior_weight, depth_weight, volume_weight, area_weight : float
        Weights of the tips (of their squares), of the hinges and of the volume and area rows against the
        surface rows.
    area_slack, area_slack_of_many, most_area_gain : float
        The area row strives for the hull's area less this share (steps of the voxels leave so
        much on smooth surfaces; the second from `many` control points on, unless blocks of voxels
        were averaged), but for no more than this share beyond what the avatar has.
    area_stays : bool
        Keep the area row at work once the area is right, which may not grow too large then either.
    area_noise : float
        Below an RMS of so many voxels the area row is left out: their steps add more to the hull's area.
    curvature_roof : float
        Bound of twice the mean curvature in the area row.
    points_per_control, points_per_many, fewest_points : int
        Surface points in use at a time: max(fewest_points, points_per_control * n); the second per control
        point where there are `many`.
    denser, points_at_end : float, int
        Times as many in the last steps, while the area row is at work; so many where it is left out.
    renew_every, renew_many_every, many, check_every : int
        Steps after which the next subset of points is taken and the volume measured anew, the second from so
        `many` control points on, unless voxels are few or long; and after which progress over all hull points
        decides whether to stop.
    least_gain : float
        Relative gain of the RMS between checks that counts as progress; two without end the search.
    noise, least_gain_in_noise : float
        Below an RMS of `noise` times the grain's fineness one check with less gain than this ends the search.
    """

    steepness_floor: float = 0.7
    steepness_roof: float = 10.0
    steepness_roof_of_few: float = 6.0
    start_damping: float = 0.1
    tip_weight: float = 0.03
    interior_weight: float = 0.5
    depth_weight: float = 0.5
    volume_weight: float = 3.0
    area_weight: float = 1.0
    area_slack: float = 0.004
    area_slack_of_many: float = 0.002
    most_area_gain: float = 0.03
    area_stays: bool = True
    area_noise: float = 0.2
    curvature_roof: float = 30.0
    points_per_control: int = 25
    points_per_many: int = 28
    fewest_points: int = 1500
    denser: float = 2.0
    points_at_end: int = 8000
    renew_every: int = 5
    renew_many_every: int = 3
    many: int = 80
    check_every: int = 10
    least_gain: float = 0.01
    noise: float = 0.35
    least_gain_in_noise: float = 0.015

    def steepness_roof_for(self, n: int) -> float:
        """Return the upper bound of g for n control points."""
        return min(self.steepness_roof, max(self.steepness_roof_of_few, n / 4))


class Refinement:
    """The state of one fast search; :meth:`advance` makes one step.

    Attributes
    ----------
    control : float64 array, shape (4, n)
        Rows x, y, z, k as they stand, in the working frame.
    damping : float
    surface : SurfacePoints
        Those in use.
    soft_depth, hard_depth : float
        The depth that control points are pulled to, and that below which none may go.
    """

    surface: SurfacePoints
    solid: SolidRows

    def __init__(
        self,
        prepared: PreparedGrain,
        control: Float64[np.ndarray, "4 n"],
        settings: RefineSettings | None = None,
    ) -> None:
        self.prepared = prepared
        self.settings = settings or RefineSettings()
        self.damping = self.settings.start_damping
        self._iteration = 0
        self._hull = np.ascontiguousarray(prepared.hull.T, dtype=np.float32)
        tips, shares = prepared.tips, prepared.tip_shares
        if self.settings.tip_weight <= 0:
            tips, shares = tips[:0], shares[:0]
        self._tips = np.ascontiguousarray(tips.T, dtype=np.float32)
        self._tip_weight = np.sqrt(self.settings.tip_weight * shares)
        self._witnesses = np.ascontiguousarray(self._hull[:, :: -(-self._hull.shape[1] // 4000)])
        self._interior = InteriorPoints(prepared, self.settings.interior_weight)
        # In a thin body the same displacement is a larger share of the volume.
        self._volume_weight = self.settings.volume_weight * prepared.slenderness**2
        self._offset = 0
        self._wanted_area: float | None = None
        self._least_points = 0
        self.set_control(control)

    def set_control(self, control: Float64[np.ndarray, "4 n"]) -> None:
        """Go on from other control points (also of another number)."""
        self.control = np.array(control, dtype=np.float64)
        self.soft_depth, self.hard_depth = least_depths(self.prepared, self.control.shape[1])
        self.damping = max(self.damping, 1e-2)
        self._renew_surface()

    def hold_points(
        self, points: Float64[np.ndarray, "p 3"], depth: Float64[np.ndarray, "p"], weight: float,
        *, filled: bool = True,
    ) -> None:  # fmt: skip
        """Add points that must lie inside the avatar, or outside it: the guard's answer to its faults."""
        # A hair off the voxels' centres, where control points may lie: f has no value there.
        self._interior.add(points.T + 0.01 * self.prepared.voxel, depth, weight, filled)
        self.damping = max(self.damping, 1e-1)

    def field_on_hull(self) -> np.ndarray:
        """Return f at all hull points, in single precision."""
        out = np.empty(self._hull.shape[1], dtype=np.float32)
        field_of_rows(self._hull, self.control.astype(np.float32), out)
        return out

    def rms(self) -> float:
        """Return the root mean square distance of hull points to the surface, in working lengths.

        Measured at up to 4,000 of the hull points, always the same.
        """
        single = self.control.astype(np.float32)
        field, steepness = np.empty((2, self._witnesses.shape[1]), dtype=np.float32)
        field_of_rows(self._witnesses, single, field)
        steepness_of_rows(self._witnesses, single, steepness)
        residual = 2 * (1 - field**-0.5) / np.clip(steepness, 0.7, 6.0)
        return float(np.sqrt(np.mean(np.square(residual, dtype=np.float64))))

    def _renew_surface(self) -> None:
        """Take the next subset of hull points and measure the solid."""
        settings = self.settings
        each = settings.points_per_many if self._are_many() else settings.points_per_control
        wanted = max(settings.fewest_points, each * self.control.shape[1])
        if self._wanted_area is not None:
            wanted = round(self.settings.denser * wanted)
        wanted = max(wanted, self._least_points)
        stride = max(1, self._hull.shape[1] // wanted)
        self._offset = (self._offset + max(1, int(0.382 * stride))) % stride
        chosen = self._hull[:, self._offset :: stride]
        self.surface = SurfacePoints.join(chosen, self._tips, self._tip_weight)
        self.measure_solid()

    def _are_many(self) -> bool:
        """Tell whether control points are many, and the surface known well enough for them."""
        return self.control.shape[1] >= self.settings.many and bool(np.isfinite(self.prepared.area))

    def measure_solid(self) -> None:
        """Measure volume and area anew, from which their rows start."""
        bounds = solid_bounds(self.control, rounds=1)
        # Sheets thinner than three cells would have a wrong volume.
        fine = int(min(3 * float((bounds[1] - bounds[0]).max()) / self.prepared.thickness, 96))
        cells = max(32 if self._wanted_area is None else 48, fine)
        volume, area = volume_and_area(self.control, cells=cells, bounds=bounds)
        displacement = (volume - self.prepared.volume) / max(area, 1e-12)
        single = self.control.astype(np.float32)
        self._measure_scale(single)
        residual, _ = self._surface_rows(single)
        # A wildly wrong start must not let the volume row throw the search off.
        volume_offset = float(np.clip(displacement, -0.3, 0.3)) - self.surface.mean(residual)
        bend = np.zeros_like(residual)
        self.solid = SolidRows(volume_offset, bend)
        if self._wanted_area is None:
            return
        area = mesh_area(self.control, 64)
        if area >= self._wanted_area and not self.settings.area_stays:
            return
        roof = self.settings.curvature_roof
        # The area grows by twice the mean curvature times the displacement.
        curvature_of_rows(self.surface.points, single, bend)
        np.clip(bend, -roof, roof, out=bend)
        area_offset = area / self._wanted_area - 1.0 - self.surface.mean(bend * residual)
        self.solid = SolidRows(volume_offset, bend, self.settings.area_weight, area_offset)

    def take_more_points(self) -> bool:
        """From now on ask at more surface points, so that their choice no longer counts, where that pays."""
        # On few or long voxels, of which no area is known, the avatar would only follow the steps.
        if not np.isfinite(self.prepared.area) or self._hull.shape[1] < 3 * self.surface.points.shape[1]:
            return False
        self._least_points = self.settings.points_at_end
        self._renew_surface()
        return True

    def strive_for_area(self) -> bool:
        """From now on also push edges out until the area is right; return whether it is too small."""
        settings, prepared = self.settings, self.prepared
        if settings.area_weight <= 0 or self.rms() < settings.area_noise * prepared.fineness:
            return False
        averaged_in_blocks = prepared.fineness < prepared.voxel
        of_many = self._are_many() and not averaged_in_blocks
        wanted = prepared.area * (1 - (settings.area_slack_of_many if of_many else settings.area_slack))
        if not np.isfinite(wanted) or (area := mesh_area(self.control, 64)) >= wanted:
            return False
        self._wanted_area = min(wanted, area * (1 + settings.most_area_gain))
        self._renew_surface()
        return True

    def _measure_scale(self, control: np.ndarray) -> None:
        """Measure 2/g at the surface points, which the steps until the next measurement count with."""
        steepness = np.empty(self.surface.points.shape[1], dtype=np.float32)
        steepness_of_rows(self.surface.points, control, steepness)
        roof = self.settings.steepness_roof_for(control.shape[1])
        self._scale = 2 / np.clip(steepness, self.settings.steepness_floor, roof)

    def _surface_rows(self, control: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distance and f at the surface points in use."""
        field = np.empty(self.surface.points.shape[1], dtype=np.float32)
        field_of_rows(self.surface.points, control, field)
        return self._scale * (1 - field**-0.5), field

    def _cost(self, control: np.ndarray) -> tuple[float, Residuals]:
        """Return half the sum of squares at `control`, and its rows."""
        single = control.astype(np.float32)
        residual, field = self._surface_rows(single)
        hinge, inner = self._interior.hinges(single)
        depth, slope = depths_of(self.prepared, control[:3])
        shallow = np.maximum(self.soft_depth - depth, 0) * self.weight_of_depth
        solid, mean = self.solid, self.surface.mean
        volume = self._volume_weight * (mean(residual) + solid.volume_offset)
        area = solid.area_weight * (mean(solid.bend * residual) + solid.area_offset)
        rows = Residuals(residual, field, hinge, inner, shallow, slope, volume, area)
        return rows.half_sum_of_squares(self.surface.row_weight), rows

    def _normal_equations(self, at: Residuals) -> tuple[np.ndarray, np.ndarray]:
        n, interior, solid = self.control.shape[1], self._interior, self.solid
        active = np.flatnonzero(at.hinge < 0)
        weight = self.surface.row_weight
        points = np.ascontiguousarray(np.hstack([self.surface.points, interior.points[:, active]]))
        # d(1 - u)/df = f**(-3/2) / 2.
        factor = np.concatenate([
            0.5 * self._scale * weight * at.field**-1.5,
            0.5 * (interior.side * interior.weight)[active] * at.inner[active] ** -1.5,
        ]).astype(np.float32)  # fmt: skip
        rows = np.empty((4 * n, points.shape[1]), dtype=np.float32)
        jacobian_of_rows(points, self.control.astype(np.float32), factor, rows)
        matrix, gradient = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
        add_normal_matrix(
            rows,
            np.concatenate([at.surface * weight, at.hinge[active]]).astype(np.float32),
            matrix,
            gradient,
        )
        share, mean = self.surface.share / weight, np.empty(4 * n)
        weighted_sums_of_rows(rows, share, mean)
        mean *= self._volume_weight
        matrix += np.outer(mean, mean)
        gradient += mean * at.volume
        if solid.area_weight:
            bent = np.empty(4 * n)
            weighted_sums_of_rows(rows, solid.bend * share, bent)
            bent *= solid.area_weight
            matrix += np.outer(bent, bent)
            gradient += bent * at.area
        self.add_depth_rows(at, matrix, gradient)
        return matrix, gradient

    @property
    def weight_of_depth(self) -> float:
        """Weight of the row of one control point's depth."""
        return float(self.settings.depth_weight / np.sqrt(self.control.shape[1]))

    def add_depth_rows(self, at: Residuals, matrix: np.ndarray, gradient: np.ndarray) -> None:
        """Add the rows of depth of all control points, or of some, to their normal equations in place."""
        n = len(at.shallow)
        # Each control point's depth row touches only its own three places.
        low = np.flatnonzero(at.shallow > 0)
        rows_of_depth = -self.weight_of_depth * at.slope[:, low]
        for a in range(3):
            gradient[(a + 1) * n + low] += rows_of_depth[a] * at.shallow[low]
            for b in range(3):
                matrix[(a + 1) * n + low, (b + 1) * n + low] += rows_of_depth[a] * rows_of_depth[b]

    def _step_from(self, step: np.ndarray) -> np.ndarray:
        """Return the control points after a step: bounded, and none shallower than allowed."""
        moved = bounded_step(self.control, step)
        # A point that is too shallow already (in a spike) may stay so, but go no further out:
        # were it moved at every trial, the shortest step would still not be a small change.
        self.keep_deep(moved)
        return moved

    def settle(self) -> None:
        """Bring the control points of a start to where the search allows them, as far as the shape lets."""
        settle_in(self.prepared, self.control, self.hard_depth)

    def linearise(self) -> tuple[np.ndarray, np.ndarray]:
        """Return normal matrix (lower triangle) and gradient at the control points as they stand."""
        self._measure_scale(self.control.astype(np.float32))
        return self._normal_equations(self._cost(self.control)[1])

    def surface_rows_at(self, control: Float64[np.ndarray, "4 n"]) -> SurfaceRows:
        """Return the rows at the surface points in use."""
        single, weight = control.astype(np.float32), self.surface.row_weight
        self._measure_scale(single)
        residual, field = self._surface_rows(single)
        slope = (0.5 * weight * self._scale * field**-1.5).astype(np.float32)
        return SurfaceRows(self.surface.points, weight * residual, slope)

    def depth_of(self, points: Float64[np.ndarray, "3 p"]) -> Float64[np.ndarray, "p"]:
        """Return the depth of points (rows x, y, z) below the surface."""
        return depths_of(self.prepared, points)[0]

    def keep_deep(self, moved: Float64[np.ndarray, "4 n"]) -> None:
        """Push control points inward, in place, where they came shallower than a step may bring them."""
        least = np.minimum(self.hard_depth, self.depth_of(self.control[:3]))
        push_in(self.prepared, moved, least, self.control)

    def advance(self) -> bool:
        """Make one step; return False where no damping finds a lower sum of squares."""
        every = self.settings.renew_many_every if self._are_many() else self.settings.renew_every
        if self._iteration and self._iteration % every == 0:
            self._renew_surface()
        self._iteration += 1
        self._measure_scale(self.control.astype(np.float32))  # the lagged g
        cost, rows = self._cost(self.control)
        matrix, gradient = self._normal_equations(rows)
        diagonal = np.diagonal(matrix).copy()
        diagonal += 1e-3 * diagonal.mean()
        factor, step = np.zeros_like(matrix), np.empty_like(gradient)
        for _ in range(8):
            if solve_damped(matrix, self.damping * diagonal, gradient, factor, step):
                trial = self._step_from(step)
                if self._cost(trial)[0] < cost:
                    self.control = trial
                    self.damping = max(self.damping / 3, 1e-6)
                    return True
            self.damping = min(self.damping * 4, 1e8)
        return False


def bounded_step(control: Float64[np.ndarray, "4 n"], step: np.ndarray) -> Float64[np.ndarray, "4 n"]:
    """Return control points after a step of ln k, x, y and z, none of which goes too far at once."""
    n = control.shape[1]
    moved = control.copy()
    moved[3] *= np.exp(np.clip(step[:n], -0.7, 0.7))
    moved[:3] += np.clip(step[n:].reshape(3, n), -0.3, 0.3)
    return moved
