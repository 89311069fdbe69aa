"""The fast method: incremental sphere clustering, then the guarded Levenberg-Marquardt search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.fast.block_refine import BlockRefinement
from mbstudio.core.imaging.fast.descent import Descent
from mbstudio.core.imaging.fast.guard import (
    ITERATIONS_PER_ROUND,
    MOST_ROUNDS,
    Candidate,
    is_sound,
    make_candidate,
    mend_handles,
    repair,
)
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings
from mbstudio.core.imaging.fast.volume import MATCHED, match_volume
from mbstudio.core.imaging.loss import mean_loss
from mbstudio.core.imaging.preprocess import CAVITIES
from mbstudio.core.imaging.run import StepRun, TooManyControlPoints, cluster_spheres
from mbstudio.core.imaging.start.control_points import control_of_spheres
from mbstudio.core.imaging.start.sphere_clustering import Sphere
from mbstudio.core.imaging.start.thin import number_needed, spread
from mbstudio.core.imaging.steps import SearchStep
from mbstudio.core.metaball.topology import Topology, topology
from mbstudio.core.options import OptionRecord, option


@dataclass(frozen=True)
class FastOptions(OptionRecord, owner="method 'fast'", error=FitError):
    """Options of ``method='fast'``; `refine` holds the constants of its search."""

    generations: int = option(
        60, "Steps of the search at most, before the guard; 10 are enough for a preview.", minimum=1
    )
    working_side: int = option(
        120, "Longest side of the working grid; larger grains are averaged in blocks.", minimum=4
    )
    hull_points: int = option(24_000, "Points on the surface at most.", minimum=10)
    cavities: Literal["fill", "keep"] = option(CAVITIES.default, CAVITIES.meaning, choices=CAVITIES.choices)
    blocks_from: int = option(
        150, "Control points from which on they move in blocks of neighbours: far faster.", minimum=1
    )
    refine: RefineSettings = field(default_factory=RefineSettings)


# Score of a candidate with which the fall-backs are content.
_GOOD_SCORE = 0.15
# By how much the score may grow for the right number of handles.
_MOST_FOR_HANDLES = 1.5
# Share of the control points that the body needs, below which neither holes nor tears are mended.
_FEWEST_OF_NEEDED = 0.5
_STEPS_FOR_AREA = 12
_STEPS_AT_END = 6


class FastFit(StepRun):
    """Step object of ``method='fast'``; see :class:`~mbstudio.core.imaging.steps.FitRun`."""

    method = "fast"
    options: FastOptions
    refinement: Refinement  # from the start of the search on
    _found: Topology | None = None

    def _find_spheres(self, n: int) -> Iterator[Sphere]:
        # All at once: they take milliseconds, and a grain that is too small says so before the first step.
        found = cluster_spheres(self.prepared, n)
        if len(found) < n:
            raise TooManyControlPoints(self.grain, n, len(found))
        return iter(found[len(self._spheres_found) :])

    def _place_control_points(self, spheres: Sequence[Sphere]) -> np.ndarray:
        """Return control points of spheres; in a thin body spread over its middle where that is truer."""
        prepared, control = self.prepared, control_of_spheres(self.prepared, spheres)
        if prepared.slenderness > 1 and (even := spread(prepared, len(spheres))) is not None:
            return min(control, even, key=lambda start: Refinement(prepared, start).rms())
        return control

    def _begin_at(self, control: np.ndarray) -> float:
        self._begin(control, self.options.refine)
        return mean_loss(self.refinement.field_on_hull())

    def _measure_rms(self) -> float:
        return self.refinement.rms()

    def _begin(self, control: np.ndarray, settings: RefineSettings) -> None:
        kind = BlockRefinement if control.shape[1] >= self.options.blocks_from else Refinement
        self.refinement = kind(self.prepared, control, settings)
        self.refinement.settle()
        self.control, self._found = self.refinement.control, None

    def _known_topology(self) -> Topology | None:
        return self._found

    def _look(self) -> Topology:
        """Return the topology of the avatar as it stands."""
        if self._found is None:
            self._found = topology(self.control)
        return self._found

    def _step(self, last: int, note: str = "") -> SearchStep:
        """Take the search as it stands down as a generation; `last` is that in which it is to end."""
        self.control, self._found = self.refinement.control, None
        return self._record(mean_loss(self.refinement.field_on_hull()), self.refinement.rms(), last, note)

    def _search(self, generations: int) -> Iterator[SearchStep]:
        last = max(self.generation, 0) + generations
        if self.generation < 0 or self._found is None:
            yield self._step(last, self._pop_note())
        # The last generation is kept for the volume, some before it for the area.
        for_area = _STEPS_FOR_AREA if generations > 2 * _STEPS_FOR_AREA else 0
        yield from self._descend(max(1, generations - 1 - for_area), last)
        if for_area and self.refinement.strive_for_area():
            yield from self._descend(min(for_area, last - self.generation - 1), last, relocates=False)
        elif for_area and self.refinement.take_more_points():
            yield from self._descend(min(_STEPS_AT_END, last - self.generation - 1), last, relocates=False)
        if generations > 1:
            if match_volume(self.refinement):
                yield self._step(last, MATCHED)
            elif self.generation < last:
                yield from self._descend(1, last)
        matched = self.generation
        yield from self._guard(last)
        if generations > 1:
            yield from self._mend_handles(last)
            if self.generation > matched:
                yield from self._match_volume_again(last)

    def _descend(self, count: int, last: int, *, relocates: bool = True) -> Iterator[SearchStep]:
        """Yield steps until `count`, or until progress stops; control points are relocated on the way."""
        descent = Descent(
            self.refinement, count, n=self.n, seed=self.seed, rms=self._rms[-1], relocates=relocates
        )
        for step in range(1, count + 1):
            note = descent.relocate_before(step, self._rms[-1])
            advanced = self.refinement.advance()
            yield self._step(last, note)
            if descent.is_over(step, self._rms[-1], advanced=advanced):
                return

    def _match_volume_again(self, last: int) -> Iterator[SearchStep]:
        """Yield a step with the volume of the voxels, if the avatar's topology stays as it is."""
        before, found = self.refinement.control, self._look()
        if not match_volume(self.refinement):
            return
        now = topology(self.refinement.control)
        if (now.pieces, now.voids, now.genus) != (found.pieces, found.voids, found.genus):
            self.refinement.control = before
            return
        yield self._step(last, MATCHED)
        self._found = now

    def _guard(self, last: int) -> Iterator[SearchStep]:
        """Yield further steps until the avatar is one piece without a void, by ever stronger means."""
        candidates = [self._candidate()]
        if self._is_content(candidates[-1]):
            return
        yield from self._repair(last)
        candidates.append(self._candidate())
        if self._is_content(candidates[-1]):
            return
        numbers = dict.fromkeys((self.n, 2 * self.n // 3, self.n // 2, self.n // 4, 4, 1))
        cautious = replace(self.options.refine, steepness_floor=2.0, start_damping=10.0)
        for fewer in () if self._is_hopeless() else (number for number in numbers if 1 <= number <= self.n):
            self._begin(self._place_control_points(self._require_spheres(fewer)), cautious)
            number = "" if fewer == self.n else f" with {fewer} control points"
            yield self._step(last, f"restarts{number} with smaller steps: the avatar was not valid")
            yield from self._descend(self.options.generations, last)
            candidates.append(self._candidate())
            if not self._is_content(candidates[-1]):
                yield from self._repair(last)
                candidates.append(self._candidate())
            if self._is_content(candidates[-1]):
                break
        best = min(candidates, key=lambda candidate: candidate.score)
        yield self._fall_back_on(best, last, best.note)
        self._found = best.found

    def _mend_handles(self, last: int) -> Iterator[SearchStep]:
        """Yield further steps until the avatar has the handles of its grain, if it can at a fair price."""
        wanted = self.prepared.genus
        if wanted is None or self._look().genus == wanted or self._is_hopeless():
            return
        candidates = [self._candidate()]
        affordable = _MOST_FOR_HANDLES * candidates[0].score
        for round_number in range(MOST_ROUNDS):
            note = mend_handles(self.refinement, round_number)
            if not note:
                break
            yield from self._advance_round(last, note)
            if self._look().is_sound and match_volume(self.refinement):
                yield self._step(last, MATCHED)
            candidates.append(self._candidate())
            if self._look().genus == wanted or candidates[-1].score > affordable:
                break
        best = min(
            (candidate for candidate in candidates if candidate.score <= affordable),
            key=lambda candidate: (abs(candidate.found.genus - wanted), candidate.score),
        )
        if best is not candidates[-1] or not self._look().is_sound:
            why = "handles differ from the grain's: removing them would cost too much accuracy"
            yield self._fall_back_on(best, last, why)
            self._found = best.found

    def _repair(self, last: int) -> Iterator[SearchStep]:
        """Yield rounds of steps until the avatar is sound, or there were enough."""
        rng = np.random.default_rng([self.seed, 1])
        for number in range(MOST_ROUNDS):
            if is_sound(self._look(), self.prepared):
                return
            yield from self._advance_round(last, repair(self.refinement, self._look(), number, rng))

    def _advance_round(self, last: int, note: str) -> Iterator[SearchStep]:
        """Yield the steps of one round of the guard, the first with its note."""
        for step in range(ITERATIONS_PER_ROUND):
            self.refinement.advance()
            yield self._step(last, note if step == 0 else "")

    def _fall_back_on(self, best: Candidate, last: int, note: str) -> SearchStep:
        """Return the step that puts a candidate in place of the avatar."""
        self._begin(best.control, self.options.refine)
        self.refinement.control = best.control
        return self._step(last, note)

    def _candidate(self) -> Candidate:
        return make_candidate(self.refinement, self._look())

    def _is_content(self, candidate: Candidate) -> bool:
        """Tell whether the present avatar, scored as `candidate`, is sound without force and true enough."""
        return is_sound(self._look(), self.prepared) and candidate.score < _GOOD_SCORE

    def _is_hopeless(self) -> bool:
        """Tell whether the body needs so many more control points that trying again is in vain."""
        return self.n < _FEWEST_OF_NEEDED * number_needed(self.prepared)
