"""Measuring populations: many grains, avatars or meshes, on several processes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.batch.processes import Child, Crew, usable_cores
from mbstudio.core.errors import GrainError, MbstudioError, MeasureError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.metrics.bodies import UNITLESS, VoxelSurface
from mbstudio.core.metrics.measuring import AxisConvention
from mbstudio.core.metrics.shape_factors import BANDS, CORE_FACTORS, DETAILED_FACTORS
from mbstudio.core.populations.population import Kind, Population
from mbstudio.core.populations.worker import (
    Conventions,
    Measurement,
    ask,
    measured,
    receive_measurement,
)
from mbstudio.core.units import parse_unit

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.grains.grain import Grain
    from mbstudio.core.metaball.avatar import Avatar

    Body = Grain | Avatar | trimesh.Trimesh

Progress = Callable[[float, str], None]

# Below this, starting processes takes longer than they save.
FEWEST_FOR_PROCESSES = 12


@dataclass(frozen=True, eq=False)
class Bodies:
    """A population before it is measured.

    Attributes
    ----------
    name : str
    kind : {'grains', 'avatars', 'clones'}
    labels : sequence of int
    makers : sequence of callable
        Each returns its body when its turn comes: a grain is cut out of the label volume only then.
    """

    name: str
    kind: Kind
    labels: Sequence[int]
    makers: Sequence[Callable[[], Body]]


def measure_population(
    bodies: GrainSet | Sequence[Body],
    labels: Sequence[int] | None = None,
    *,
    name: str | None = None,
    kind: Kind = "grains",
    unit: str | None = None,
    axes: AxisConvention = "obb",
    surface: VoxelSurface | None = None,
    detail: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Population:
    """Measure many bodies alike.

    Parameters
    ----------
    bodies : GrainSet, or sequence of Grain, Avatar or trimesh.Trimesh
    labels : sequence of int, optional
        Of a GrainSet: which grains, all by default. Else the label of each body; its own, or its place in
        the sequence, by default.
    name : str, optional
        The kind by default.
    kind : {'grains', 'avatars', 'clones'}
    unit : str, optional
        Of all factors; that of the first body by default.
    axes, surface
        As for `measure`.
    detail : bool
        Also find the detailed factors: convexity, spheres, Feret diameters, roundness, roughness, bands.
    workers : int, optional
        Processes; one a core by default. 0 measures in the calling thread, as do fewer than twelve bodies
        unless a number is given. The numbers do not depend on it, but for
        rounding in the last digit of some detailed factors.
    progress : callable, optional
        ``progress(share, message)`` after each body; what it raises ends the work at once.

    Returns
    -------
    Population
        One row a body, in the order given. A body that cannot be measured has a row that says why.

    Raises
    ------
    GrainError
        If a label is not among the grains.
    MeasureError
        If a convention or the number of processes is not known, there are no bodies, or only some meshes
        carry a unit and none is given.
    UnitError
        If `unit` is not a length unit.
    """
    if isinstance(bodies, GrainSet):
        chosen = [int(label) for label in (bodies.table["label"] if labels is None else labels)]
        makers = grain_makers(bodies, chosen)
        first: str | None = bodies.unit
    else:
        given = list(bodies)
        chosen = _labels_of(given) if labels is None else [int(label) for label in labels]
        if len(chosen) != len(given):
            raise MeasureError(f"{len(given)} bodies have {len(chosen)} labels: give one to each.")
        makers = [given_body(body) for body in given]
        first = unit or _unit_of(given)
    (population,) = measure_together(
        [Bodies(name or kind, kind, chosen, makers)], unit=unit or first, axes=axes, surface=surface,
        detail=detail, workers=workers, progress=progress,
    )  # fmt: skip
    return population


def measure_together(
    groups: Sequence[Bodies],
    *,
    unit: str | None = None,
    axes: AxisConvention = "obb",
    surface: VoxelSurface | None = None,
    detail: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Population]:
    """Measure several populations alike, in one batch that keeps all processes busy.

    Parameters
    ----------
    groups : sequence of Bodies
    unit, axes, surface, detail, workers, progress
        As for `measure_population`; without a unit each body is measured in its own.

    Returns
    -------
    list of Population
        In the order of the groups.

    Raises
    ------
    MeasureError, UnitError
        As `measure_population`.
    """
    asked = _conventions(unit, axes, surface, detail)
    found = _measure_all([make for group in groups for make in group.makers], asked, workers, progress)
    ends = np.cumsum([len(group.makers) for group in groups]).tolist()
    return [
        _population(group.name, group.kind, group.labels, found[end - len(group.makers) : end], asked)
        for group, end in zip(groups, ends, strict=True)
    ]


def grain_makers(grains: GrainSet, labels: Sequence[int]) -> list[Callable[[], Body]]:
    """Return what cuts each grain out of the label volume, when its turn comes."""
    known = {int(label) for label in grains.table["label"]}
    for label in labels:
        if label not in known:
            raise GrainError(f"There is no grain {label}: the labels run from 1 to {max(known, default=0)}.")
    return [lambda label=label: grains.grain(label) for label in labels]  # type: ignore[misc]


def given_body(body: Body) -> Callable[[], Body]:
    """Return what hands over a body that is there already."""
    return lambda: body


def _labels_of(bodies: Sequence[Body]) -> list[int]:
    own = [getattr(body, "label", None) for body in bodies]
    return [place if label is None else int(label) for place, label in enumerate(own)]


def _unit_of(bodies: Sequence[Body]) -> str | None:
    units = [getattr(body, "unit", None) or getattr(body, "units", None) for body in bodies]
    if any(units) and not all(units):
        raise MeasureError(
            f"Body {units.index(None)} carries no unit and others do: state the unit that its numbers are in."
        )
    return units[0] if units else None


def _conventions(unit: str | None, axes: str, surface: str | None, detail: bool) -> Conventions:
    if axes not in ("obb", "feret", "inertia"):
        raise MeasureError(f"axes='{axes}' is not known: use 'obb', 'feret' or 'inertia'.")
    if surface not in (None, "crofton", "smoothed"):
        raise MeasureError(f"surface='{surface}' is not known: use 'crofton' or 'smoothed'.")
    return Conventions(None if unit is None else parse_unit(unit), axes, surface, detail)


def _measure_all(
    makers: Sequence[Callable[[], Body]],
    asked: Conventions,
    workers: int | None,
    progress: Progress | None,
) -> list[Measurement]:
    """Return the measurements in the order of the bodies, whatever the number of processes."""
    count = len(makers)
    if not count:
        raise MeasureError("There are no bodies to measure.")
    if workers is None:
        workers = usable_cores() if count >= FEWEST_FOR_PROCESSES else 0
    if workers < 0:
        raise MeasureError(
            f"{workers} processes cannot measure: give 1 or more, or 0 for the calling thread."
        )
    items = _on_processes(makers, asked, min(workers, count)) if workers else _here(makers, asked)
    found: dict[int, Measurement] = {}
    try:
        for place, measurement in items:
            found[place] = measurement
            if progress is not None:
                progress(len(found) / count, f"{len(found)} of {count} bodies")
    finally:
        items.close()
    return [found[place] for place in range(count)]


def _here(
    makers: Sequence[Callable[[], Body]], asked: Conventions
) -> Generator[tuple[int, Measurement], None, None]:
    for place, make in enumerate(makers):
        try:
            body = make()
        except MbstudioError as error:
            yield place, Measurement({}, reason=str(error))
            continue
        yield place, measured(body, asked)


def _on_processes(
    makers: Sequence[Callable[[], Body]], asked: Conventions, size: int
) -> Generator[tuple[int, Measurement], None, None]:
    waiting, lock = iter(range(len(makers))), threading.Lock()

    def next_place() -> int | None:
        with lock:
            return next(waiting, None)

    def work(child: Child, place: int) -> tuple[int, Measurement]:
        try:
            body = makers[place]()
        except MbstudioError as error:
            return place, Measurement({}, reason=str(error))
        ask(child.requests, body, asked)
        return place, receive_measurement(child.answers)

    def lost(place: int, code: int) -> tuple[int, Measurement]:
        return place, Measurement({}, reason=f"The process that measured it ended with code {code}.")

    crew = Crew(lambda: Child("mbstudio.core.populations.worker"), next_place, work, lost, size)
    return crew.items(len(makers))


def _population(
    name: str, kind: Kind, labels: Sequence[int], found: Sequence[Measurement], asked: Conventions
) -> Population:
    names = list(CORE_FACTORS)
    if asked.detail:
        names += [*DETAILED_FACTORS, *(f"band_{band}" for band in range(1, BANDS + 1))]
    return Population(
        name=name,
        kind=kind,
        labels=np.array(labels, dtype=np.int64),
        factors={f: np.array([item.factors.get(f, np.nan) for item in found]) for f in names},
        unit=asked.unit or UNITLESS,
        axes=asked.axes,
        surface=", ".join(sorted({item.surface for item in found if item.surface})),
        reasons=tuple(item.reason for item in found),
        warnings=tuple(item.warning for item in found),
    )
