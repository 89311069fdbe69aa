"""The fit with as few control points as reach a goal, as a step object."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from mbstudio.core.errors import FitError
from mbstudio.core.goals import SmallestNumber
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.goals.fit_goal import FitGoal
from mbstudio.core.imaging.goals.likeness import Likeness
from mbstudio.core.imaging.run import StepRun, TooManyControlPoints
from mbstudio.core.imaging.steps import FitResult, SearchStep


@dataclass(frozen=True, eq=False)
class _Tried:
    """A finished fit and what it has reached."""

    run: StepRun
    result: FitResult
    values: Mapping[str, float]
    is_met: bool
    shortfall: float

    def is_better_than(self, other: _Tried | None) -> bool:
        """Return whether this one is to be kept: the smaller of two that will do, or the truer."""
        if other is None:
            return True
        if self.is_met or other.is_met:
            return self.is_met and (not other.is_met or self.result.n < other.result.n)
        mine = (not self.result.verdict.valid, self.shortfall, self.result.n)
        return mine < (not other.result.verdict.valid, other.shortfall, other.result.n)


class GoalFit:
    """Step object that looks for the smallest number of control points that reaches a goal.

    Every number is a fit of its own, so that the result is that of ``fit(grain, n)`` with the number found,
    whatever was tried before. The steps say in their note which number they belong to.

    Parameters
    ----------
    grain : Grain
    goal : FitGoal
    start : callable
        Returns the step object of a fit with n control points.
    """

    def __init__(self, grain: Grain, goal: FitGoal, start: Callable[[int], StepRun]) -> None:
        self.grain = grain
        self.goal = goal
        self._start = start
        self._numbers = SmallestNumber(goal.most)
        self._first = start(1)  # what no number of control points can cure is refused at once
        self._likeness: Likeness | None = None
        self._run: StepRun | None = None
        self._best: _Tried | None = None
        self._held: int | None = None
        self._failure: FitError | None = None
        self._given_up = False
        self._ended = False
        self._steps: Iterator[SearchStep] = self._all_steps()

    def __iter__(self) -> Iterator[SearchStep]:
        return self

    def __next__(self) -> SearchStep:
        return next(self._steps)

    def change_control_points(self, n: int) -> None:
        """Give the goal up, and go on with n control points from the fit at hand.

        Raises
        ------
        FitError
            If the grain cannot hold n control points; the search then stays as it was.
        """
        run = self._current_run()
        run.change_control_points(n)
        self._give_up(run)

    def more_generations(self, count: int) -> None:
        """Let the fit at hand go on for `count` more generations, whatever the goal says.

        Raises
        ------
        FitError
            If the search has not begun, or `count` is not positive.
        """
        run = self._current_run()
        run.more_generations(count)
        self._give_up(run)

    def result(self) -> FitResult:
        """Return the smallest avatar that reaches the goal, or the best there is, with a warning.

        Raises
        ------
        FitError
            If no search has begun.
        """
        if self._given_up:
            return self._current_run().result()
        best = self._best
        if best is None or not (best.is_met or self._ended):
            return self._stopped()
        found = replace(best.result, target=str(self.goal), reached=dict(best.values))
        return found if best.is_met else _warned(found, self._explain_miss(best))

    # ---- the search ----------------------------------------------------------------------------

    def _all_steps(self) -> Iterator[SearchStep]:
        before = f"goal {self.goal}"
        while (n := self._numbers.choose_next()) is not None:
            try:
                run = self._new_run(n)
                for step in run:
                    said = (f"n = {n}", before, step.note)
                    yield replace(step, note="; ".join(part for part in said if part))
                    before = ""
            except TooManyControlPoints as error:
                self._held = self._numbers.most = error.most
                continue
            except FitError as error:  # one number that cannot be fitted must not end the search
                self._failure = error
                self._numbers.record(n, will_do=False)
                before = f"n = {n} could not be fitted: {error}"
                continue
            tried = self._judge_run(run)
            self._numbers.record(n, will_do=tried.is_met)
            before = f"n = {n} {'reached' if tried.is_met else 'missed'} the goal: {self._describe(tried)}"
            if tried.is_better_than(self._best):
                self._best = tried
        if self._best is None and self._failure is not None:
            raise self._failure
        self._ended = True

    def _new_run(self, n: int) -> StepRun:
        """Return the step object of n control points; the grain is prepared only once."""
        before, self._run = self._run, self._first if n == 1 else self._start(n)
        if before is not None:
            self._run.share_preparation(before)
        return self._run

    def _judge_run(self, run: StepRun) -> _Tried:
        if self._likeness is None:
            self._likeness = Likeness(self.grain, run.options.cavities)
        result = run.result()
        values = self.goal.values(result, self._likeness)
        is_met = result.verdict.valid and self.goal.is_met(values)
        return _Tried(run, result, values, is_met, self.goal.shortfall(values))

    def _describe(self, tried: _Tried) -> str:
        told = self.goal.describe(tried.values)
        return told if tried.result.verdict.valid else f"{told}, and the avatar is not valid"

    # ---- what is at hand -----------------------------------------------------------------------

    def _current_run(self) -> StepRun:
        if self._ended and not self._given_up and self._best is not None:
            return self._best.run
        return self._run or self._first

    def _give_up(self, run: StepRun) -> None:
        self._run, self._given_up, self._steps = run, True, iter(run)
        self._best = None

    def _stopped(self) -> FitResult:
        """Return the truest avatar of a search that was stopped before any reached the goal."""
        now = self._current_run()
        if not now.has_begun and self._best is not None:
            now = self._best.run
        result, values = now.result(), {}
        if self._best is not None and now is self._best.run:
            values = dict(self._best.values)
        found = replace(result, target=str(self.goal), reached=values)
        return _warned(found, f"The search was stopped before the goal '{self.goal}' was reached.")

    def _explain_miss(self, best: _Tried) -> str:
        """Return in words that the goal was not reached, and why."""
        result, missed = best.result, self.goal.describe(best.values, only_missed=True)
        faults = [f"has {missed}"] if missed else []
        if not result.verdict.valid:
            faults.append("is not valid")
        told = (
            f"The goal '{self.goal}' was not reached: the best avatar, of n = {result.n}, "
            f"{' and '.join(faults)}. "
        )
        if self._held is not None:
            told += f"Its {self.grain.voxel_count} voxels hold at most {self._held} control points"
            cure = "Scan with smaller voxels, or ask for less."
        else:
            told += f"More than {self.goal.most} control points were not allowed"
            cure = f"Allow more ('... and n {2 * self.goal.most}'), or ask for less."
        share = max(self.grain.voxel_size.xyz) / self.grain.nominal_diameter
        if any(aim.measure in ("hausdorff", "rms") and aim.limit < share for aim in self.goal.aims):
            told += f"; a voxel is {100 * share:.2g} % of D_n, so the scan does not resolve finer shape"
        return f"{told}. {cure}"


def _warned(result: FitResult, warning: str) -> FitResult:
    verdict = replace(result.verdict, warnings=(*result.verdict.warnings, warning))
    return replace(result, verdict=verdict)
