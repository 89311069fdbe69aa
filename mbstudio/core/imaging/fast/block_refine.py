"""The fast search for many control points: the same sum of squares, lowered block by block.

The normal equations of all control points grow with the square of their number, and solving them with its
cube. But far control points hardly feel each other: f falls off with the square of the distance, its slope
with the cube. Here each step goes once over blocks of neighbours (nonlinear block Gauss-Seidel): the points
of a block make one Levenberg-Marquardt step together while all others rest. A block's rows are the surface
points where it makes up a good part of f, and every so many of the others with the weight of all, so that
what it does far away counts too. The cost of a step is linear in the number of control points.

References
----------
Ortega & Rheinboldt (1970), Iterative Solution of Nonlinear Equations in Several Variables, 7.4.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64

from mbstudio.core.imaging.depths import depths_of, push_in
from mbstudio.core.imaging.fast.levenberg_marquardt import (
    add_normal_matrix,
    field_of_rows,
    jacobian_of_rows,
    solve_damped,
    weighted_sums_of_rows,
)
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings, bounded_step
from mbstudio.core.imaging.fast.rows import Residuals, SurfaceRows
from mbstudio.core.imaging.preprocess import PreparedGrain

BLOCK = 40
"""Control points that move together at most."""
_NEAR = 0.15
"""Share of f from which on a surface point is a block's own."""
_FAR = 16
"""Of the other surface points one in so many is looked at."""
_TILT = 0.35
"""By how much the axis is turned at random along which a block is cut in two: borders move between steps."""
_TRIALS = 5


class BlockRefinement(Refinement):
    """A fast search whose steps move neighbours together and leave the rest as it is.

    Everything else is as in :class:`Refinement`: the rows, the settings, the depth that control points keep.
    """

    def __init__(
        self,
        prepared: PreparedGrain,
        control: Float64[np.ndarray, "4 n"],
        settings: RefineSettings | None = None,
    ) -> None:
        super().__init__(prepared, control, settings)
        # A hair off the voxels' centres, where control points may lie: what a block adds to f there is taken
        # off and put on again.
        self._interior.points += np.float32(0.013 * prepared.voxel)

    def set_control(self, control: Float64[np.ndarray, "4 n"]) -> None:
        super().set_control(control)
        self._dampings = np.full(self.control.shape[1], self.damping)

    def advance(self) -> bool:
        """Move every block once; return False where none found a lower sum of squares."""
        every = self.settings.renew_many_every if self._are_many() else self.settings.renew_every
        if self._iteration and self._iteration % every == 0:
            self._renew_surface()
        # The guard damps the whole search where it wants short steps.
        np.maximum(self._dampings, self.damping if self.damping > 1e-2 else 0.0, out=self._dampings)
        self.damping = 1e-2
        self._iteration += 1
        self._measure_scale(self.control.astype(np.float32))
        sums = Sums(self)
        lowered = False
        for block in blocks(self.control[:3], BLOCK, np.random.default_rng([self._iteration, 3])):
            lowered |= self._move(block, sums)
        return lowered

    def parts(self) -> Iterator[Part]:
        """Yield all blocks at rest, each with what it sees of the search."""
        self._measure_scale(self.control.astype(np.float32))
        sums = Sums(self)
        for block in blocks(self.control[:3], BLOCK, np.random.default_rng([self._iteration, 3])):
            yield Part(self, block, sums, offset=self._iteration % _FAR)

    def exchange(self, dropped: np.ndarray, new: Float64[np.ndarray, "4 c"]) -> None:
        """Put new control points in the place of as many others; their next steps are short."""
        self.control = self.control.copy()
        self.control[:, dropped] = new
        np.maximum(self._dampings, 1e-2, out=self._dampings)
        self._dampings[dropped] = self.settings.start_damping
        self._renew_surface()

    def _move(self, block: np.ndarray, sums: Sums) -> bool:
        """Make one step of a block; return whether the sum of squares fell."""
        part = Part(self, block, sums, offset=self._iteration % _FAR)
        at = part.rows(part.begun)
        cost = part.cost(at)
        matrix, gradient = part.normal_equations(at)
        diagonal = np.diagonal(matrix).copy()
        diagonal += 1e-3 * diagonal.mean()
        factor, step = np.zeros_like(matrix), np.empty_like(gradient)
        damping = float(self._dampings[block].max())
        moved = False
        for _ in range(_TRIALS):
            if solve_damped(matrix, damping * diagonal, gradient, factor, step):
                trial = part.after(step)
                if part.cost(part.rows(trial)) < cost:
                    self.control[:, block] = trial
                    sums.replace(part.begun, trial)
                    damping, moved = max(damping / 3, 1e-5), True
                    break
            damping = min(damping * 4, 1e8)
        self._dampings[block] = damping
        return moved


class Sums:
    """f of all control points at all points in use, kept up to date while blocks move."""

    def __init__(self, search: BlockRefinement) -> None:
        self._search = search
        single = search.control.astype(np.float32)
        self.field = field_at(search.surface.points, single)
        self.inner = field_at(search._interior.points, single)
        self.residual = search._scale * (1 - self.field**-0.5)

    def replace(self, before: np.ndarray, after: np.ndarray) -> None:
        """Take what a block added off, and put on what it adds now."""
        search = self._search
        old, new = before.astype(np.float32), after.astype(np.float32)
        for points, total in (
            (search.surface.points, self.field),
            (search._interior.points, self.inner),
        ):
            total += field_at(points, new) - field_at(points, old)
        self.residual = search._scale * (1 - self.field**-0.5)


