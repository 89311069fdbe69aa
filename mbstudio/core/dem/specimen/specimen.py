"""A specimen: particles above a floor, the avatars as they are or scaled to a wanted size distribution.

The size of a particle is its intermediate axis, as in :mod:`mbstudio.core.populations.sieving`; the curve is
by mass. Sizes are drawn from the distribution by number that gives the curve by mass, one from each of as
many equal strata as there are particles, so that the specimen's own curve leaves the target by no more than
about its largest particle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.particles import Specimen
from mbstudio.core.dem.specimen.placing import random_quaternions, scattered
from mbstudio.core.errors import ExportError
from mbstudio.core.metrics.measuring import measure
from mbstudio.core.metrics.surfaces import avatar_surface
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.core.units import conversion_factor, parse_unit

_FILLING, _SETTLED = 0.2, 0.57
"""Shares of the box that bounding spheres fill where they begin, and grains at rest."""
_SLACK = 1.01
"""Bounding spheres are a little larger, for clumps stand out of the avatar here and there."""


@dataclass(frozen=True, eq=False)
class SpecimenPlan:
    """What a specimen is to be like.

    Attributes
    ----------
    count : int
        Number of particles.
    curve : SizeDistribution or None
        Percent finer by mass, from 0 to 100, linear in the logarithm of the size: the avatars are scaled to
        it. None: each keeps its own size.
    seed : int
    shares : mapping of str to float
        How often each avatar is taken, by number, by the name of its file; empty: all alike.
    width : float or None
        Of the box; None: such that the grains come to rest about as high as the box is wide.
    width_unit : str
        By default the curve's, without a curve that of the files.
    periodic : bool
        Whether what leaves at one side of the box enters at the other: no side wall is felt. For LAMMPS;
        the deck of LIGGGHTS has walls, and refuses it.
    """

    count: int
    curve: SizeDistribution | None = None
    seed: int = 0
    shares: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    width: float | None = None
    width_unit: str = ""
    periodic: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "width_unit", parse_unit(self.width_unit) if self.width_unit else "")
        if self.count < 1:
            raise ExportError(f"A specimen needs at least 1 particle, not {self.count}.")
        if self.width is not None and not (np.isfinite(self.width) and self.width > 0):
            raise ExportError(f"The width of the box must be positive, not {self.width}.")


def target_curve(
    sizes: Sequence[float], finer: Sequence[float], unit: str, *, sieves: str = ""
) -> SizeDistribution:
    """Return a wanted size distribution.

    Parameters
    ----------
    sizes : sequence of float
        Rising and positive.
    finer : sequence of float
        Percent of the mass finer than each size, from 0 to 100, never falling.
    unit : str
    sieves : str, optional
        Name of the series, for tables.

    Raises
    ------
    ExportError
        If the points make no such curve.
    UnitError
        If the unit is unknown.
    """
    x, y = np.asarray(sizes, dtype=float), np.asarray(finer, dtype=float)
    if x.ndim != 1 or x.shape != y.shape or len(x) < 2 or not np.isfinite([x, y]).all():
        raise ExportError("A size distribution needs at least two sizes, each with its percentage finer.")
    if x[0] <= 0 or (np.diff(x) <= 0).any() or (np.diff(y) < 0).any():
        raise ExportError(
            "The sizes of a distribution must be positive and rise; the percentages must not fall."
        )
    if y[0] != 0 or y[-1] != 100:
        raise ExportError(
            f"The distribution goes from {y[0]:g} to {y[-1]:g} % finer: begin with the size that "
            "nothing passes (0) and end with the one that everything passes (100)."
        )
    return SizeDistribution(x, y, parse_unit(unit), sieves)


@dataclass(frozen=True, eq=False)
class SpecimenKinds:
    """What a specimen needs to know of the avatars that it is made of.

    Attributes
    ----------
    names : tuple of str
    sizes : float array, shape (kinds,)
        Intermediate axes, in unit.
    volumes : float array, shape (kinds,)
        In unit**3.
    reaches : float array, shape (kinds,)
        Radii of the bounding spheres about the centre of mass, in unit.
    unit : str
    """

    names: tuple[str, ...]
    sizes: Float[np.ndarray, " kinds"]
    volumes: Float[np.ndarray, " kinds"]
    reaches: Float[np.ndarray, " kinds"]
    unit: str

    @classmethod
    def from_bodies(cls, bodies: Sequence[DemBody], unit: str) -> SpecimenKinds:
        """Measure avatars, which are in `unit`."""
        return cls(
            tuple(body.name for body in bodies),
            np.array([measure(body.avatar).intermediate for body in bodies]),
            np.array([body.mass.volume for body in bodies]),
            np.array([_reach(body) for body in bodies]),
            unit,
        )

    @classmethod
    def from_factors(
        cls,
        names: Sequence[str],
        axes: Float[np.ndarray, "kinds 3"],
        volumes: Float[np.ndarray, " kinds"],
        unit: str,
    ) -> SpecimenKinds:
        """Take avatars that were measured before; half the diagonal of its box is about a body's reach.

        Parameters
        ----------
        names : sequence of str
        axes : float array, shape (kinds, 3)
            Longest, intermediate and shortest axis of the smallest box, in `unit`.
        volumes : float array, shape (kinds,)
        unit : str
        """
        return cls(
            tuple(names), axes[:, 1].copy(), volumes, np.linalg.norm(axes, axis=1) / 2, parse_unit(unit)
        )

    def curve(self, tolerance: float = 0.25) -> SizeDistribution:
        """Return the curve of the avatars as they are, each taken once, with as few points as it needs.

        Parameters
        ----------
        tolerance : float
            Percent of the mass by which it may leave the avatars' own curve.
        """
        order = np.argsort(self.sizes, kind="stable")
        sizes, mass = self.sizes[order], np.cumsum(self.volumes[order])
        last = np.append(np.diff(sizes) > 0, True)  # of bodies of one size
        sizes, finer = sizes[last], 100.0 * mass[last] / mass[-1]
        # Nothing is finer than a little less than the smallest; one size alone is a steep curve.
        sizes, finer = np.append(sizes[0] * 0.98, sizes), np.append(0.0, finer)
        kept = _needed_points(np.log(sizes), finer, tolerance)
        return SizeDistribution(sizes[kept], finer[kept], self.unit)


def _needed_points(
    x: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"], tolerance: float
) -> Int[np.ndarray, " kept"]:
    """Return the points that a polyline needs to pass all within `tolerance` of y (Ramer, Peucker)."""
    kept, waiting = {0, len(x) - 1}, [(0, len(x) - 1)]
    while waiting:
        first, last = waiting.pop()
        inner = np.arange(first + 1, last)
        if not len(inner):
            continue
        between = y[first] + (y[last] - y[first]) * (x[inner] - x[first]) / (x[last] - x[first])
        away = np.abs(y[inner] - between)
        worst = int(inner[np.argmax(away)])
        if away.max() > tolerance:
            kept.add(worst)
            waiting += [(first, worst), (worst, last)]
    return np.array(sorted(kept))


def make_specimen(bodies: Sequence[DemBody], plan: SpecimenPlan, unit: str) -> Specimen:
    """Choose, scale, turn and place the particles of a specimen.

    Parameters
    ----------
    bodies : sequence of DemBody
        The avatars, in `unit`.
    plan : SpecimenPlan
    unit : str

    Raises
    ------
    ExportError
        If a share names no avatar or is negative, or a grain is wider than the box.
    """
    return specimen_of(SpecimenKinds.from_bodies(bodies, unit), plan)


def specimen_of(kinds: SpecimenKinds, plan: SpecimenPlan) -> Specimen:
    """Return the specimen of avatars that are measured already; see :func:`make_specimen`."""
    rng = np.random.default_rng(plan.seed)
    shares = _shares_of(kinds.names, plan.shares)
    width_unit = plan.width_unit or (kinds.unit if plan.curve is None else plan.curve.unit)
    if plan.curve is None:
        chosen = _spread_kinds(shares, plan.count, rng)
        sizes, scales = kinds.sizes[chosen], np.ones(plan.count)
    else:
        sizes = draw_sizes(plan.curve, plan.count, rng) * conversion_factor(plan.curve.unit, kinds.unit)
        chosen = _spread_kinds(shares, plan.count, rng)
        scales = sizes / kinds.sizes[chosen]
    radii = kinds.reaches[chosen] * scales * _SLACK
    solid = float((kinds.volumes[chosen] * scales**3).sum())
    half = _half_width(radii, solid, plan.width, conversion_factor(width_unit, kinds.unit))
    positions, top = scattered(radii, half, 0.05 * float(radii.max()), _FILLING, rng)
    return Specimen(
        kinds.names,
        chosen,
        scales,
        sizes,
        positions,
        random_quaternions(plan.count, rng),
        half,
        top,
        kinds.volumes,
        kinds.reaches,
        kinds.unit,
        plan.periodic,
    )


def draw_sizes(curve: SizeDistribution, count: int, rng: np.random.Generator) -> Float[np.ndarray, " count"]:
    """Return sizes, rising, whose masses follow a curve: one from each of `count` strata of equal number.

    Between two points of the curve the mass finer is linear in ln d, so the number finer is proportional
    to ``d_low**-3 - d**-3``.

    Parameters
    ----------
    curve : SizeDistribution
        From 0 to 100 % finer.
    count : int
    rng : numpy Generator
    """
    low, high = curve.sizes[:-1], curve.sizes[1:]
    slopes = np.diff(curve.finer) / np.log(high / low)
    numbers = slopes * (low**-3 - high**-3)
    ends = np.concatenate([[0.0], np.cumsum(numbers)])
    wanted = (np.arange(count) + rng.random(count)) / count * ends[-1]
    segment = np.clip(np.searchsorted(ends, wanted, side="right") - 1, 0, len(numbers) - 1)
    share = (wanted - ends[segment]) / numbers[segment]
    sizes: np.ndarray = (low[segment] ** -3 - share * (low[segment] ** -3 - high[segment] ** -3)) ** (-1 / 3)
    return sizes


def in_classes(specimen: Specimen, classes: int) -> Specimen:
    """Return the specimen with the sizes of each kind rounded to a few, the mass of each group kept.

    For engines that insert copies of templates: each kind's particles are split by size into groups of equal
    number, and every particle of a group gets the root mean cube of their sizes.

    Parameters
    ----------
    specimen : Specimen
    classes : int
        Sizes of each kind, at most.
    """
    scales = specimen.scales.copy()
    for kind in range(len(specimen.names)):
        mine = np.flatnonzero(specimen.kinds == kind)
        mine = mine[np.argsort(specimen.scales[mine], kind="stable")]
        for group in np.array_split(mine, min(classes, max(len(mine), 1))):
            if len(group):
                scales[group] = np.mean(specimen.scales[group] ** 3) ** (1 / 3)
    sizes = specimen.sizes * scales / specimen.scales
    return replace(specimen, scales=scales, sizes=sizes)


def _reach(body: DemBody) -> float:
    vertices, _ = avatar_surface(body.avatar).coarse if body.surface is None else body.surface
    return float(np.linalg.norm(vertices, axis=1).max())


def _shares_of(names: Sequence[str], shares: Mapping[str, float]) -> Float[np.ndarray, " kinds"]:
    unknown = sorted(set(shares) - set(names))
    if unknown:
        raise ExportError(f"There is no avatar '{unknown[0]}' for a share: use one of {', '.join(names)}.")
    values = np.array([shares.get(name, 0.0) if shares else 1.0 for name in names], dtype=float)
    if not np.isfinite(values).all() or values.min() < 0 or values.sum() <= 0:
        raise ExportError("The shares of the avatars must be positive numbers, or zero, but not all.")
    normalised: np.ndarray = values / values.sum()
    return normalised


def _spread_kinds(
    shares: Float[np.ndarray, " kinds"], count: int, rng: np.random.Generator
) -> Int[np.ndarray, " count"]:
    """Return kinds in their shares (largest remainders), evenly spread along the row of rising sizes."""
    exact = shares * count
    numbers = np.floor(exact).astype(int)
    rest = np.argsort(numbers - exact, kind="stable")[: count - int(numbers.sum())]
    numbers[rest] += 1
    places = [(np.arange(number) + rng.random(number)) / max(number, 1) for number in numbers]
    kinds = np.repeat(np.arange(len(shares)), numbers)
    return kinds[np.argsort(np.concatenate(places), kind="stable")]


def _half_width(
    radii: Float[np.ndarray, " count"], solid: float, width: float | None, factor: float
) -> float:
    largest = float(radii.max())
    if width is None:
        settled: float = 0.5 * (solid / _SETTLED) ** (1 / 3)
        return max(settled, 2.5 * largest)
    half = width * factor / 2
    if half <= largest:
        raise ExportError(
            f"The box of width {width:g} has no room for the largest particle: make it at least "
            f"{2.1 * largest / factor:.3g} wide."
        )
    return half
