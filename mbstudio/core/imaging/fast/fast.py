"""The fast method: incremental sphere clustering, then the guarded Levenberg-Marquardt search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float64

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.fast.guard import (
    ITERATIONS_PER_ROUND,
    MOST_ROUNDS,
    force_sound,
    mend_handles,
    repair,
)
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings
from mbstudio.core.imaging.fast.relocation import relocate
from mbstudio.core.imaging.loss import mean_loss
from mbstudio.core.imaging.preprocess import CAVITIES
from mbstudio.core.imaging.run import StepRun, TooManyControlPoints, clustered
from mbstudio.core.imaging.start.control_points import control_of_spheres
from mbstudio.core.imaging.start.sphere_clustering import Sphere
from mbstudio.core.imaging.start.thin import number_needed, spread
from mbstudio.core.imaging.steps import SearchStep
from mbstudio.core.metaball.field import solid_bounds
from mbstudio.core.metaball.surface import volume_and_area_of_thin
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
    refine: RefineSettings = field(default_factory=RefineSettings)


# RMS distance (working lengths) plus relative volume error with which the fall-backs are content.
_GOOD_SCORE = 0.15
_MOST_MATCHED = 0.03
# Volume error of which one factor leaves so little that it is not measured again.
_MATCHED_AT_ONCE = 0.002
_MATCHED = "all weights scaled a little to match the volume of the voxels"
# By how much the score may grow for the right number of handles.
_MOST_FOR_HANDLES = 1.5
# Share of the control points that the body needs, below which neither holes nor tears are mended.
_FEWEST_OF_NEEDED = 0.5
_MOST_MATCHED_OF_THIN = 0.08
# How often control points are relocated, the steps between, and the share of them each time; the second where
# there are many: a relocation costs less then than it gains.
_RELOCATIONS_OF_FEW, _RELOCATIONS_OF_MANY, _MANY = (5, 8, 0.1), (7, 6, 0.07), 80
# Steps after the last.
_STEPS_AFTER = 10
_FEWEST_TO_RELOCATE = 10
_NOISE_TO_RELOCATE = 0.6
_STEPS_FOR_AREA = 12
_STEPS_AT_END = 6


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A sound avatar that the guard can fall back on."""

    control: Float64[np.ndarray, "4 n"]
    found: Topology
    score: float
    note: str


