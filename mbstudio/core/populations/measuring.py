"""Measuring populations: many grains, avatars or meshes, on several processes."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.batch.body_messages import body_from, body_message
from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.errors import GrainError, MbstudioError, MeasureError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.metrics.bodies import UNITLESS, VoxelSurface
from mbstudio.core.metrics.detail import measure_detail
from mbstudio.core.metrics.factor_table import AXES, FACTORS
from mbstudio.core.metrics.measuring import AxisConvention, measure
from mbstudio.core.populations.population import Kind, Population
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
    keys : sequence of hashable
        What tells each body from all others, to find it again among those that are known; empty: never.
    """

    name: str
    kind: Kind
    labels: Sequence[int]
    makers: Sequence[Callable[[], Body]]
    keys: Sequence[Hashable] = ()


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
        chosen = _own_labels(given) if labels is None else [int(label) for label in labels]
        if len(chosen) != len(given):
            raise MeasureError(f"{len(given)} bodies have {len(chosen)} labels: give one for each.")
        makers = [given_body(body) for body in given]
        first = unit or _common_unit(given)
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
    known: Known | None = None,
) -> list[Population]:
    """Measure several populations alike, in one batch that keeps all processes busy.

    Parameters
    ----------
    groups : sequence of Bodies
    unit, axes, surface, detail, workers, progress
        As for `measure_population`; without a unit each body is measured in its own.
    known : mutable mapping, optional
        Measurements by key and conventions. What is there is not measured again; what is measured comes in
        at once, so that it is there also after the rest was given up.

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
    found = _measure_all(groups, asked, workers, progress, known)
    ends = np.cumsum([len(group.makers) for group in groups]).tolist()
    return [
        _population(group.name, group.kind, group.labels, found[end - len(group.makers) : end], asked)
        for group, end in zip(groups, ends, strict=True)
    ]


def measured_so_far(
    groups: Sequence[Bodies],
    known: Known,
    *,
    unit: str | None = None,
    axes: AxisConvention = "obb",
    surface: VoxelSurface | None = None,
    detail: bool = False,
) -> list[Population]:
    """Return of each population what was measured by now; what is still to come has no row.

    Parameters
    ----------
    groups : sequence of Bodies
        With keys.
    known : mapping
        What `measure_together` fills; another thread may do so meanwhile.
    unit, axes, surface, detail
        As it was given them.

    Returns
    -------
    list of Population
        In the order of the groups, without those of which nothing was measured yet.

    Raises
    ------
    MeasureError, UnitError
        As `measure_population`.
    """
    asked = _conventions(unit, axes, surface, detail)
    found: list[Population] = []
    for group in groups:
        given = (
            (label, known.get((key, asked))) for label, key in zip(group.labels, group.keys, strict=True)
        )
        rows = [(label, measurement) for label, measurement in given if measurement is not None]
        if rows:
            labels, measurements = zip(*rows, strict=True)
            found.append(_population(group.name, group.kind, labels, measurements, asked))
    return found


def grain_makers(grains: GrainSet, labels: Sequence[int]) -> list[Callable[[], Body]]:
    """Return what cuts each grain out of the label volume, or hands over its mesh, when its turn comes."""
    known = {int(label) for label in grains.table["label"]}
    for label in labels:
        if label not in known:
            raise GrainError(f"There is no grain {label}: the labels run from 1 to {max(known, default=0)}.")
    return [lambda label=label: grains.body(label) for label in labels]  # type: ignore[misc]


def given_body(body: Body) -> Callable[[], Body]:
    """Return what hands over a body that is there already."""
    return lambda: body


def _own_labels(bodies: Sequence[Body]) -> list[int]:
    own = [getattr(body, "label", None) for body in bodies]
    return [place if label is None else int(label) for place, label in enumerate(own)]


def _common_unit(bodies: Sequence[Body]) -> str | None:
    units = [getattr(body, "unit", None) or getattr(body, "units", None) for body in bodies]
    if any(units) and not all(units):
        raise MeasureError(
            f"Body {units.index(None)} has no unit although others do: state the unit of its coordinates."
        )
    return units[0] if units else None


def _conventions(unit: str | None, axes: str, surface: str | None, detail: bool) -> Conventions:
    if axes not in AXES:
        raise MeasureError(f"axes='{axes}' is not known: use 'obb', 'feret' or 'inertia'.")
    if surface not in (None, "crofton", "smoothed"):
        raise MeasureError(f"surface='{surface}' is not known: use 'crofton' or 'smoothed'.")
    return Conventions(None if unit is None else parse_unit(unit), axes, surface, detail)


def unknown_bodies(groups: Sequence[Bodies], asked: Conventions, known: Known) -> int:
    """Return how many bodies are still to be measured."""
    return sum((key, asked) not in known for group in groups for key in _keys(group))


def _keys(group: Bodies) -> list[Hashable]:
    """Return a key for each body; one that nothing else has, where it has none."""
    return list(group.keys) or [object() for _ in group.makers]


def _measure_all(
    groups: Sequence[Bodies],
    asked: Conventions,
    workers: int | None,
    progress: Progress | None,
    known: Known | None,
) -> list[Measurement]:
    """Return the measurements in the order of the bodies, whatever the number of processes."""
    makers = [make for group in groups for make in group.makers]
    keys = [(key, asked) for group in groups for key in _keys(group)]
    count = len(makers)
    if not count:
        raise MeasureError("There are no bodies to measure.")
    found = {} if known is None else known
    rest = [place for place, key in enumerate(keys) if key not in found]
    if workers is None:
        workers = usable_cores() if len(rest) >= FEWEST_FOR_PROCESSES else 0
    if workers < 0:
        raise MeasureError(
            f"The number of processes must be 1 or more, or 0 for the calling thread, not {workers}."
        )
    done = count - len(rest)
    for place, measurement in _measured([makers[place] for place in rest], asked, workers):
        found[keys[rest[place]]] = measurement
        done += 1
        if progress is not None:
            progress(done / count, f"{done} of {count} bodies")
    return [found[key] for key in keys]


def _measured(
    makers: Sequence[Callable[[], Body]], asked: Conventions, workers: int
) -> Iterator[tuple[int, Measurement]]:
    """Yield the place of each body with its measurement, as they come."""
    if makers:
        with closing(WorkerPool(_Measurements(asked), workers).as_completed(makers)) as done:
            yield from done


def _population(
    name: str, kind: Kind, labels: Sequence[int], found: Sequence[Measurement], asked: Conventions
) -> Population:
    names = (*FACTORS.core, *FACTORS.detail, *FACTORS.bands) if asked.detail else FACTORS.core
    return Population(
        name=name,
        kind=kind,
        labels=np.array(labels, dtype=np.int64),
        # Processes know only the factors that mbstudio has by itself: others are derived here.
        factors={f: np.array([float(FACTORS.value(f, item.factors)) for item in found]) for f in names},
        unit=asked.unit or UNITLESS,
        axes=asked.axes,
        surface=", ".join(sorted({item.surface for item in found if item.surface})),
        reasons=tuple(item.reason for item in found),
        warnings=tuple(item.warning for item in found),
    )


_STATED = ("unit", "surface", "axes", "warning")


@dataclass(frozen=True)
class Conventions:
    """How every body of a population is measured: the arguments of `measure`, and whether in detail."""

    unit: str | None = None
    axes: str = "obb"
    surface: str | None = None
    detail: bool = False


@dataclass(frozen=True)
class Measurement:
    """One body measured, or why not.

    Attributes
    ----------
    factors : mapping of str to float
        Empty where the body could not be measured; NaN for a factor that is not defined.
    unit, surface, warning, reason : str
        As in `Population`; empty where they do not apply.
    """

    factors: Mapping[str, float]
    unit: str = ""
    surface: str = ""
    warning: str = ""
    reason: str = ""


Known = MutableMapping[tuple[Hashable, Conventions], Measurement]
"""Measurements by what tells a body from all others, and how it was measured."""


def measure_or_explain(body: Grain | Avatar | trimesh.Trimesh, asked: Conventions) -> Measurement:
    """Measure one body, or say what went wrong: one bad body must not end a batch."""
    try:
        core = measure(body, unit=asked.unit, axes=asked.axes, surface=asked.surface)  # type: ignore[arg-type]
        found: dict[str, Any] = core.as_dict()
        warnings = [core.warning]
        if asked.detail:
            detail = measure_detail(body, unit=asked.unit)
            found = {**detail.as_dict(), **found}
            warnings.append(detail.warning)
    except MbstudioError as error:
        return Measurement({}, reason=str(error))
    except (ArithmeticError, ValueError, IndexError, MemoryError, RuntimeError) as error:
        return Measurement({}, reason=f"It could not be measured: {type(error).__name__}: {error}.")
    numbers = {
        name: float("nan") if value is None else float(value)
        for name, value in found.items()
        if name not in _STATED
    }
    return Measurement(numbers, core.unit, core.surface, " ".join(dict.fromkeys(filter(None, warnings))))


class _Measurements(Job[Callable[[], "Body"], Measurement]):
    """In goes what makes a body, out comes its measurement, or why there is none."""

    def __init__(self, asked: Conventions) -> None:
        self._asked = asked

    def pack(self, make: Callable[[], Body]) -> Message:
        head, arrays = body_message(make())
        return {"body": head, "asked": asdict(self._asked)}, arrays

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        found = measure_or_explain(body_from(head["body"], arrays), Conventions(**head["asked"]))
        return asdict(found), {}

    def unpack(self, make: Callable[[], Body], head: Head, arrays: Arrays) -> Measurement:
        return Measurement(**head)

    def work_here(self, make: Callable[[], Body]) -> Measurement:
        return measure_or_explain(make(), self._asked)

    def fail(self, make: Callable[[], Body], error: MbstudioError) -> Measurement:
        return Measurement({}, reason=str(error))

    def lose(self, make: Callable[[], Body], code: int) -> Measurement:
        return Measurement({}, reason=f"The process that measured it ended with code {code}.")
