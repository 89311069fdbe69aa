"""What is learned of parents' surfaces: themselves, how forms and sizes are spread, how they warp."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.cloning.kernel_warp import FLIPS, Coefficients, lattice, weights_at
from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.registration import Registration, SurfaceTarget, flip_coefficients, register
from mbstudio.core.cloning.surface_avatar import SurfaceAvatar
from mbstudio.core.errors import CloningError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.threads import one_thread
from mbstudio.core.units import conversion_factor

if TYPE_CHECKING:
    import trimesh

Progress = Callable[[float, str], None]

FEWEST_PARENTS = 2
_PARTNERS = 8
_KEPT = 0.995
"""Share of the spread of warps that its modes hold."""
_SMOOTHING = 0.35
"""Of the draw of form and size: this much noise, the rest a parent's own, so that mean and spread stay."""


@dataclass(frozen=True, eq=False)
class SurfaceStyle:
    """Parents as surfaces, and what their registrations say of the warps between grains of their kind.

    Attributes
    ----------
    parents : tuple of ParentSurface
        All in one unit.
    modes : float array, shape (modes, 27, 3)
        Independent warps, each as large as its standard deviation among grains of this kind; the strongest
        first. Read-only.
    misfit : float
        Root mean square distance that registrations leave, in D_n: what such warps cannot say.
    avatars : tuple of SurfaceAvatar
        Of the parents in their principal frames, in D_n; empty where none were fitted.
    """

    parents: tuple[ParentSurface, ...]
    modes: Float[np.ndarray, "modes 27 3"]
    misfit: float
    avatars: tuple[SurfaceAvatar, ...] = ()

    def __post_init__(self) -> None:
        if len(self.parents) < FEWEST_PARENTS:
            raise CloningError(
                f"{len(self.parents)} parent is too few: clones need {FEWEST_PARENTS} at least, and look "
                "various from about 20 on."
            )
        if len({parent.unit for parent in self.parents}) > 1:
            raise CloningError("The parents are in several length units: state one for all.")
        if self.avatars and len(self.avatars) != len(self.parents):
            raise CloningError(
                f"{len(self.parents)} parents have {len(self.avatars)} avatars: fit one to each."
            )
        points = len(lattice())
        modes = np.array(self.modes, dtype=np.float64, order="C")
        if modes.ndim != 3 or modes.shape[1:] != (points, 3) or not np.isfinite(modes).all():
            raise CloningError(
                f"Warps of shape {modes.shape} are none: they need ({points}, 3) finite numbers."
            )
        modes.flags.writeable = False
        object.__setattr__(self, "modes", modes)

    @property
    def unit(self) -> str:
        """Length unit of sizes."""
        return self.parents[0].unit

    def scaled(self, factor: float) -> SurfaceStyle:
        """Return this style with all sizes multiplied; forms and warps know none."""
        parents = tuple(replace(parent, diameter=parent.diameter * factor) for parent in self.parents)
        return replace(self, parents=parents)

    @property
    def forms(self) -> Float64[np.ndarray, "parents 3"]:
        """Logarithms of the parents' semi-axes, each over their geometric mean."""
        return np.stack([parent.log_form for parent in self.parents])

    @property
    def warp_strength(self) -> float:
        """Root mean square displacement of warps of strength 1, at the parents' surfaces, in D_n."""
        squares = []
        for parent in self.parents:
            weights = weights_at(parent.vertices[:: max(1, len(parent.vertices) // 200)])
            moved = np.einsum("pm,kmi->kpi", weights, self.modes) * parent.semi_axes
            squares.append(np.square(moved).sum(axis=(0, 2)).mean())
        return float(np.sqrt(np.mean(squares)))

    @property
    def log_diameters(self) -> Float64[np.ndarray, " parents"]:
        """Logarithms of the nominal diameters, in `unit`."""
        return np.log([parent.diameter for parent in self.parents])

    def draw_form_and_size(
        self, rng: np.random.Generator, giver: int | None = None
    ) -> tuple[Float64[np.ndarray, " 3"], float]:
        """Return the form (logarithms of semi-axes) and diameter of one grain, as the parents' are spread.

        Those of the parent in row `giver`, or of any, a little blurred.

        A smoothed bootstrap that keeps mean and covariance of form and size together (Silverman 1986, section
        6.4): the deviation of a parent from the mean, shrunk, and normal noise of the parents' covariance.
        """
        known = np.column_stack([self.forms[:, :2], self.log_diameters])
        mean = known.mean(axis=0)
        drawn = known[rng.integers(len(known)) if giver is None else giver] - mean
        variances, directions = np.linalg.eigh(np.cov(known.T))
        noise = directions @ (np.sqrt(np.maximum(variances, 0.0)) * rng.standard_normal(3))
        drawn = mean + np.sqrt(1 - _SMOOTHING**2) * drawn + _SMOOTHING * noise
        form = np.sort([drawn[0], drawn[1], -drawn[0] - drawn[1]])[::-1]
        return form, float(np.exp(drawn[2]))

    def draw_warp(self, rng: np.random.Generator) -> Float64[np.ndarray, " modes"]:
        """Return the share of each mode in one warp: standard normal."""
        return rng.standard_normal(len(self.modes))

    def warp(self, shares: Float[np.ndarray, " modes"]) -> Coefficients:
        """Return the warp of shares of the modes."""
        coefficients: Coefficients = np.tensordot(shares, self.modes, axes=1)
        return coefficients


@one_thread()
def learn_surfaces(
    bodies: Sequence[Grain | trimesh.Trimesh],
    names: Sequence[str] | None = None,
    *,
    unit: str | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> SurfaceStyle:
    """Return the style of grains or closed meshes.

    Parameters
    ----------
    bodies : sequence of Grain or trimesh.Trimesh
        Two at least.
    names : sequence of str, optional
    unit : str, optional
        Length unit of meshes that carry none.
    seed : int
        Of which parents are laid onto which.
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work.

    Raises
    ------
    CloningError
        If a body cannot be a parent, or there are too few.
    """
    named = list(names) if names is not None else [f"body {place}" for place in range(1, len(bodies) + 1)]
    if len(named) != len(bodies):
        raise CloningError(f"{len(bodies)} bodies have {len(named)} names: give one for each.")
    parents = [
        ParentSurface.from_grain(body, name)
        if isinstance(body, Grain)
        else ParentSurface.from_mesh(body, name, unit)
        for body, name in zip(bodies, named, strict=True)
    ]
    return style_of(parents, seed=seed, progress=progress)


def style_of(
    parents: Sequence[ParentSurface], *, seed: int = 0, progress: Progress | None = None
) -> SurfaceStyle:
    """Return the style of parents: each is registered to some others, which gives the spread of warps.

    Two grains differ by twice the spread of one: half the covariance of their registrations is that of a
    grain about the mean. It is taken as the same for all reflections of a body, and with mean zero.

    Raises
    ------
    CloningError
        If there are fewer than two.
    """
    if len(parents) < FEWEST_PARENTS:
        return SurfaceStyle(tuple(parents), np.empty((0, len(lattice()), 3)), 0.0)  # says what is wrong
    unit = parents[0].unit
    alike = [_in_unit(parent, unit) for parent in parents]
    targets = [SurfaceTarget(parent) for parent in alike]
    found: list[Registration] = []
    for place, parent in enumerate(alike):
        if progress is not None:
            progress(place / len(alike), f"registering {parent.name}")
        rng = np.random.default_rng([seed, place])
        others = np.delete(np.arange(len(alike)), place)
        for other in rng.permutation(others)[:_PARTNERS]:
            found.append(register(parent, targets[other], rng))
    radius = float(np.mean([parent.semi_axes.mean() for parent in alike]))
    misfit = radius * float(np.sqrt(np.mean([entry.after**2 for entry in found])))
    return SurfaceStyle(tuple(alike), _modes([entry.coefficients for entry in found]), misfit)


def _modes(warps: Sequence[Coefficients]) -> Float64[np.ndarray, "modes 27 3"]:
    points = len(lattice())
    every = [flip_coefficients(warp, flip) for warp in warps for flip in range(len(FLIPS))]
    rows = np.stack(every).reshape(len(every), -1)
    variances, directions = np.linalg.eigh(rows.T @ rows / (2 * len(rows)))
    variances, directions = np.maximum(variances[::-1], 0.0), directions[:, ::-1]
    # The sign of an eigenvector is chance: take that which makes its largest entry positive.
    largest = np.abs(directions).argmax(axis=0)
    directions = directions * np.sign(directions[largest, np.arange(directions.shape[1])])
    total = variances.sum()
    count = 0 if total <= 0 else int(np.searchsorted(np.cumsum(variances) / total, _KEPT)) + 1
    modes: np.ndarray = (directions[:, :count] * np.sqrt(variances[:count])).T.reshape(count, points, 3)
    return modes


def _in_unit(parent: ParentSurface, unit: str) -> ParentSurface:
    if parent.unit == unit:
        return parent
    factor = conversion_factor(parent.unit, unit)
    return ParentSurface(
        parent.name, parent.vertices, parent.faces, parent.semi_axes, parent.diameter * factor, unit
    )
