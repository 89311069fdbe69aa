"""MetaballVAE's generator: new grains as like their parents, or as asked for, as these parents allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np
from jaxtyping import Bool, Float64, Int

from mbstudio.core.errors import GenerationError
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations.measuring import measure_population
from mbstudio.core.populations.population import Population
from mbstudio.core.vae.generate.candidates import (
    REASONS,
    REPAIRED,
    VALID,
    Candidates,
    Progress,
    examine_all,
)
from mbstudio.core.vae.generate.conditions import Condition, Reached, parse_conditions, reach_words
from mbstudio.core.vae.generate.generation import Counts, Generation, Learner
from mbstudio.core.vae.generate.novelty import nearest_others, nearest_to
from mbstudio.core.vae.generate.selection import (
    BALANCED_FACTORS,
    LEVELS,
    Choice,
    Moments,
    choose,
    novelty_rows,
)
from mbstudio.core.vae.models.radii import log_radii

_FIRST_SHARE = 2.5
_SPARE = 80
_MOST_SHARE = 4.0
_MOST_SHARE_OF_CONDITIONS = 12.0
_MOST_ROUNDS = 8
_CALIBRATORS = 24
_CORRECTIONS = 3
_CLOSE = 0.02
"""Deviations of the parents by which means, and share by which deviations, may miss theirs."""


def generate(
    learner: Learner,
    count: int,
    seed: int = 0,
    *,
    targets: Sequence[str] | Sequence[Condition] | None = None,
    processes: int = 1,
    measured: bool = True,
    on_progress: Progress | None = None,
) -> Generation:
    """Return `count` new valid grains.

    From more candidates than clones a subset is chosen whose means, standard deviations and correlations of
    the paper's six factors are the parents' (size and shape together); with `targets`, one that departs from
    that as little as they demand.

    Parameters
    ----------
    learner : StyleLearner
    count : int
    seed : int
        The same seed gives the same clones, whatever the number of processes.
    targets : sequence of str or Condition, optional
        What the clones are to be like, as for :func:`mbstudio.core.vae.generate.conditions.parse_conditions`.
    processes : int
    measured : bool
        Also measure every clone exactly. With conditions clones are always measured.
    on_progress : callable, optional
        ``progress(share, message)``; what it raises ends the work at once.

    Raises
    ------
    GenerationError
        If the count is not positive, a condition cannot be read, or these parents cannot give what is asked.
    """
    if count < 1:
        raise GenerationError(f"The number of clones must be 1 or more, not {count}.")
    if processes < 1:
        raise GenerationError(f"The number of processes must be 1 or more, not {processes}.")
    report = on_progress or (lambda _share, _message: None)
    wanted = _read_conditions(targets or (), learner.parents.unit)
    work = _GenerationRun(learner, count, seed, wanted, processes, report)
    choice = work.choose()
    exact = None
    if wanted:
        choice, exact = work.meet_conditions(choice)
    elif measured:
        choice, exact = work.follow_parents(choice)
    report(1.0, f"{count} clones")
    return work.conclude(choice, exact)


def _read_conditions(given: Sequence[str] | Sequence[Condition], unit: str) -> tuple[Condition, ...]:
    texts = [given] if isinstance(given, str) else list(given)
    found: list[Condition] = []
    for condition in texts:
        found.extend(parse_conditions([condition], unit) if isinstance(condition, str) else [condition])
    return tuple(found)


def _balanced_values(bodies: Population) -> Float64[np.ndarray, "bodies 6"]:
    return np.stack([bodies.column(name) for name in BALANCED_FACTORS], axis=1)


class _GenerationRun:
    """One generation under way: its candidates, and what is known of them exactly."""

    def __init__(
        self, learner: Learner, count: int, seed: int, conditions: tuple[Condition, ...], processes: int,
        report: Progress,
    ) -> None:  # fmt: skip
        self._learner, self._count, self._seed = learner, count, seed
        self._conditions, self._processes, self._report = conditions, processes, report
        # A factor that the quick way does not give is measured of every candidate.
        self._detail = any(condition.factor not in FACTORS.quick for condition in conditions)
        self._batches = self._choices = 0
        self._exact: dict[int, dict[str, float]] = {}
        self._unmeasurable: set[int] = set()
        self._replaced = 0
        self._lines: dict[str, tuple[float, float]] = {}
        self._exact_parents: Population | None = None
        self._distances = np.empty(0)
        self._parents = self._measure_parents()
        self._pool = self._draw(int(np.ceil(_FIRST_SHARE * count)) + _SPARE)

    def _measure_parents(self) -> Moments:
        parents = self._learner.parents
        nothing = np.empty((len(parents), 0))
        found = examine_all(parents, nothing, nothing, processes=self._processes)
        values = np.stack([found.column(name) for name in BALANCED_FACTORS], axis=1)
        known = np.isfinite(values).all(axis=1)
        values = values[known]
        if len(values) < 2:
            raise GenerationError(
                f"{len(values)} of the {len(parents)} parents can be measured: clones need at least two."
            )
        self._radii = log_radii(parents.take(np.flatnonzero(known)))
        self._among = nearest_others(self._radii)
        return Moments.from_values(values)

    def _draw(self, count: int) -> Candidates:
        """Return further candidates; every batch has a seed of its own."""
        seed = int(np.random.SeedSequence([self._seed, self._batches]).generate_state(1, np.uint32)[0])
        self._batches += 1
        drawn = self._learner.sample(count, seed)
        share = 0.5 if not self._conditions else 0.35
        return examine_all(
            drawn.serialization, drawn.latents, drawn.parents, processes=self._processes,
            progress=lambda done, words: self._report(share * done, words),
        )  # fmt: skip

    def choose(self) -> Choice:
        """Return the choice, drawing further candidates while they help."""
        while True:
            found = self._choose()
            least = max(1.2 * self._count, self._count + 1)
            short = self._usable().sum() < least
            if found is not None and not short and (found.level <= 1 or self._conditions):
                return found
            more = self._count_more(found)
            if more == 0:
                return found or self._refuse()
            self._pool = self._pool.join(self._draw(more))

    def _choose(self, kept: Sequence[int] = ()) -> Choice | None:
        usable = np.flatnonzero(self._usable())
        values = np.stack([self._column(name)[usable] for name in BALANCED_FACTORS], axis=1)
        # Another draw each time: with few clones some come nearer than others.
        self._choices += 1
        rng = np.random.default_rng([self._seed, 0xC40, self._choices])
        admitted = asked = None
        if self._conditions:
            volumes = self._column("volume")[usable]
            columns = [self._column(condition.factor)[usable] for condition in self._conditions]
            pairs = list(zip(self._conditions, columns, strict=True))
            admitted = np.logical_and.reduce([condition.admits(column) for condition, column in pairs])
            asked = np.concatenate([condition.rows(column, volumes) for condition, column in pairs], axis=1)
        places = np.flatnonzero(np.isin(usable, np.array(kept, dtype=np.int64))).tolist()
        found = choose(
            values, self._count, self._parents, rng, novel=novelty_rows(self._nearest()[usable], self._among),
            admitted=admitted, asked=asked, kept=places,
        )  # fmt: skip
        return None if found is None else replace(found, rows=usable[found.rows])

    def _nearest(self) -> Float64[np.ndarray, " candidates"]:
        """Return the distance of each candidate to its nearest parent, NaN for those that are refused."""
        done = len(self._distances)
        found = np.full(len(self._pool) - done, np.nan)
        bodies = np.flatnonzero(self._pool.states[done:] <= REPAIRED)
        if len(bodies):
            radii = log_radii(self._pool.shapes.take(done + bodies))
            found[bodies] = nearest_to(radii, self._radii)
        self._distances = np.concatenate([self._distances, found])
        return self._distances

    def _count_more(self, found: Choice | None) -> int:
        """Return how many further candidates to draw, none where they would not help."""
        have, usable = len(self._pool), self._usable()
        most = _MOST_SHARE_OF_CONDITIONS if self._conditions else _MOST_SHARE
        room = int(most * self._count) + 3 * _SPARE - have
        if room <= 0:
            return 0
        fitting = usable.copy()
        for condition in self._conditions:
            column = self._column(condition.factor)
            fitting &= condition.admits(np.where(np.isfinite(column), column, -np.inf))
        share = fitting.sum() / have
        if share == 0 or (found is None and self._count / share > 2.0 * (have + room)):
            return 0
        lacking = int(1.3 * self._count / share) - have
        return min(room, max(lacking, have // 2))

    def _usable(self) -> Bool[np.ndarray, " candidates"]:
        usable = self._pool.states <= REPAIRED
        usable[sorted(self._unmeasurable)] = False
        return usable

    def _column(self, name: str) -> Float64[np.ndarray, " candidates"]:
        """Return a factor of all candidates: exact where known, else the quick one, brought to scale."""
        if name in FACTORS.quick:
            slope, start = self._lines.get(name, (1.0, 0.0))
            column = start + slope * self._pool.column(name)
        else:
            self._measure(np.flatnonzero(self._usable()).tolist())
            column = np.full(len(self._pool), np.nan)
        for i, factors in self._exact.items():
            column[i] = factors[name]
        return column

    def _measure(self, rows: Sequence[int]) -> None:
        unknown = [i for i in rows if i not in self._exact and i not in self._unmeasurable]
        if not unknown:
            return
        found = measure_population(
            self._pool.shapes.take(unknown).avatars(), labels=unknown, kind="clones", detail=self._detail,
            workers=0 if self._processes == 1 else self._processes,
            progress=lambda done, words: self._report(0.5 + 0.49 * done, words),
        )  # fmt: skip
        for place, i in enumerate(unknown):
            if found.measured[place]:
                self._exact[i] = {name: float(column[place]) for name, column in found.factors.items()}
            else:
                self._unmeasurable.add(i)

    def meet_conditions(self, choice: Choice) -> tuple[Choice, Population]:
        """Return a choice whose exact factors meet the conditions; choose anew where they do not yet."""
        before: set[int] = set()
        # Lengths found by rays are a little short: bring them to the scale of the exact ones first.
        self._measure(choice.rows[:: max(1, len(choice.rows) // _CALIBRATORS)].tolist())
        self._calibrate()
        for _ in range(_MOST_ROUNDS):
            choice = self._choose(sorted(self._exact)) or self._refuse()
            self._replaced += len(before - set(choice.rows.tolist()))
            self._measure(choice.rows.tolist())
            before = set(choice.rows.tolist())
            if before & self._unmeasurable:
                continue
            if all(figure.is_met for figure in self._reached(choice)):
                return choice, self._population(choice)
        missed = next((figure for figure in self._reached(choice) if not figure.is_met), None)
        words = "" if missed is None else f": {missed.what} comes to {missed.found:.4g}"
        raise GenerationError(
            f"These parents cannot give {self._describe_conditions()} closely enough{words}."
        )

    def follow_parents(self, choice: Choice) -> tuple[Choice, Population]:
        """Return a choice whose exact factors follow the parents' exact ones.

        On rough bodies rays find the perimeter of a projection, and so its circularity, only roughly. So
        after the first choice is measured, others are chosen for what rays could not tell.
        """
        choice, exact = self.replace_unmeasurable(choice)
        quick, parents = self._parents, self._measure_parents_exactly()
        for _ in range(_CORRECTIONS):
            if parents is None or parents.largest_error(_balanced_values(exact)) <= _CLOSE:
                break
            self._parents = parents
            self._fit_lines()
            again = self._choose(sorted(self._exact))
            if again is None or again.level > choice.level:
                self._parents = quick
                break
            after, found = self.replace_unmeasurable(again)
            if parents.largest_error(_balanced_values(found)) < parents.largest_error(
                _balanced_values(exact)
            ):
                self._replaced += len(set(choice.rows.tolist()) - set(after.rows.tolist()))
                choice, exact = after, found
        return choice, exact

    def _measure_parents_exactly(self) -> Moments | None:
        """Return the moments of the parents by the measure of the clones; None if too few can be measured."""
        shapes = self._learner.parents
        self._exact_parents = measure_population(
            shapes.avatars(), range(1, len(shapes) + 1), name="parents", kind="avatars",
            workers=0 if self._processes == 1 else self._processes,
            progress=lambda _done, words: self._report(0.99, f"parents: {words}"),
        )  # fmt: skip
        values = _balanced_values(self._exact_parents)
        values = values[np.isfinite(values).all(axis=1)]
        return Moments.from_values(values) if len(values) > 1 else None

    def _fit_lines(self) -> None:
        """Bring the quick factors of all candidates to the exact ones of those measured, by a line each."""
        rows = sorted(self._exact)
        for name in BALANCED_FACTORS:
            exact = np.array([self._exact[i][name] for i in rows])
            rough = self._pool.column(name)[rows]
            spread = float(rough.var())
            slope = float(np.cov(rough, exact, bias=True)[0, 1]) / spread if spread > 1e-18 else 1.0
            self._lines[name] = (slope, float(exact.mean() - slope * rough.mean()))

    def replace_unmeasurable(self, choice: Choice) -> tuple[Choice, Population]:
        """Return a choice of which every body can be measured exactly."""
        for _ in range(_MOST_ROUNDS):
            self._measure(choice.rows.tolist())
            lost = set(choice.rows.tolist()) & self._unmeasurable
            if not lost:
                return choice, self._population(choice)
            self._replaced += len(lost)
            choice = replace(choice, rows=self._exchange(choice.rows, lost))
        raise GenerationError("Too many clones of these parents cannot be measured: learn their style again.")

    def _exchange(self, rows: Int[np.ndarray, " count"], lost: set[int]) -> Int[np.ndarray, " count"]:
        """Return the rows with each lost one replaced by the free candidate most like it."""
        values = np.stack([self._pool.column(name) for name in BALANCED_FACTORS], axis=1)
        scaled = values / np.where(self._parents.deviations > 0, self._parents.deviations, np.inf)
        taken = [int(i) for i in rows if int(i) not in lost]
        free = self._usable()
        free[taken] = False
        for i in sorted(lost):
            places = np.flatnonzero(free)
            if not len(places):
                raise GenerationError("There are too few valid candidates: learn the style of more grains.")
            nearest = int(places[np.square(scaled[places] - scaled[i]).sum(axis=1).argmin()])
            taken.append(nearest)
            free[nearest] = False
        return np.sort(np.array(taken))

    def _calibrate(self) -> None:
        rows = sorted(self._exact)
        for name in {condition.factor for condition in self._conditions} | set(BALANCED_FACTORS):
            if name in FACTORS.quick:
                exact = np.array([self._exact[i][name] for i in rows])
                self._lines[name] = (float(exact.mean() / self._pool.column(name)[rows].mean()), 0.0)

    def _reached(self, choice: Choice) -> tuple[Reached, ...]:
        factors = [self._exact[int(i)] for i in choice.rows]
        volumes = np.array([row["volume"] for row in factors])
        found: list[Reached] = []
        for condition in self._conditions:
            found.extend(condition.reached(np.array([row[condition.factor] for row in factors]), volumes))
        return tuple(found)

    def _population(self, choice: Choice) -> Population:
        rows = [self._exact[int(i)] for i in choice.rows]
        return Population(
            "clones", "clones", np.arange(1, len(rows) + 1),
            {name: np.array([row[name] for row in rows]) for name in rows[0]},
            self._pool.shapes.unit, "obb", "avatar", ("",) * len(rows), ("",) * len(rows),
        )  # fmt: skip

    def _describe_conditions(self) -> str:
        return f"{self._count} clones with {' and '.join(str(condition) for condition in self._conditions)}"

    def _refuse(self) -> NoReturn:
        usable = self._usable()
        if not self._conditions:
            raise GenerationError(
                f"Of {len(self._pool)} candidates only {int(usable.sum())} are valid bodies: too few for "
                f"{self._count} clones. Learn the style of grains with better fits."
            )
        names = dict.fromkeys(condition.factor for condition in self._conditions)
        reach = ", ".join(
            reach_words(name, self._column(name)[usable], self._pool.shapes.unit) for name in names
        )
        raise GenerationError(
            f"These parents cannot give {self._describe_conditions()}: their clones have {reach}. "
            "Ask for values in that range."
        )

    def conclude(self, choice: Choice, exact: Population | None) -> Generation:
        """Return the result of a choice."""
        pool, rows = self._pool, choice.rows
        digits = len(str(self._count))
        names = tuple(f"clone_{i + 1:0{digits}d}" for i in range(len(rows)))
        states = pool.states
        counts = Counts(
            candidates=len(pool),
            valid=int((states == VALID).sum()),
            repaired=int((states == REPAIRED).sum()),
            refused={words: int((states == state).sum()) for state, words in REASONS.items()},
            clones_repaired=int((states[rows] == REPAIRED).sum()),
            replaced=self._replaced,
        )
        how = (
            LEVELS[choice.level]
            if not self._conditions
            else f"{self._describe_conditions()}, otherwise as similar to the parents as possible"
        )
        return Generation(
            replace(pool.shapes.take(rows), names=names), pool.latents[rows], pool.parents[rows], exact,
            counts, how, choice.effective, self._reached(choice) if self._conditions else (), self._seed,
            self._exact_parents,
        )  # fmt: skip
