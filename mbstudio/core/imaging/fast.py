"""The fast method: incremental sphere clustering, then the guarded Levenberg-Marquardt search."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.control_points import control_of_spheres, with_number
from mbstudio.core.imaging.guard import ITERATIONS_PER_ROUND, MOST_ROUNDS, force_sound, lies_outside, repair
from mbstudio.core.imaging.loss import mean_loss
from mbstudio.core.imaging.preprocess import PreparedGrain, prepare
from mbstudio.core.imaging.refine import Refinement, RefineSettings
from mbstudio.core.imaging.run import StepRun, too_many
from mbstudio.core.imaging.sphere_clustering import Sphere, cluster_incrementally
from mbstudio.core.imaging.steps import SearchStep, Verdict
from mbstudio.core.metaball.topology import Topology, topology
from mbstudio.core.metaball.validity import check


@dataclass(frozen=True)
class FastOptions:
    """Options of ``method='fast'``.

    Attributes
    ----------
    generations : int
        Steps of the search at most, before the guard; 10 are enough for a preview.
    working_side : int
        Longest side of the working grid; larger grains are averaged in blocks.
    hull_points : int
        Points on the surface at most.
    refine : RefineSettings
        Constants of the search.
    """

    generations: int = 60
    working_side: int = 120
    hull_points: int = 24_000
    refine: RefineSettings = RefineSettings()


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A sound avatar that the guard can fall back on."""

    control: Float64[np.ndarray, "4 n"]
    found: Topology
    score: float


class FastFit(StepRun):
    """Step object of ``method='fast'``; see :class:`~mbstudio.core.imaging.steps.FitRun`."""

    method = "fast"

    def __init__(self, grain: Grain, n: int, seed: int, options: FastOptions) -> None:
        self.options = options
        self._default_generations = options.generations
        self._refinement: Refinement | None = None
        self._found: Topology | None = None
        super().__init__(grain, n, seed)

    def _prepare(self) -> PreparedGrain:
        return prepare(
            self.grain,
            self.seed,
            working_side=self.options.working_side,
            hull_points=self.options.hull_points,
        )

    def _spheres(self, n: int) -> Iterator[Sphere]:
        # All at once: they take milliseconds, and a grain that is too small says so before the first step.
        assert self.prepared is not None
        prepared = self.prepared
        transform = prepared.distance + np.float32(0.5 * prepared.voxel)
        found = list(cluster_incrementally(transform, prepared.spacing, n, prepared.voxel))
        if len(found) < n:
            raise too_many(self.grain, n, len(found))
        return iter(found)

    def _check_capacity(self, n: int) -> None:
        self._spheres(n)

    def _start(self, spheres: list[Sphere]) -> None:
        assert self.prepared is not None
        self._spheres_found = list(spheres)
        self._begin(control_of_spheres(self.prepared, spheres), self.options.refine)

    def _begin(self, control: np.ndarray, settings: RefineSettings) -> None:
        assert self.prepared is not None
        search = Refinement(self.prepared, control, settings)
        search.push_inside(search.control, fallback=control)
        self._refinement, self.control, self._found = search, search.control, None

    def _change_number(self, n: int) -> None:
        assert self._refinement is not None and self.control is not None and self.prepared is not None
        self._begin(with_number(self.control, n, self.prepared), self.options.refine)

    def _judge(self) -> Verdict:
        assert self.prepared is not None and self.control is not None
        return check(
            self.prepared.avatar(self.control), self.grain, rms=self._rms[-1], found=self._found,
            outside=lies_outside(self.control, self.prepared),
        )  # fmt: skip

    def _step(self, generations: int, note: str = "") -> SearchStep:
        assert self._refinement is not None
        self.control, self._found = self._refinement.control, None
        field = self._refinement.field_on_hull()
        return self._record(mean_loss(field), self._refinement.rms(), generations, note)

    def _search(self, generations: int) -> Iterator[SearchStep]:
        last = max(self.generation, 0) + generations
        if self.generation < 0 or self._found is None:
            yield self._step(
                last, note="" if self.generation < 0 else f"goes on with {self.n} control points"
            )
        yield from self._descend(generations, last)
        yield from self._guarded(last)

    def _descend(self, count: int, last: int) -> Iterator[SearchStep]:
        """Yield steps until `count`, or until progress stops."""
        assert self._refinement is not None
        search = self._refinement
        checked, idle, stuck = self._rms[-1], 0, 0
        for done in range(1, count + 1):
            moved = search.advance()
            yield self._step(last)
            stuck = 0 if moved else stuck + 1
            if stuck >= 2:
                return
            if done % search.settings.check_every == 0:
                gain = 1 - self._rms[-1] / max(checked, 1e-300)
                idle = idle + 1 if gain < search.settings.least_gain else 0
                checked = self._rms[-1]
                if idle >= 2:
                    return

    def _guarded(self, last: int) -> Iterator[SearchStep]:
        """Yield further steps until the avatar is one piece without a void, by ever stronger means."""
        assert self.prepared is not None and self.control is not None
        if self._look().is_sound:
            return
        candidates: list[_Candidate] = []
        yield from self._rounds(last)
        if self._look().is_sound:
            return
        candidates.append(self._forced())
        cautious = replace(self.options.refine, steepness_floor=2.0, start_damping=10.0)
        begin = control_of_spheres(self.prepared, self._spheres_found[: self.n])
        if begin.shape[1] != self.n:
            begin = with_number(begin, self.n, self.prepared)
        self._begin(begin, cautious)
        yield self._step(last, note="begins anew, more cautiously: the avatar did not hold together")
        yield from self._descend(self.options.generations, last)
        if not self._look().is_sound:
            yield from self._rounds(last)
        if self._look().is_sound:
            return
        candidates.append(self._forced())
        best = min(candidates, key=lambda candidate: candidate.score)
        self._begin(best.control, self.options.refine)
        self.control = best.control
        yield self._step(last, note="forced into one piece without a void: n is too small for this shape")
        self.control, self._found = best.control, best.found

    def _rounds(self, last: int) -> Iterator[SearchStep]:
        assert self._refinement is not None
        rng = np.random.default_rng([self.seed, 1])
        for number in range(MOST_ROUNDS):
            note = repair(self._refinement, self._look(), number, rng)
            for step in range(ITERATIONS_PER_ROUND):
                self._refinement.advance()
                yield self._step(last, note if step == 0 else "")
            if self._look().is_sound:
                return

    def _look(self) -> Topology:
        assert self.control is not None
        if self._found is None:
            self._found = topology(self.control)
        return self._found

    def _forced(self) -> _Candidate:
        """Return the present avatar made sound by force, scored by volume error and surface distance."""
        from mbstudio.core.metaball.surface import volume_and_area

        assert self.prepared is not None and self.control is not None and self._refinement is not None
        control, found, _ = force_sound(self.control, self.prepared)
        kept, self._refinement.control = self._refinement.control, control
        rms = self._refinement.rms()
        self._refinement.control = kept
        volume, _ = volume_and_area(control)
        return _Candidate(control, found, rms + abs(volume / self.prepared.volume - 1))
