"""Fitting many grains on several processes of one machine."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbstudio.core.batch.processes import Child, Crew, usable_cores
from mbstudio.core.batch.worker import receive_answer, run_task, send_task
from mbstudio.core.errors import FitError, MbstudioError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.goals.target import FitTarget
from mbstudio.core.imaging.steps import FitResult, Method

_Answer = tuple[FitResult | None, str | None]


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
    target: str | FitTarget | None = None,
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
    target : str or FitTarget, optional
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
    aims = str(FitTarget.parse(target)) if target else ""
    _check(n, method, settings)
    if workers is None:
        workers = usable_cores()
    if workers < 0:
        raise FitError(
            f"{workers} processes cannot fit anything: give 1 or more, or 0 for the calling thread."
        )
    tasks = _Tasks(source, chosen, n, method, seed, settings, aims)
    if workers == 0:
        return _in_this_thread(tasks)
    return _on_processes(tasks, min(workers, max(1, len(chosen))))


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
    from mbstudio.core.units import VoxelSize

    if not isinstance(n, bool) and int(n) == n and n >= 1:
        side = int(np.ceil(np.cbrt(n))) + 1
        start_fit(
            Grain(np.ones((side, side, side), dtype=bool), VoxelSize(1, 1, 1, "m")), n, method, 0, **options
        )
    else:
        raise FitError(f"n = {n} control points make no avatar: give a whole number, 1 or more.")


class _Tasks:
    """The grains still to do, handed out one at a time to whichever worker asks."""

    def __init__(
        self,
        grains: GrainSet | _ByLabel,
        labels: list[int],
        n: int,
        method: str,
        seed: int,
        options: dict[str, Any],
        target: str,
    ) -> None:
        self._grains, self._labels = grains, iter(labels)
        self.count = len(labels)
        self.n, self.method, self.seed, self.options, self.target = n, method, seed, options, target
        self._lock = threading.Lock()

    def of(self, label: int) -> tuple[int, str, int, dict[str, Any], str]:
        """Return what a worker is told of a grain beside the grain."""
        return self.n, self.method, grain_seed(self.seed, label), self.options, self.target

    def next_label(self) -> int | None:
        with self._lock:
            return next(self._labels, None)

    def grain(self, label: int) -> Grain:
        # Grains are cut out of the label volume only when their turn comes.
        return self._grains.grain(label, fill_cavities=self.options.get("cavities") != "keep")


def _in_this_thread(tasks: _Tasks) -> Iterator[BatchItem]:
    while (label := tasks.next_label()) is not None:
        try:
            grain = tasks.grain(label)
        except MbstudioError as error:
            yield BatchItem(label, None, str(error))
            continue
        yield BatchItem(label, *run_task(grain, *tasks.of(label)))


class _Worker(Child):
    """A process that fits."""

    def __init__(self) -> None:
        super().__init__("mbstudio.core.batch.worker")

    def fit(self, grain: Grain, *task: Any) -> _Answer:
        send_task(self.requests, grain, *task)
        return receive_answer(self.answers)


def _on_processes(tasks: _Tasks, size: int) -> Iterator[BatchItem]:
    def fit(worker: _Worker, label: int) -> BatchItem:
        try:
            grain = tasks.grain(label)
        except MbstudioError as error:
            return BatchItem(label, None, str(error))
        return BatchItem(label, *worker.fit(grain, *tasks.of(label)))

    def lost(label: int, code: int) -> BatchItem:
        return BatchItem(label, None, f"Grain {label}: the process that fitted it ended with code {code}.")

    return Crew(_Worker, tasks.next_label, fit, lost, size).items(tasks.count)
