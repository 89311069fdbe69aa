"""Fitting many grains on several processes of one machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from mbstudio.core.batch.body_messages import grain_from, grain_message
from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.errors import FitError, MbstudioError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.goals.fit_goal import FitGoal
from mbstudio.core.imaging.steps import FitResult, Method
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.validity import Verdict
from mbstudio.core.units import VoxelSize


@dataclass(frozen=True, eq=False)
class BatchItem:
    """One grain of a batch, fitted or failed.

    Attributes
    ----------
    label : int
        The grain's label; its place in the batch where it has none.
    result : FitResult or None
    error : str or None
        Why there is no result.
    """

    label: int
    result: FitResult | None
    error: str | None


def grain_seed(seed: int, label: int) -> int:
    """Return the seed of one grain of a batch: the same whatever the order and the number of processes."""
    return int(np.random.SeedSequence([seed, label]).generate_state(1)[0])


def fit_many(
    grains: GrainSet | Sequence[Grain],
    labels: Sequence[int] | None = None,
    *,
    n: int = 40,
    method: Method = "fast",
    seed: int = 0,
    workers: int | None = None,
    options: Mapping[str, Any] | None = None,
    target: str | FitGoal | None = None,
) -> Iterator[BatchItem]:
    """Fit many grains; yield each as it is done.

    Parameters
    ----------
    grains : GrainSet or sequence of Grain
    labels : sequence of int, optional
        Which grains; all of them by default. For a sequence of grains: places in it, for those
        without a label.
    n, method, seed : as in :func:`mbstudio.core.imaging.fit`
        Each grain's own seed follows from `seed` and its label. A grain that holds at
        least half of n control points, but not n, gets as many as it can (``result.n`` stays n,
        ``result.avatar.n`` tells); one that holds fewer is an error.
    workers : int, optional
        Processes, each on one core; all usable cores by default. 0 fits in the calling thread.
    options : mapping, optional
        Options of the method.
    target : str or FitGoal, optional
        What each avatar is to reach with as few control points as may be, instead of `n`.

    Yields
    ------
    BatchItem
        In the order of completion. Closing the generator ends the processes at once.

    Raises
    ------
    FitError
        If n, the target, the method or an option can fit no grain at all; a single grain's error is in
        its item.
    """
    settings = dict(options or {})
    source: GrainSet | _ByLabel
    if isinstance(grains, GrainSet):
        source = grains
        chosen = [int(label) for label in (grains.table["label"] if labels is None else labels)]
    else:
        names = [place if grain.label is None else grain.label for place, grain in enumerate(grains)]
        chosen = names if labels is None else [int(label) for label in labels]
        source = _ByLabel(dict(zip(names, grains, strict=True)))
    aims = str(FitGoal.parse(target)) if target else ""
    _check(n, method, settings)
    if workers is None:
        workers = usable_cores()
    if workers < 0:
        raise FitError(
            f"The number of processes must be 1 or more, or 0 for the calling thread, not {workers}."
        )
    how = _HowToFit(n, method, settings, aims)
    return _fit_each(WorkerPool(_GrainFits(source, how, seed), workers), chosen)


class _ByLabel:
    """A few grains behind the one method of GrainSet that a batch needs."""

    def __init__(self, grains: dict[int, Grain]) -> None:
        self._grains = grains

    def grain(self, label: int, *, fill_cavities: bool = True) -> Grain:
        # These grains were made by the caller, who has chosen: a fit fills what cavities they have.
        if label not in self._grains:
            raise FitError(f"There is no grain {label} in this batch.")
        return self._grains[label]


def _check(n: int, method: Method, options: dict[str, Any]) -> None:
    from mbstudio.core.imaging import start_fit

    if not isinstance(n, bool) and int(n) == n and n >= 1:
        side = int(np.ceil(np.cbrt(n))) + 1
        start_fit(
            Grain(np.ones((side, side, side), dtype=bool), VoxelSize(1, 1, 1, "m")), n, method, 0, **options
        )
    else:
        raise FitError(f"n = {n} is not possible: n must be a whole number, 1 or more.")


def _fit_each(pool: WorkerPool[int, BatchItem], labels: list[int]) -> Iterator[BatchItem]:
    with closing(pool.as_completed(labels)) as done:
        for _, item in done:
            yield item


@dataclass(frozen=True)
class _HowToFit:
    """What a fit is told beside its grain and its seed."""

    n: int
    method: Method
    options: Mapping[str, Any]
    target: str


class _GrainFits(Job[int, BatchItem]):
    """In goes a grain by its label, out comes its avatar, or why it has none."""

    def __init__(self, grains: GrainSet | _ByLabel, how: _HowToFit, seed: int) -> None:
        self._grains, self._how, self._seed = grains, how, seed

    def _grain(self, label: int) -> Grain:
        # Grains are cut out of the label volume only when their turn comes.
        return self._grains.grain(label, fill_cavities=self._how.options.get("cavities") != "keep")

    def pack(self, label: int) -> Message:
        head, arrays = grain_message(self._grain(label))
        return {"grain": head, "how": asdict(self._how), "seed": grain_seed(self._seed, label)}, arrays

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        found = _fit_or_explain(grain_from(head["grain"], arrays), _HowToFit(**head["how"]), head["seed"])
        return ({"error": found}, {}) if isinstance(found, str) else _result_message(found)

    def unpack(self, label: int, head: Head, arrays: Arrays) -> BatchItem:
        error = head.get("error")
        return BatchItem(label, None if error else _result_from(head, arrays), error)

    def work_here(self, label: int) -> BatchItem:
        found = _fit_or_explain(self._grain(label), self._how, grain_seed(self._seed, label))
        return BatchItem(label, None, found) if isinstance(found, str) else BatchItem(label, found, None)

    def fail(self, label: int, error: MbstudioError) -> BatchItem:
        return BatchItem(label, None, str(error))

    def lose(self, label: int, code: int) -> BatchItem:
        told = (
            f"Grain {label}: the process that fitted it ended with code {code}, also when it was tried "
            "again: fit it with fewer processes, which need less memory."
        )
        return BatchItem(label, None, told)


def _fit_or_explain(grain: Grain, how: _HowToFit, seed: int) -> FitResult | str:
    """Fit one grain; return the result, or what went wrong: one bad grain must not end a batch.

    A grain that holds at least half of n control points, but not n, gets as many as it can hold:
    a scan always has fragments among its grains. With a target the number is looked for.
    """
    from mbstudio.core.imaging import fit
    from mbstudio.core.imaging.run import TooManyControlPoints

    try:
        try:
            return fit(grain, how.n, how.method, seed, target=how.target, **how.options)
        except TooManyControlPoints as error:
            if 2 * error.most < how.n:
                raise
            return replace(fit(grain, error.most, how.method, seed, **how.options), n=how.n)
    except MbstudioError as error:
        return str(error)
    except (ArithmeticError, ValueError, IndexError, MemoryError, RuntimeError) as error:
        return f"Grain '{grain.name}' could not be fitted: {type(error).__name__}: {error}."


def _result_message(result: FitResult) -> Message:
    avatar = result.avatar
    head = {
        "unit": avatar.unit,
        "label": avatar.label,
        "name": avatar.name,
        "verdict": asdict(result.verdict),
        "method": result.method,
        "n": result.n,
        "seed": result.seed,
        "options": dict(result.options),
        "target": result.target,
        "reached": dict(result.reached),
        "fitted_to": result.fitted_to,
    }
    arrays = {
        "centers": avatar.centers,
        "weights": avatar.weights,
        "history": result.history,
        "rms_history": result.rms_history,
    }
    return head, arrays


def _result_from(head: Head, arrays: Arrays) -> FitResult:
    avatar = Avatar(arrays["centers"], arrays["weights"], head["unit"], head["label"], head["name"])
    told = {name: tuple(head["verdict"][name]) for name in ("reasons", "warnings")}
    verdict = Verdict(**{**head["verdict"], **told})
    return FitResult(
        avatar, arrays["history"], arrays["rms_history"], verdict, head["method"], head["n"], head["seed"],
        head["options"], head["target"], head["reached"], head["fitted_to"],
    )  # fmt: skip
