"""Measuring many grains and their avatars, on several processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import islice
from typing import TYPE_CHECKING, Any

from mbstudio.cli import console
from mbstudio.core.errors import MbstudioError

if TYPE_CHECKING:
    from mbstudio.core.grains import Grain
    from mbstudio.core.metaball import Avatar
    from mbstudio.core.metrics import ShapeFactors
    from mbstudio.core.project import Project

FACTORS = (
    "volume",
    "area",
    "sphericity",
    "circularity",
    "csf",
    "dn",
    "ds",
    "dns",
    "shortest",
    "intermediate",
    "longest",
)

# Below this, starting processes takes longer than they save.
FEWEST_FOR_PROCESSES = 12

Row = dict[str, Any]


def measure_grains(
    project: Project, labels: list[int], unit: str | None = None, workers: int | None = None
) -> tuple[list[Row], dict[int, str]]:
    """Return one row a grain, and by label why others could not be measured.

    A row holds ``label``, ``unit``, ``grain`` (its factors), and with an avatar also
    ``avatar`` and ``relative_error`` (avatar over grain, minus one). The rows come in the order
    of `labels`, whatever the number of processes.
    """
    from mbstudio.cli.doctor import usable_cores

    processes = usable_cores() if workers is None else workers
    rows: dict[int, Row] = {}
    failures: dict[int, str] = {}
    with console.progress("Measuring") as report:
        in_processes = processes > 1 and len(labels) >= FEWEST_FOR_PROCESSES
        measured = (
            _on_processes(project, labels, unit, processes) if in_processes else _here(project, labels, unit)
        )
        for done, (label, row) in enumerate(measured, start=1):
            if isinstance(row, str):
                failures[label] = row
            else:
                rows[label] = row
            report(done / len(labels), f"{done} of {len(labels)} grains")
    return [rows[label] for label in labels if label in rows], failures


def measure_pair(grain: Grain, avatar: Avatar | None, unit: str | None) -> Row | str:
    """Return the row of one grain, or why it could not be measured."""
    from mbstudio.core.metrics import measure as measure_body

    try:
        factors = measure_body(grain, unit=unit)
        row: Row = {"label": grain.label, "unit": factors.unit, "grain": _plain(factors)}
        if avatar is not None:
            row["avatar"] = _plain(measure_body(avatar, unit=factors.unit))
            row["relative_error"] = {name: row["avatar"][name] / row["grain"][name] - 1 for name in FACTORS}
    except MbstudioError as error:
        return str(error)
    return row


def _plain(measured: ShapeFactors) -> dict[str, float]:
    return {name: float(getattr(measured, name)) for name in FACTORS}


def _task(project: Project, label: int, unit: str | None) -> tuple[Grain, Avatar | None, str | None]:
    assert project.grains is not None
    fit = project.fits.get(label)
    return project.grains.grain(label), fit.avatar if fit is not None else None, unit


def _here(project: Project, labels: list[int], unit: str | None) -> Iterator[tuple[int, Row | str]]:
    for label in labels:
        yield label, measure_pair(*_task(project, label, unit))


def _on_processes(
    project: Project, labels: list[int], unit: str | None, processes: int
) -> Iterator[tuple[int, Row | str]]:
    waiting = iter(labels)
    running: dict[Future[Row | str], int] = {}
    # Fresh processes: a fork would copy the threads' locks of the libraries in use.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        try:
            while True:
                # Grains are cut out of the label volume only when their turn is near.
                for label in islice(waiting, 2 * processes - len(running)):
                    running[pool.submit(measure_pair, *_task(project, label, unit))] = label
                if not running:
                    return
                for done in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(done), done.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
