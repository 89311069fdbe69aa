"""Several factors of a shaped grain at once: inverse design, steps among the parents, differences added.

Size and form come first and are exact. Sphericity, convexity and roughness each have a band of the surface of
their own, but follow each other a little: they are reached in turn until all are near (Gauss-Seidel).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from mbstudio.core.cloning.clone_maker import Surface
from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.solid_moments import principal_form, solid_moments
from mbstudio.core.cloning.surface_studio import (
    BANDED_FACTORS,
    SHAPE_FACTORS,
    GrainShape,
    ShapedGrain,
    SurfaceStudio,
    area_of,
    convexity_of,
    with_axis_ratios,
)
from mbstudio.core.errors import CloningError

Progress = Callable[[float, str], None]

TOLERANCE = 0.005
"""Relative error of a factor from which on it counts as missed."""
_ROUNDS = 4
_BEGINNINGS = 3
"""Parents that a design is tried from."""
_CONTRADICTION = 1e-3


@dataclass(frozen=True, eq=False)
class DesignedGrain:
    """A grain that was asked for by its factors.

    Attributes
    ----------
    grain : ShapedGrain
        With all factors measured.
    targets : mapping of str to float
        What was asked for.
    """

    grain: ShapedGrain
    targets: Mapping[str, float]

    @property
    def errors(self) -> Mapping[str, float]:
        """Relative error of each factor that was asked for."""
        return {name: self.grain.values[name] / wanted - 1 for name, wanted in self.targets.items()}

    @property
    def missed(self) -> tuple[str, ...]:
        """Factors that these surfaces could not be given."""
        return tuple(name for name, error in self.errors.items() if not abs(error) <= TOLERANCE)


@dataclass(frozen=True, eq=False)
class ParentFactors:
    """How the factors of shape are spread among the parents of a style.

    Attributes
    ----------
    values : float array, shape (parents, 7)
        In the order of `SHAPE_FACTORS`; size in the unit of the style. NaN where it was not measured.
    """

    values: Float64[np.ndarray, "parents 7"]

    @classmethod
    def measure(cls, studio: SurfaceStudio, progress: Progress | None = None) -> ParentFactors:
        """Measure all parents of a studio."""
        parents = studio.style.parents
        rows = []
        for row, parent in enumerate(parents):
            if progress is not None:
                progress(row / len(parents), parent.name)
            values = studio.make(studio.begin(row)).values
            rows.append([values[name] for name in SHAPE_FACTORS])
        return cls(np.array(rows))

    @classmethod
    def plain(cls, values: Float64[np.ndarray, "parents 6"]) -> ParentFactors:
        """Return what is known without roughness, which takes longest."""
        return cls(np.column_stack([values, np.full(len(values), np.nan)]))

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviation of each factor among the parents."""
        spread = self.values.std(axis=0, ddof=1)
        return dict(zip(SHAPE_FACTORS, map(float, spread), strict=True))

    def nearest(self, targets: Mapping[str, float], count: int) -> list[int]:
        """Return the parents whose factors are nearest to what is asked for, in standard deviations."""
        columns = [SHAPE_FACTORS.index(name) for name in targets]
        spread = np.maximum(self.values[:, columns].std(axis=0, ddof=1), 1e-12)
        away = np.nan_to_num((self.values[:, columns] - np.array(list(targets.values()))) / spread)
        rows: list[int] = np.argsort((away**2).sum(axis=1), kind="stable")[:count].tolist()
        return rows


PLAIN_FACTORS = SHAPE_FACTORS[:-1]
"""Factors that a surface alone tells; roughness needs its bands."""


def plain_factors(surface: Surface) -> Float64[np.ndarray, " 6"]:
    """Return what a closed surface tells of itself, in the order of `PLAIN_FACTORS`."""
    moments = solid_moments(*surface)
    long, middle, short = principal_form(moments)[0]
    diameter = np.cbrt(6.0 * moments.volume / np.pi)
    sphericity = np.pi * diameter**2 / area_of(surface)
    return np.array(
        [diameter, middle / long, short / middle, short / np.sqrt(long * middle), sphericity,
         convexity_of(surface)]
    )  # fmt: skip


def surface_of_parent(parent: ParentSurface) -> Surface:
    """Return a parent's surface in its principal frame and unit."""
    return Surface(parent.body_vertices() * parent.diameter, parent.faces)


