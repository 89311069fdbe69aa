"""The joint fit as a step object: sweeps over all bodies, then a step of blur and void level."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from mbstudio.core.twin.body import HUBER, Body, Share, Surroundings, advance, render, surface_change
from mbstudio.core.twin.frame import Frame
from mbstudio.core.twin.levels import Levels, place_terms, void_shape
from mbstudio.core.twin.placing import colour_bodies
from mbstudio.core.twin.soundness import draw_back, is_whole

STEPS_A_VISIT = 2
_MOST_CHANGE = 1.25  # of the blur a sweep
_LEAST_BLUR = 0.3  # voxels: that of the voxel itself
_LEAST_FOR_VOID = 200  # pore voxels


@dataclass(frozen=True)
class TwinStep:
    """One step of a twin.

    Attributes
    ----------
    sweep, sweeps : int
        Which sweep of how many; 0 while grains are fitted to their labels.
    done : float
        Share of the whole work.
    blur : float
        In voxels; NaN before the first sweep.
    misfit : float
        Root mean square residual near a grain's surface in contrasts, median of the grains that this sweep
        has come to; NaN before the first.
    """

    sweep: int
    sweeps: int
    done: float
    blur: float
    misfit: float


class Visit(NamedTuple):
    """What a visit to a body leaves: sums for the blur's step and the misfit."""

    blur_gradient: float
    blur_square: float
    squares: float
    voxels: int


