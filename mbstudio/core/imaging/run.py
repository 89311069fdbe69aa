"""What the step objects of both methods share: clustering steps, records, result."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64

from mbstudio.core.errors import FitError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.control_points import control_of_spheres
from mbstudio.core.imaging.preprocess import PreparedGrain, prepare
from mbstudio.core.imaging.sphere_clustering import Sphere, cluster_incrementally, cluster_overlapping
from mbstudio.core.imaging.steps import FitResult, Method, SearchStep, Verdict
from mbstudio.core.metaball.avatar import Avatar


def clustered(prepared: PreparedGrain, n: int) -> list[Sphere]:
    """Return up to `n` spheres: as many as do not overlap, then overlapping ones."""
    transform = prepared.distance + np.float32(0.5 * prepared.voxel)
    found = list(cluster_incrementally(transform, prepared.spacing, n, prepared.voxel))
    if len(found) < n:
        found += cluster_overlapping(transform, prepared.spacing, found, n, prepared.voxel)
    return found


def greatest_number(grain: Grain) -> int:
    """Return how many control points sphere clustering can place in a grain."""
    return len(clustered(prepare(grain), grain.voxel_count))


def checked_number(n: int, grain: Grain) -> int:
    """Return n as an int; FitError unless the grain may hold that many control points."""
    whole = isinstance(n, numbers.Real) and not isinstance(n, bool) and math.isfinite(n) and int(n) == n
    if not whole or n < 1:
        raise FitError(
            f"n = {n} control points make no avatar of grain '{grain.name}': give a whole number, 1 or more."
        )
    if n > grain.voxel_count:  # spheres do not share voxels; how many really fit shows in the clustering
        raise TooManyControlPoints(grain, int(n), max(1, greatest_number(grain)))
    return int(n)


class TooManyControlPoints(FitError):
    """A grain that cannot hold n control points; `most` is the greatest number that it can."""

    def __init__(self, grain: Grain, n: int, most: int) -> None:
        self.most = most
        super().__init__(
            f"Grain '{grain.name}' of {grain.voxel_count} voxels cannot hold n = {n} control points: "
            f"ask for n = {most} or fewer."
        )

    def __reduce__(self) -> tuple[type[FitError], tuple[str]]:
        return FitError, (str(self),)


class StepRun:
    """Base of the step objects; a method fills in :meth:`_spheres` and :meth:`_search`.

    The steps come from one generator; changing the number of control points or asking for more
    generations replaces it by another that goes on from the state as it stands.
    """

    method: Method

    def __init__(self, grain: Grain, n: int, seed: int) -> None:
        self.grain = grain
        self.n = checked_number(n, grain)
        self.seed = int(seed)
        self.prepared: PreparedGrain | None = None
        self.control: Float64[np.ndarray, "4 n"] | None = None
        self.generation = -1
        self._spheres_found: list[Sphere] = []
        self._losses: list[float] = []
        self._rms: list[float] = []
        self._verdict: Verdict | None = None
        self._steps: Iterator[SearchStep] = self._all_steps()

    def __iter__(self) -> Iterator[SearchStep]:
        return self

    def __next__(self) -> SearchStep:
        return next(self._steps)

    def change_control_points(self, n: int) -> None:
        """Go on from here with another number of control points (those there are kept, split or merged).

        Raises
        ------
        FitError
            If the grain cannot hold n control points.
        """
        n = checked_number(n, self.grain)
        if n == self.n:
            return
        if self.control is None:  # still clustering: simply more or fewer spheres
            self.n = n
            self._steps = self._all_steps()
            return
        if n > self.n:
            self._check_capacity(n)
        self.n = n
        self._verdict = None
        self._change_number(n)
        self._steps = self._search(self._default_generations)

    def more_generations(self, count: int) -> None:
        """Let a finished or stopped search go on for `count` more generations.

        Raises
        ------
        FitError
            If the search has not begun, or `count` is not positive.
        """
        if count < 1:
            raise FitError(f"{count} more generations cannot be made: give a whole number, 1 or more.")
        if self.control is None:
            raise FitError("The gradient search has not begun: let the sphere clustering finish first.")
        self._verdict = None
        self._steps = self._search(int(count))

    def result(self) -> FitResult:
        """Return avatar, history and verdict as they stand now.

        Raises
        ------
        FitError
            If the search has not begun.
        """
        if self.control is None or self.prepared is None:
            raise FitError(f"The search for grain '{self.grain.name}' has not begun: there is no avatar yet.")
        if self._verdict is None:
            self._verdict = self._judge()
        return FitResult(
            avatar=self.prepared.avatar(self.control),
            history=np.array(self._losses),
            rms_history=np.array(self._rms),
            verdict=self._verdict,
            method=self.method,
            n=self.n,
            seed=self.seed,
        )

    # What a method brings along.
    _default_generations: int

    def _prepare(self) -> PreparedGrain:
        raise NotImplementedError

    def _spheres(self, n: int) -> Iterator[Sphere]:
        raise NotImplementedError

    def _start(self, spheres: list[Sphere]) -> None:
        raise NotImplementedError

    def _search(self, generations: int) -> Iterator[SearchStep]:
        raise NotImplementedError

    def _change_number(self, n: int) -> None:
        raise NotImplementedError

    def _check_capacity(self, n: int) -> None:
        assert self.prepared is not None
        found = len(clustered(self.prepared, n))
        if found < n:
            raise TooManyControlPoints(self.grain, n, found)

    def _judge(self) -> Verdict:
        from mbstudio.core.imaging.guard import lies_outside
        from mbstudio.core.imaging.thin import number_needed
        from mbstudio.core.metaball.validity import check

        assert self.prepared is not None
        assert self.control is not None
        prepared = self.prepared
        return check(
            prepared.avatar(self.control), self.grain, rms=self._rms[-1],
            outside=lies_outside(self.control, prepared), asked=self.n,
            needed=lambda: number_needed(prepared), kept=prepared.cavities, filled=prepared.filled_voxels,
        )  # fmt: skip

    def _all_steps(self) -> Iterator[SearchStep]:
        if self.prepared is None:
            self.prepared = self._prepare()
        prepared, found = self.prepared, []
        for sphere in self._spheres(self.n):
            found.append(sphere)
            yield self._clustering_step(prepared, found)
        if len(found) < self.n:
            raise TooManyControlPoints(self.grain, self.n, len(found))
        self._start(found)
        yield from self._search(self._default_generations)

    def _clustering_step(self, prepared: PreparedGrain, found: list[Sphere]) -> SearchStep:
        spheres = tuple(found)

        def make() -> Avatar:
            return prepared.avatar(control_of_spheres(prepared, spheres))

        note = ""
        if len(spheres) == 1 and prepared.filled_voxels:
            note = f"cavities of {prepared.filled_voxels} voxels inside the grain were filled"
        return SearchStep("clustering", len(spheres), self.n, float("nan"), float("nan"), make, note)

    def _record(self, loss: float, rms: float, generations: int, note: str = "") -> SearchStep:
        """Take down one generation of the search and return its step; `rms` in working lengths."""
        assert self.prepared is not None
        assert self.control is not None
        prepared, control = self.prepared, self.control.copy()
        self.generation += 1
        self._verdict = None
        self._losses.append(loss)
        self._rms.append(rms * prepared.scale)
        return SearchStep(
            "search", self.generation, max(generations, self.generation), loss, rms * prepared.scale,
            lambda: prepared.avatar(control), note,
        )  # fmt: skip