def reach_all(studio: SurfaceStudio, shape: GrainShape, targets: Mapping[str, float]) -> DesignedGrain:
    """Return a shape with several factors as asked for, or as near as its surface allows.

    Parameters
    ----------
    studio : SurfaceStudio
    shape : GrainShape
        What one starts from: its parent, blend and warp stay.
    targets : mapping of str to float
        By names of `SHAPE_FACTORS`.

    Raises
    ------
    CloningError
        If there is no such factor, no body has such values, or they contradict each other.
    """
    _check(targets)
    if "size" in targets:
        shape = studio.reach(shape, "size", targets["size"])[0]
    shape = _with_form(studio, shape, targets)
    asked = [name for name in BANDED_FACTORS if name in targets]
    for _ in range(_ROUNDS if len(asked) > 1 else 1):
        for name in asked:
            shape, _held = studio.reach(shape, name, targets[name])
        found = DesignedGrain(studio.make(shape), MappingProxyType(dict(targets)))
        if not found.missed:
            return found
    return DesignedGrain(studio.make(shape), MappingProxyType(dict(targets)))


def design(studio: SurfaceStudio, known: ParentFactors, targets: Mapping[str, float]) -> DesignedGrain:
    """Return a grain of given factors (inverse design), made of one of the parents that are nearest to it.

    Raises
    ------
    CloningError
        If nothing is asked for, no body has such values, or they contradict each other.
    """
    if not targets:
        raise CloningError("A design needs a factor: give for example csf=0.6.")
    _check(targets)
    best: tuple[float, DesignedGrain] | None = None
    for row in known.nearest(targets, _BEGINNINGS):
        found = reach_all(studio, studio.begin(row), targets)
        if not found.missed:
            return found
        error = max(map(abs, found.errors.values()))
        if best is None or error < best[0]:
            best = (error, found)
    assert best is not None  # a style has parents
    return best[1]


def move_by(
    studio: SurfaceStudio, known: ParentFactors, shape: GrainShape, steps: Mapping[str, float]
) -> DesignedGrain:
    """Return a shape whose factors have moved by so many standard deviations of the parents.

    Raises
    ------
    CloningError
        If there is no such factor, or no body has such values.
    """
    _check(dict.fromkeys(steps, 1.0))
    values, deviations = studio.make(shape).values, known.deviations
    return reach_all(
        studio, shape, {name: values[name] + step * deviations[name] for name, step in steps.items()}
    )


def add_difference(
    studio: SurfaceStudio, base: GrainShape, plus: GrainShape, minus: GrainShape, strength: float = 1.0
) -> DesignedGrain:
    """Return a shape whose factors differ from the base's as those of one grain differ from another's.

    Size and roughness change by factors, the others by differences. What no body can have is held at
    what one can: then the grain has not the factors that were asked for, and :attr:`DesignedGrain.missed`
    names them.

    Raises
    ------
    CloningError
        If a factor of one of them cannot be measured.
    """
    here, first, second = (studio.make(one).values for one in (base, plus, minus))
    targets = {}
    for name in ("size", "elongation", "flatness", *BANDED_FACTORS):
        if name in ("size", "roughness"):
            targets[name] = here[name] * (first[name] / second[name]) ** strength
        else:
            targets[name] = here[name] + strength * (first[name] - second[name])
    possible = {
        name: value if name in ("size", "roughness") else float(np.clip(value, _LEAST, 1.0))
        for name, value in targets.items()
    }
    return replace(reach_all(studio, base, possible), targets=MappingProxyType(targets))


_LEAST = 0.15
"""Of ratios of axes, sphericity and convexity that a sum may lead to."""


def _check(targets: Mapping[str, float]) -> None:
    for name, value in targets.items():
        if name not in SHAPE_FACTORS:
            raise CloningError(f"'{name}' is no factor of shape: use one of {', '.join(SHAPE_FACTORS)}.")
        if not (np.isfinite(value) and value > 0):
            raise CloningError(f"No grain has {name} {value:g}: ask for a positive number.")
        if name not in ("size", "roughness") and value > 1:
            raise CloningError(f"No grain has {name} {value:g}: it is 1 at most.")


def _with_form(studio: SurfaceStudio, shape: GrainShape, targets: Mapping[str, float]) -> GrainShape:
    """Return a shape with the ratios of axes that are asked for, by two of them at most."""
    elongation, flatness = shape.axis_ratios
    asked = {name: targets[name] for name in ("elongation", "flatness", "csf") if name in targets}
    if asked.keys() == {"csf"}:
        return studio.reach(shape, "csf", asked["csf"])[0]
    elongation, flatness = asked.get("elongation", elongation), asked.get("flatness", flatness)
    csf = asked.get("csf", np.sqrt(elongation) * flatness)
    if "flatness" not in asked:
        flatness = float(csf / np.sqrt(elongation))
    elif "elongation" not in asked:
        elongation = float((csf / flatness) ** 2)
    elif abs(np.sqrt(elongation) * flatness / csf - 1) > _CONTRADICTION:
        raise CloningError(
            f"Elongation {elongation:g} and flatness {flatness:g} make a Corey factor of "
            f"{np.sqrt(elongation) * flatness:.4g}, not {csf:g}: leave one of them out."
        )
    return with_axis_ratios(shape, elongation, flatness)
