"""The paper's method: Algorithm 1 to the letter, then the gradient search of Algorithm 2.

What the paper leaves open is an option of :class:`PaperOptions`, with its reason. The optimisers
are written out here, a few lines each, with the arithmetic of ``torch.optim.Adam`` and
``torch.optim.SGD``: the gradient is analytic, so torch would add only its seconds of import and
its threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float64
from numba import njit

from mbstudio.core.errors import FitError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.control_points import control_of_spheres, with_number
from mbstudio.core.imaging.loss import mean_loss, point_loss_slope
from mbstudio.core.imaging.preprocess import Cavities, PreparedGrain, prepare
from mbstudio.core.imaging.run import StepRun, clustered
from mbstudio.core.imaging.sphere_clustering import Sphere, cluster_overlapping, cluster_to_the_letter
from mbstudio.core.imaging.steps import SearchStep
from mbstudio.core.metaball.field import SAFE_MATH, field_and_gradient_at, field_at


@dataclass(frozen=True)
class PaperOptions:
    """Options of ``method='paper'``: every choice that the paper leaves open.

    Attributes
    ----------
    generations : int
        E_gs. The paper gives no number.
    learning_rate : float
        eta; 0.001 in the paper. Lengths are in units of the RMS radius of the hull.
    adam_share : float
        Part of the generations done by Adam; the rest by SGD. The paper combines both without a
        schedule: Adam travels fast, SGD ends its jitter (the loss has a kink at f = 1).
    beta1, beta2, epsilon : float
        Of Adam (Kingma and Ba's values).
    momentum : float
        Of SGD; 0 is plain gradient descent, as printed.
    weight : {'square', 'radius'}
        Start from k = r**2 (one sphere is then its own metaball), or from k = r as printed.
    common_factor : bool
        Whether all k are first divided by one factor so that ln f is 0 on average over the hull.
    parameter : {'k', 'ln k'}
        What the optimisers move besides the places: ln k, which cannot leave the positive numbers,
        or k as printed (kept above `least_k`). With k, plain SGD at the paper's learning rate
        jumps about the kink of the loss: measured, it ends at 3 to 10 times the loss that Adam
        had reached.
    least_k : float
        Floor of k for parameter='k', in working lengths squared.
    reduction : {'mean', 'sum'}
        Whether the gradient is that of the mean over the hull points, or of the sum as printed
        (then SGD's step grows with the number of points). The loss reported is always the mean.
    working_side, hull_points : int
        As in the fast method; the paper works on all voxels and points.
    cavities : {'fill', 'keep'}
        Fill cavities that the grain encloses, with a warning in the verdict, or let the avatar have
        them: a void of its own for each, as far as n allows, which is then no fault.
    clustering : {'letter', 'incremental'}
        A distance transform for each sphere, or one lowered locally.
    """

    generations: int = 1500
    cavities: Cavities = "fill"
    learning_rate: float = 0.001
    adam_share: float = 0.8
    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-8
    momentum: float = 0.0
    weight: Literal["square", "radius"] = "square"
    common_factor: bool = True
    parameter: Literal["k", "ln k"] = "ln k"
    least_k: float = 1e-8
    reduction: Literal["mean", "sum"] = "mean"
    working_side: int = 200
    hull_points: int = 24_000
    clustering: Literal["letter", "incremental"] = "letter"

    def __post_init__(self) -> None:
        allowed = {
            "weight": ("square", "radius"), "parameter": ("k", "ln k"), "reduction": ("mean", "sum"),
            "clustering": ("letter", "incremental"),
        }  # fmt: skip
        for name, values in allowed.items():
            if getattr(self, name) not in values:
                raise FitError(
                    f"{name} = {getattr(self, name)!r} is no choice of method 'paper': use one of {values}."
                )
        if self.generations < 1 or self.learning_rate <= 0 or not 0 <= self.adam_share <= 1:
            raise FitError(
                "Method 'paper' needs generations >= 1, learning_rate > 0 and adam_share between 0 and 1."
            )


@njit(cache=True, nogil=True, fastmath=SAFE_MATH, error_model="numpy")
def _parameter_gradient(points, slope, control, out):  # pragma: no cover - compiled
    """Write sum over points of slope * df/d(x, y, z, k) of each control point; rows as in `control`."""
    n, total = control.shape[1], points.shape[1]
    for i in range(n):
        cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
        by_x = by_y = by_z = by_k = 0.0
        px, py, pz = points[0], points[1], points[2]
        for p in range(total):
            dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
            inverse = 1.0 / (dx * dx + dy * dy + dz * dz)
            term = slope[p] * inverse
            by_k += term
            term *= inverse
            by_x += term * dx
            by_y += term * dy
            by_z += term * dz
        out[0, i], out[1, i], out[2, i], out[3, i] = 2 * k * by_x, 2 * k * by_y, 2 * k * by_z, by_k


def loss_and_gradient(
    hull: Float64[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"]
) -> tuple[float, Float64[np.ndarray, "4 n"]]:
    """Return the mean of Eq. GSloss over hull points and its gradient by the rows x, y, z, k."""
    field = field_at(hull, control)
    gradient = np.empty_like(control)
    _parameter_gradient(np.ascontiguousarray(hull.T), point_loss_slope(field) / len(field), control, gradient)
    return mean_loss(field), gradient


class Adam:
    """Adaptive moment estimation, as ``torch.optim.Adam`` without weight decay."""

    def __init__(self, learning_rate: float, beta1: float, beta2: float, epsilon: float) -> None:
        self.learning_rate, self.beta1, self.beta2, self.epsilon = learning_rate, beta1, beta2, epsilon
        self._first: np.ndarray | float = 0.0
        self._second: np.ndarray | float = 0.0
        self._count = 0

    def change(self, gradient: np.ndarray) -> np.ndarray:
        """Return what to add to the parameters for this gradient."""
        self._count += 1
        self._first = self.beta1 * self._first + (1 - self.beta1) * gradient
        self._second = self.beta2 * self._second + (1 - self.beta2) * gradient**2
        first = self._first / (1 - self.beta1**self._count)
        second = self._second / (1 - self.beta2**self._count)
        return -self.learning_rate * first / (np.sqrt(second) + self.epsilon)


class GradientDescent:
    """Descent with momentum, as ``torch.optim.SGD``; every generation sees all hull points."""

    def __init__(self, learning_rate: float, momentum: float) -> None:
        self.learning_rate, self.momentum = learning_rate, momentum
        self._velocity: np.ndarray | None = None

    def change(self, gradient: np.ndarray) -> np.ndarray:
        """Return what to add to the parameters for this gradient."""
        self._velocity = gradient if self._velocity is None else self.momentum * self._velocity + gradient
        return -self.learning_rate * self._velocity


class PaperFit(StepRun):
    """Step object of ``method='paper'``; see :class:`~mbstudio.core.imaging.steps.FitRun`."""

    method = "paper"

    def __init__(self, grain: Grain, n: int, seed: int, options: PaperOptions) -> None:
        self.options = options
        self._default_generations = options.generations
        super().__init__(grain, n, seed)

    def _prepare(self) -> PreparedGrain:
        return prepare(
            self.grain,
            self.seed,
            working_side=self.options.working_side,
            hull_points=self.options.hull_points,
            cavities=self.options.cavities,
        )

    def _spheres(self, n: int) -> Iterator[Sphere]:
        assert self.prepared is not None
        if self.options.clustering == "incremental":
            yield from clustered(self.prepared, n)
            return
        found = []
        for sphere in cluster_to_the_letter(self.prepared.mask, self.prepared.spacing, n):
            found.append(sphere)
            yield sphere
        if len(found) < n:  # the algorithm has used up the grain; the paper does not say what then
            transform = self.prepared.distance + np.float32(0.5 * self.prepared.voxel)
            yield from cluster_overlapping(transform, self.prepared.spacing, found, n, self.prepared.voxel)

    def _start(self, spheres: list[Sphere]) -> None:
        assert self.prepared is not None
        self._spheres_found = list(spheres)
        self.control = control_of_spheres(
            self.prepared, spheres, weight=self.options.weight, common_factor=self.options.common_factor
        )

    def _change_number(self, n: int) -> None:
        assert self.prepared is not None
        assert self.control is not None
        self.control = with_number(self.control, n, self.prepared)

    def _rms_now(self) -> float:
        assert self.prepared is not None
        assert self.control is not None
        points = self.prepared.hull[:: max(1, len(self.prepared.hull) // 3000)]
        field, gradient = field_and_gradient_at(points, self.control)
        steepness = np.clip(np.linalg.norm(gradient, axis=1) / field, 0.7, 6.0)
        return float(np.sqrt(np.mean(np.square(2 * (1 - field**-0.5) / steepness))))

    def _search(self, generations: int) -> Iterator[SearchStep]:
        assert self.prepared is not None
        assert self.control is not None
        options, hull = self.options, self.prepared.hull
        adam = Adam(options.learning_rate, options.beta1, options.beta2, options.epsilon)
        descent = GradientDescent(options.learning_rate, options.momentum)
        adam_until = round(options.adam_share * generations)
        last = max(self.generation, 0) + generations
        loss, gradient = loss_and_gradient(hull, self.control)
        if self.generation < 0:
            yield self._record(loss, self._rms_now(), last)
        for done in range(generations):
            if options.reduction == "sum":
                gradient = gradient * len(hull)
            optimiser = adam if done < adam_until else descent
            moved = self.control.copy()
            if options.parameter == "ln k":
                gradient[3] *= moved[3]
                change = optimiser.change(gradient)
                moved[3] *= np.exp(np.clip(change[3], -50, 50))
            else:
                change = optimiser.change(gradient)
                moved[3] = np.maximum(moved[3] + change[3], options.least_k)
            moved[:3] += change[:3]
            sound = (
                np.isfinite(moved).all()
                and np.abs(moved[:3]).max() < 1e3
                and 0 < moved[3].min() <= moved[3].max() < 1e6
            )
            if not sound:
                raise FitError(
                    f"The paper's search diverged at generation {self.generation + 1} "
                    f"on grain '{self.grain.name}': "
                    f"take a smaller learning_rate than {options.learning_rate:g}."
                )
            self.control = moved
            loss, gradient = loss_and_gradient(hull, moved)
            note = "SGD takes over from Adam" if done == adam_until and adam_until else ""
            yield self._record(loss, self._rms_now(), last, note)