class Sweeps:
    """The step object of the joint fit; `next` moves bodies that have nothing to do with each other.

    Parameters
    ----------
    voxels : float32 array, shape (Z, Y, X)
        Grey values.
    labels : int array, shape (Z, Y, X)
    seen : bool array, shape (Z, Y, X)
    bodies : list of Body
    levels : Levels
    frame : Frame
    blur : float
        To begin with, in voxels.
    sweeps : int
    workers : int
        Threads; the result is the same with any number.
    """

    def __init__(
        self,
        voxels: Float32[np.ndarray, "Z Y X"],
        labels: Int[np.ndarray, "Z Y X"],
        seen: Bool[np.ndarray, "Z Y X"],
        bodies: list[Body],
        levels: Levels,
        frame: Frame,
        blur: float,
        sweeps: int,
        workers: int,
    ) -> None:
        self.voxels, self.labels, self.seen = voxels, labels, seen
        self.bodies, self.levels, self.frame = bodies, levels, frame
        self.blur, self.sweeps, self.workers = blur, sweeps, max(workers, 1)
        self._most_blur = 1.3 * blur
        self.grey = self._normalised()
        self.model = np.zeros_like(self.grey)
        self.misfit_at_start = float("nan")
        self.misfits: list[float] = []
        self._steps = self._all_steps()

    def __iter__(self) -> Iterator[TwinStep]:
        return self

    def __next__(self) -> TwinStep:
        return next(self._steps)

    def _normalised(self) -> Float32[np.ndarray, "Z Y X"]:
        """Return grey values less the void level, in contrasts."""
        levels = self.levels
        grey = (self.voxels - np.float32(levels.void)) / np.float32(levels.contrast)
        if levels.void_by_place.any():
            shape = grey.shape
            plane = np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[2]), indexing="ij"), axis=-1)
            for z in range(shape[0]):
                places = np.column_stack((np.full(plane[..., 0].size, z), plane.reshape(-1, 2)))
                drift = np.einsum("ma,a->m", place_terms(places, shape), levels.void_by_place)
                grey[z] -= (drift / levels.contrast).reshape(shape[1:]).astype(np.float32)
        grey[~self.seen] = 0.0
        return grey

    def surroundings(self, body: Body, found: Share) -> Surroundings:
        """Return what is left for a body to explain, where `found` is its share of the model."""
        grey, model = self.grey[body.box].ravel(), self.model[body.box].ravel()
        filled = np.clip(model, 0.0, 1.0)
        pores, solid = (
            self.levels.void_noise / abs(self.levels.contrast),
            self.levels.grain_noise / abs(self.levels.contrast),
        )
        variance = pores**2 + filled * (solid**2 - pores**2)
        sharpness = (1.0 / np.sqrt(variance)).astype(np.float32)
        sharpness[~self.seen[body.box].ravel()] = 0.0
        return Surroundings(grey - model + found.added, sharpness)

    def _put(self, body: Body, before: np.ndarray, after: np.ndarray) -> None:
        self.model[body.box] += (after - before).reshape(body.shape)

    def _visit(self, body: Body, checks: bool) -> Visit:
        spacing, blur = self.frame.spacing, self.blur
        old = render(body, spacing, body.blur)
        around = self.surroundings(body, old)
        before = body.control
        found = old if body.blur == blur else render(body, spacing, blur)
        for _ in range(STEPS_A_VISIT):
            found, helped = advance(body, found, around, spacing, blur)
            if not helped:
                break
        if checks:
            found = self._keep_whole(body, found)
        body.blur = blur
        body.moved = surface_change(before, found)
        body.shift = surface_change(body.start, found)
        self._put(body, old.added, found.added)
        return self._sums(found, around)

    def _keep_whole(self, body: Body, found: Share) -> Share:
        if is_whole(body.control):
            body.whole = body.control.copy()
            return found
        body.control, left = draw_back(body.control, body.whole)
        body.note = f"drawn back to {100 * left:.0f} % of a step that made it fall apart or hollow"
        return render(body, self.frame.spacing, self.blur)

    def _sums(self, found: Share, around: Surroundings) -> Visit:
        places = found.feet.places
        sharp = around.sharpness[places].astype(np.float64)
        residual = around.rest[places] - found.near_tone * found.share
        weight = sharp**2 * np.minimum(1.0, HUBER / np.maximum(np.abs(residual * sharp), 1e-9))
        by_blur = found.near_tone * found.by_blur
        seen = sharp > 0
        return Visit(
            float((weight * by_blur * residual).sum()), float((weight * by_blur**2).sum()),
            float((residual[seen] ** 2).sum()), int(seen.sum()),
        )  # fmt: skip

    def _start_one(self, body: Body) -> np.ndarray:
        return render(body, self.frame.spacing, self.blur).added

    def _all_steps(self) -> Iterator[TwinStep]:
        groups = colour_bodies(self.bodies)
        with ThreadPoolExecutor(self.workers) as pool:
            for group in groups:
                some = [self.bodies[i] for i in group]
                for body, added in zip(some, pool.map(self._start_one, some), strict=True):
                    self.model[body.box] += added.reshape(body.shape)
            self.misfit_at_start = self.misfit()
            self.misfits = [self.misfit_at_start]
            done, total = 0, self.sweeps * len(self.bodies)
            for sweep in range(1, self.sweeps + 1):
                checks = sweep in (self.sweeps, max(1, self.sweeps // 2))
                sums: list[tuple[int, Visit]] = []
                for group in groups:
                    some = [self.bodies[i] for i in group]
                    found = pool.map(lambda body, checks=checks: self._visit(body, checks), some)
                    sums += zip(group, found, strict=True)
                    done += len(group)
                    rms = [np.sqrt(visit.squares / visit.voxels) for _, visit in sums if visit.voxels]
                    so_far = float(np.median(rms)) if rms else 0.0
                    yield TwinStep(sweep, self.sweeps, done / total, self.blur, so_far)
                self.misfits.append(so_far)
                if sweep < self.sweeps:
                    self._step_blur([visit for _, visit in sorted(sums, key=lambda pair: pair[0])])
                    self._step_void()

    def _step_blur(self, visits: list[Visit]) -> None:
        gradient, square = sum(v.blur_gradient for v in visits), sum(v.blur_square for v in visits)
        if square > 0:
            wanted = self.blur + gradient / square
            wanted = float(np.clip(wanted, self.blur / _MOST_CHANGE, self.blur * _MOST_CHANGE))
            self.blur = min(max(wanted, _LEAST_BLUR), self._most_blur)

    def _step_void(self) -> None:
        """Take the void level from the pores that no body's blur reaches."""
        pores = (self.labels == 0) & (self.model == 0) & self.seen
        if int(np.count_nonzero(pores)) < _LEAST_FOR_VOID:
            return
        void, by_place = void_shape(self.voxels, pores, self.levels.contrast)
        if void != self.levels.void or (by_place != self.levels.void_by_place).any():
            self.levels = replace(self.levels, void=void, void_by_place=by_place)
            self.grey = self._normalised()

    def misfit(self) -> float:
        """Return the median over the bodies of the root mean square residual near the surface, in contrasts.

        Bright minerals in a few grains, or a few wrong labels, do not show in it.
        """
        found = [float(np.sqrt((rest**2).mean())) for rest in self._residuals()]
        return float(np.median(found)) if found else 0.0

    def _residuals(self) -> Iterator[Float64[np.ndarray, "m"]]:
        """Yield by body what is left near its surface, in contrasts."""
        for body in self.bodies:
            near = render(body, self.frame.spacing, body.blur).feet.places
            kept = near[self.seen[body.box].ravel()[near]]
            if len(kept):
                yield (self.grey[body.box] - self.model[body.box]).ravel()[kept].astype(np.float64)

    def residual_slice(self, axis: int, index: int) -> Float32[np.ndarray, "h w"]:
        """Return scan less model in contrasts on a slice across an axis (0 z, 1 y, 2 x); 0 where not seen.

        May be asked for while another thread sweeps: voxels are then as they are at that moment.
        """
        where = (slice(None),) * axis + (index,)
        found: np.ndarray = np.where(self.seen[where], self.grey[where] - self.model[where], np.float32(0.0))
        return found