class Part:
    """What one block sees of the search, all other control points at rest.

    Attributes
    ----------
    block : int array
        Indices of its control points.
    begun : float array, shape (4, b)
        Those, before they move.
    own : int
        Surface points that are its own; they come first in its rows.
    """

    def __init__(self, search: BlockRefinement, block: np.ndarray, sums: Sums, offset: int) -> None:
        self._search, self.block, self.begun = search, block, search.control[:, block]
        surface, interior = search.surface, search._interior
        single = self.begun.astype(np.float32)
        own, own_inner = field_at(surface.points, single), field_at(interior.points, single)
        near = own > _NEAR * sums.field
        far = np.flatnonzero(~near)[offset::_FAR]
        chosen = np.concatenate([np.flatnonzero(near), far])
        self.own = int(near.sum())
        times = np.ones(len(chosen), dtype=np.float32)
        times[len(chosen) - len(far) :] = (len(near) - near.sum()) / max(len(far), 1)
        self._points = np.ascontiguousarray(surface.points[:, chosen])
        self._scale = search._scale[chosen]
        self._weight = surface.row_weight[chosen] * np.sqrt(times)
        self._share = surface.share[chosen] * times
        self._rest = sums.field[chosen] - own[chosen]
        self._inner_rest = sums.inner - own_inner
        self._bend = search.solid.bend[chosen]
        # The means over the whole surface, less what the chosen points stand for of them.
        residual, solid = sums.residual, search.solid
        here = residual[chosen]
        self._mean = surface.mean(residual) - self._sum(here)
        self._bent = surface.mean(solid.bend * residual) - self._sum(self._bend * here)
        self._least = np.minimum(search.hard_depth, search.depth_of(self.begun[:3]))

    def _sum(self, values: np.ndarray) -> float:
        return float((self._share * values).sum(dtype=np.float64))

    def rows(self, control: np.ndarray) -> Residuals:
        """Return the rows with the block at `control`."""
        search = self._search
        single, interior, solid = control.astype(np.float32), search._interior, search.solid
        field = self._rest + field_at(self._points, single)
        inner = self._inner_rest + field_at(interior.points, single)
        residual = self._scale * (1 - field**-0.5)
        depth, slope = depths_of(search.prepared, control[:3])
        shallow = np.maximum(search.soft_depth - depth, 0) * search.weight_of_depth
        volume = search._volume_weight * (self._mean + self._sum(residual) + solid.volume_offset)
        area = solid.area_weight * (self._bent + self._sum(self._bend * residual) + solid.area_offset)
        return Residuals(residual, field, interior.hinges_of(inner), inner, shallow, slope, volume, area)

    def cost(self, at: Residuals) -> float:
        """Return half the sum of the squares of the rows."""
        return at.half_sum_of_squares(self._weight)

    def normal_equations(self, at: Residuals) -> tuple[np.ndarray, np.ndarray]:
        """Return normal matrix (lower triangle) and gradient of the block."""
        search, n = self._search, self.begun.shape[1]
        solid = search.solid
        points, residual, factor = self.surface_rows(at)
        rows = np.empty((4 * n, points.shape[1]), dtype=np.float32)
        jacobian_of_rows(points, self.begun.astype(np.float32), factor, rows)
        matrix, gradient = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
        add_normal_matrix(rows, residual, matrix, gradient)
        share, mean = self._share / self._weight, np.empty(4 * n)
        for weight, values, row in (
            (search._volume_weight, share, at.volume),
            (solid.area_weight, self._bend * share, at.area),
        ):
            if weight:
                weighted_sums_of_rows(rows, values, mean)
                mean *= weight
                matrix += np.outer(mean, mean)
                gradient += mean * row
        search.add_depth_rows(at, matrix, gradient)
        return matrix, gradient

    def surface_rows(self, at: Residuals) -> SurfaceRows:
        """Return the rows at surface points, and after them those of interior points that lie too shallow."""
        interior = self._search._interior
        active = np.flatnonzero(at.hinge < 0)
        points = np.ascontiguousarray(np.hstack([self._points, interior.points[:, active]]))
        slope = np.concatenate([
            0.5 * self._scale * self._weight * at.field**-1.5,
            0.5 * (interior.side * interior.weight)[active] * at.inner[active] ** -1.5,
        ]).astype(np.float32)  # fmt: skip
        residual = np.concatenate([self._weight * at.surface, at.hinge[active]]).astype(np.float32)
        return SurfaceRows(points, residual, slope)

    def after(self, step: np.ndarray) -> np.ndarray:
        """Return the block after a step: bounded, and no control point shallower than allowed."""
        moved = bounded_step(self.begun, step)
        push_in(self._search.prepared, moved, self._least, self.begun)
        return moved


def field_at(points: np.ndarray, control: np.ndarray) -> np.ndarray:
    """Return f at points (rows x, y, z), all in single precision."""
    out = np.empty(points.shape[1], dtype=np.float32)
    field_of_rows(points, control, out)
    return out


def blocks(places: Float64[np.ndarray, "3 n"], most: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Yield the indices of points in groups of neighbours, `most` at most and about as many in each.

    Parameters
    ----------
    places : float array, shape (3, n)
    most : int
    rng : numpy.random.Generator
        Turns the axes along which groups are cut, so that their borders are elsewhere each time.
    """
    waiting = [np.arange(places.shape[1])]
    while waiting:
        group = waiting.pop()
        if len(group) <= most:
            yield np.sort(group)
            continue
        here = places[:, group]
        longest = np.linalg.eigh(np.cov(here))[1][:, 2]
        turned = rng.normal(size=3)
        axis = longest + _TILT * turned / np.linalg.norm(turned)
        along = np.argsort((axis[:, None] * here).sum(axis=0), kind="stable")
        waiting += [group[along[: len(group) // 2]], group[along[len(group) // 2 :]]]