class FastFit(StepRun):
    """Step object of ``method='fast'``; see :class:`~mbstudio.core.imaging.steps.FitRun`."""

    method = "fast"
    options: FastOptions
    _refinement: Refinement | None = None
    _found: Topology | None = None

    def _further_spheres(self, n: int) -> Iterator[Sphere]:
        # All at once: they take milliseconds, and a grain that is too small says so before the first step.
        assert self.prepared is not None
        found = clustered(self.prepared, n)
        if len(found) < n:
            raise TooManyControlPoints(self.grain, n, len(found))
        return iter(found[len(self._spheres_found) :])

    def _control_of(self, spheres: Sequence[Sphere]) -> np.ndarray:
        """Return control points of spheres; in a thin body spread over its middle where that is truer."""
        assert self.prepared is not None
        prepared, control = self.prepared, control_of_spheres(self.prepared, spheres)
        if prepared.slenderness > 1 and (even := spread(prepared, len(spheres))) is not None:
            return min(control, even, key=lambda start: Refinement(prepared, start).rms())
        return control

    def _begin_at(self, control: np.ndarray) -> float:
        self._begin(control, self.options.refine)
        assert self._refinement is not None
        return mean_loss(self._refinement.field_on_hull())

    def _rms_now(self) -> float:
        assert self._refinement is not None
        return self._refinement.rms()

    def _begin(self, control: np.ndarray, settings: RefineSettings) -> None:
        assert self.prepared is not None
        search = Refinement(self.prepared, control, settings)
        search.settle()
        self._refinement, self.control, self._found = search, search.control, None

    def _topology_known(self) -> Topology | None:
        return self._found

    def _step(self, generations: int, note: str = "") -> SearchStep:
        assert self._refinement is not None
        self.control, self._found = self._refinement.control, None
        loss = mean_loss(self._refinement.field_on_hull())
        return self._record(loss, self._refinement.rms(), generations, note)

    def _search(self, generations: int) -> Iterator[SearchStep]:
        last = max(self.generation, 0) + generations
        if self.generation < 0 or self._found is None:
            yield self._step(last, self._take_note())
        # The last generation is kept for the volume, some before it for the area.
        for_area = _STEPS_FOR_AREA if generations > 2 * _STEPS_FOR_AREA else 0
        yield from self._descend(max(1, generations - 1 - for_area), last)
        if for_area and self._refinement is not None and self._refinement.strive_for_area():
            yield from self._descend(min(for_area, last - self.generation - 1), last, relocates=False)
        elif for_area and self._refinement is not None and self._refinement.take_more_points():
            yield from self._descend(min(_STEPS_AT_END, last - self.generation - 1), last, relocates=False)
        if generations > 1:
            if self._match_volume():
                yield self._step(last, _MATCHED)
            elif self.generation < last:
                yield from self._descend(1, last)
        matched = self.generation
        yield from self._guarded(last)
        if generations > 1:
            yield from self._mended(last)
            if self.generation > matched:
                yield from self._volume_matched_again(last)

    def _descend(self, count: int, last: int, *, relocates: bool = True) -> Iterator[SearchStep]:
        """Yield steps until `count`, or until progress stops; control points are relocated on the way."""
        assert self._refinement is not None
        assert self.prepared is not None
        search, settings = self._refinement, self._refinement.settings
        noise = settings.noise * self.prepared.fineness * self.prepared.scale
        checked, idle, stuck = self._rms[-1], 0, 0
        # On few or long voxels relocated points would only follow the steps.
        worth = relocates and self.n >= _FEWEST_TO_RELOCATE and np.isfinite(self.prepared.area)
        most, every, share = _RELOCATIONS_OF_MANY if self.n >= _MANY else _RELOCATIONS_OF_FEW
        relocations = most if worth else 0
        rng, before = np.random.default_rng([self.seed, 2]), (self._rms[-1], search.control)
        for done in range(1, count + 1):
            note = ""
            if relocations and done % every == 0 and count - done >= _STEPS_AFTER:
                if self._rms[-1] > 1.02 * before[0]:
                    search.set_control(before[1])
                    relocations = 0
                elif self._rms[-1] < _NOISE_TO_RELOCATE * noise:
                    relocations = 0
                else:
                    before = (self._rms[-1], search.control)
                    moved = max(1, round(share * search.control.shape[1]))
                    relocate(search, moved, rng)
                    relocations -= 1
                    note = f"{moved} control points moved to where the surface was farthest off"
            stuck = 0 if search.advance() else stuck + 1
            yield self._step(last, note)
            if stuck >= 2:
                return
            if done % settings.check_every == 0:
                gain = 1 - self._rms[-1] / max(checked, 1e-300)
                idle = idle + 1 if gain < settings.least_gain and not relocations else 0
                checked = self._rms[-1]
                if idle >= 2 or (checked < noise and gain < settings.least_gain_in_noise):
                    return

    def _match_volume(self) -> bool:
        """Take away a small volume error that the search left, by one factor on all weights."""
        assert self._refinement is not None
        assert self.prepared is not None
        prepared, control = self.prepared, self._refinement.control.copy()
        thin = prepared.slenderness > 1
        # More would only hide a wrong shape; but in thin bodies that much is soon a small displacement.
        most = max(_MOST_MATCHED, min(_MOST_MATCHED_OF_THIN, 0.4 * prepared.voxel / prepared.thickness))
        # Of a sphere, V goes with k**(3/2); of a sheet of many control points with some k**4.
        power, moved, before = (4.0, 0.0, 0.0) if thin else (1.5, 0.0, 0.0)
        for done in range(5 if thin else 2):
            volume, _ = volume_and_area_of_thin(control, 64, solid_bounds(control, rounds=1))
            excess = float(np.log(volume / prepared.volume))
            if abs(excess) > most:
                return False
            if thin and done and abs(moved) > 1e-9:
                power = float(np.clip((excess - before) / moved, 1.0, 8.0))
            moved, before = -excess / power, excess
            control[3] *= np.exp(moved)
            if abs(excess) < _MATCHED_AT_ONCE:
                break
        self._refinement.control = control
        return True

    def _volume_matched_again(self, last: int) -> Iterator[SearchStep]:
        """Yield a step with the volume of the voxels, if the avatar's topology stays as it is."""
        assert self._refinement is not None
        before, found = self._refinement.control, self._look()
        if not self._match_volume():
            return
        now = topology(self._refinement.control)
        if (now.pieces, now.voids, now.genus) != (found.pieces, found.voids, found.genus):
            self._refinement.control = before
            return
        yield self._step(last, _MATCHED)
        self._found = now

    def _guarded(self, last: int) -> Iterator[SearchStep]:
        """Yield further steps until the avatar is one piece without a void, by ever stronger means."""
        assert self._refinement is not None
        candidates = [self._forced()]
        if self._is_content(candidates[-1]):
            return
        yield from self._rounds(last)
        candidates.append(self._forced())
        if self._is_content(candidates[-1]):
            return
        numbers = dict.fromkeys((self.n, 2 * self.n // 3, self.n // 2, self.n // 4, 4, 1))
        cautious = replace(self.options.refine, steepness_floor=2.0, start_damping=10.0)
        for fewer in () if self._is_hopeless() else (number for number in numbers if 1 <= number <= self.n):
            self._begin(self._fresh(fewer), cautious)
            number = "" if fewer == self.n else f" with {fewer} control points"
            yield self._step(last, f"begins anew{number}, more cautiously: the avatar was not sound")
            yield from self._descend(self.options.generations, last)
            candidates.append(self._forced())
            if not self._is_content(candidates[-1]):
                yield from self._rounds(last)
                candidates.append(self._forced())
            if self._is_content(candidates[-1]):
                break
        best = min(candidates, key=lambda candidate: candidate.score)
        self._begin(best.control, self.options.refine)
        self._refinement.control = best.control
        yield self._step(last, best.note)
        self._found = best.found

    def _mended(self, last: int) -> Iterator[SearchStep]:
        """Yield further steps until the avatar has the handles of its grain, if it can at a fair price."""
        assert self._refinement is not None
        assert self.prepared is not None
        wanted = self.prepared.genus
        if wanted is None or self._look().genus == wanted or self._is_hopeless():
            return
        candidates = [self._forced()]
        affordable = _MOST_FOR_HANDLES * candidates[0].score
        for round_number in range(MOST_ROUNDS):
            note = mend_handles(self._refinement, round_number)
            if not note:
                break
            for step in range(ITERATIONS_PER_ROUND):
                self._refinement.advance()
                yield self._step(last, note if step == 0 else "")
            if self._look().is_sound and self._match_volume():
                yield self._step(last, _MATCHED)
            candidates.append(self._forced())
            if self._look().genus == wanted or candidates[-1].score > affordable:
                break
        best = min(
            (candidate for candidate in candidates if candidate.score <= affordable),
            key=lambda candidate: (abs(candidate.found.genus - wanted), candidate.score),
        )
        if best is not candidates[-1] or not self._look().is_sound:
            self._begin(best.control, self.options.refine)
            self._refinement.control = best.control
            yield self._step(last, "other handles than the grain's: to mend them would cost too much truth")
            self._found = best.found

    def _is_hopeless(self) -> bool:
        """Tell whether the body needs so many more control points that trying again is in vain."""
        assert self.prepared is not None
        return self.n < _FEWEST_OF_NEEDED * number_needed(self.prepared)

    def _is_content(self, candidate: _Candidate) -> bool:
        """Tell whether the present avatar, scored as `candidate`, is sound without force and true enough."""
        return self._is_sound(self._look()) and candidate.score < _GOOD_SCORE

    def _fresh(self, n: int) -> np.ndarray:
        """Return the start from n spheres."""
        return self._control_of(self._first_spheres(n))

    def _rounds(self, last: int) -> Iterator[SearchStep]:
        assert self._refinement is not None
        rng = np.random.default_rng([self.seed, 1])
        for number in range(MOST_ROUNDS):
            if self._is_sound(self._look()):
                return
            note = repair(self._refinement, self._look(), number, rng)
            for step in range(ITERATIONS_PER_ROUND):
                self._refinement.advance()
                yield self._step(last, note if step == 0 else "")

    def _is_sound(self, found: Topology) -> bool:
        """One piece, and no void beyond the cavities that were kept on purpose."""
        assert self.prepared is not None
        return found.pieces == 1 and found.voids <= self.prepared.cavities

    def _look(self) -> Topology:
        assert self.control is not None
        if self._found is None:
            self._found = topology(self.control)
        return self._found

    def _forced(self) -> _Candidate:
        """Return the present avatar, made sound by force where it is not, scored by its errors."""
        assert self.prepared is not None
        assert self.control is not None
        assert self._refinement is not None
        search, found, note = self._refinement, self._look(), "the soundest avatar so far"
        if not self._is_sound(found):
            control, found, note = force_sound(self.control, self.prepared)
            search = Refinement(self.prepared, control)
        volume, _ = volume_and_area_of_thin(search.control)
        score = search.rms() + abs(volume / self.prepared.volume - 1)
        return _Candidate(search.control.copy(), found, score, note)
