"""The paper's method: Algorithm 1 to the letter, then the gradient search of Algorithm 2.

What the paper leaves open is an option of
:class:`~mbstudio.core.imaging.paper.gradient_search.PaperOptions`, with its reason. The optimisers
are written out here, a few lines each, with the arithmetic of ``torch.optim.Adam`` and
``torch.optim.SGD``: the gradient is analytic, so torch would add only its seconds of import and
its threads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import SAFE_MATH, compiled
from mbstudio.core.errors import FitError
from mbstudio.core.imaging.loss import mean_loss, point_loss_slope
from mbstudio.core.imaging.preprocess import CAVITIES, PreparedGrain, prepare
from mbstudio.core.imaging.run import StepRun, cluster_spheres
from mbstudio.core.imaging.start.control_points import control_of_spheres
from mbstudio.core.imaging.start.sphere_clustering import Sphere, cluster_overlapping, cluster_to_the_letter
from mbstudio.core.imaging.steps import SearchStep
from mbstudio.core.metaball.field import field_and_gradient_at, field_at
from mbstudio.core.options import OptionRecord, option

_OF_ADAM = "Of Adam (Kingma and Ba's values)."


@dataclass(frozen=True)
class PaperOptions(OptionRecord, owner="method 'paper'", error=FitError):
    """Options of ``method='paper'``: every choice that the paper leaves open."""

    generations: int = option(1500, "E_gs. The paper gives no number.", minimum=1)
    learning_rate: float = option(
        0.001, "eta; 0.001 in the paper, for Adam and SGD alike. In units of `unit`.", above=0
    )
    adam_share: float = option(
        0.8,
        "Part of the generations done by Adam; the rest by SGD. The paper combines both without a schedule: "
        "Adam travels fast, SGD ends its jitter (the loss has a kink at f = 1).",
        minimum=0, maximum=1,
    )  # fmt: skip
    beta1: float = option(0.9, _OF_ADAM, minimum=0, below=1)
    beta2: float = option(0.999, _OF_ADAM, minimum=0, below=1)
    epsilon: float = option(1e-8, _OF_ADAM, above=0)
    momentum: float = option(0.0, "Of SGD; 0 is plain gradient descent, as printed.", minimum=0, below=1)
    batch_points: int = option(
        0,
        "Hull points, drawn anew by the seed, that a generation of SGD sees; 0 for all of them. The paper "
        "calls the descent stochastic, but its loss sums over the whole hull.",
        minimum=0,
    )
    weight: Literal["square", "radius"] = option(
        "square",
        "Start from k = r**2 (one sphere is then its own metaball), or from k = r as printed.",
        choices=("square", "radius"),
    )
    radius_offset: float = option(
        0.5,
        "Voxels taken off the radius that the distance transform gives: it reaches to the centre of the "
        "nearest voxel outside, the surface lies half a voxel before it. 0 as printed.",
        minimum=0, maximum=1,
    )  # fmt: skip
    common_factor: bool = option(
        True, "Whether all k are first divided by one factor so that ln f is 0 on average over the hull."
    )
    parameter: Literal["k", "ln k"] = option(
        "ln k",
        "What the optimisers move besides the places: ln k, which cannot leave the positive numbers, or k as "
        "printed (kept above `least_k`). With k, plain SGD at the paper's learning rate jumps about the kink "
        "of the loss: measured, it ends at 3 to 10 times the loss that Adam had reached.",
        choices=("k", "ln k"),
    )
    least_k: float = option(1e-8, "Floor of k for parameter='k', in working lengths squared.", above=0)
    reduction: Literal["mean", "sum"] = option(
        "mean",
        "Whether the gradient is that of the mean over the hull points, or of the sum as printed (then SGD's "
        "step grows with the number of points). The loss reported is always the mean.",
        choices=("mean", "sum"),
    )
    unit: Literal["rms radius", "voxel"] = option(
        "rms radius",
        "The length that counts as 1 to the optimisers. The paper only shifts to the origin and names no "
        "unit; with voxels a learning rate of 0.001 moves a thousandth of a voxel a generation, and E_gs "
        "must be tens of thousands.",
        choices=("rms radius", "voxel"),
    )
    hull: Literal["surface", "voxels"] = option(
        "surface",
        "H: points spread evenly over the smoothed surface, or the centres of the outermost voxels, which "
        "lie half a voxel inside.",
        choices=("surface", "voxels"),
    )
    zeroed: Literal["open", "closed"] = option(
        "open",
        "Whether Algorithm 1 zeroes the voxels nearer than the radius, or those at the radius too.",
        choices=("open", "closed"),
    )
    used_up: Literal["overlap", "stop"] = option(
        "overlap",
        "Where Algorithm 1 finds no voxel left before n spheres (in a ball, after one): go on with spheres "
        "that overlap, or refuse n.",
        choices=("overlap", "stop"),
    )
    working_side: int = option(
        200,
        "Longest side of the working grid in voxels; larger grains are averaged in blocks. The paper works "
        "on all voxels.",
        minimum=4,
    )
    hull_points: int = option(
        24_000, "Points of the hull at most. The paper works on all of them.", minimum=10
    )
    cavities: Literal["fill", "keep"] = option(CAVITIES.default, CAVITIES.meaning, choices=CAVITIES.choices)
    clustering: Literal["letter", "incremental"] = option(
        "letter",
        "A distance transform for each sphere, or one lowered locally.",
        choices=("letter", "incremental"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.zeroed == "closed" and self.clustering == "incremental":
            # The lowered transform knows spheres, not voxels.
            raise FitError(
                "zeroed = 'closed' cannot be combined with clustering = 'incremental' in method 'paper': "
                "use clustering = 'letter'."
            )


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _parameter_gradient(points: np.ndarray, slope: np.ndarray, control: np.ndarray, out: np.ndarray) -> None:
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
    options: PaperOptions
    _begun = False  # whether the control points as they stand have been a step

    def _prepare(self) -> PreparedGrain:
        options = self.options
        return prepare(
            self.grain, self.seed, working_side=options.working_side, hull_points=options.hull_points,
            hull=options.hull, cavities=options.cavities,
        )  # fmt: skip

    def _find_spheres(self, n: int) -> Iterator[Sphere]:
        prepared, options, before = self.prepared, self.options, len(self._spheres_found)
        if options.clustering == "incremental":
            yield from cluster_spheres(prepared, n)[before:]
            return
        found = list(self._spheres_found)
        for sphere in cluster_to_the_letter(
            prepared.mask, prepared.spacing, n, found=tuple(found), closed=options.zeroed == "closed"
        ):
            found.append(sphere)
            yield sphere
        if len(found) < n and options.used_up == "overlap":
            transform = prepared.distance + np.float32(0.5 * prepared.voxel)
            yield from cluster_overlapping(transform, prepared.spacing, found, n, prepared.voxel)

    def _place_control_points(self, spheres: Sequence[Sphere]) -> np.ndarray:
        options = self.options
        return control_of_spheres(
            self.prepared, spheres, weight=options.weight, common_factor=options.common_factor,
            radius_offset=options.radius_offset,
        )  # fmt: skip

    def _begin_at(self, control: np.ndarray) -> float:
        self.control, self._begun = control, False
        return mean_loss(field_at(self.prepared.hull, control))

    def _measure_rms(self) -> float:
        points = self.prepared.hull[:: max(1, len(self.prepared.hull) // 3000)]
        field, gradient = field_and_gradient_at(points, self.control)
        steepness = np.clip(np.linalg.norm(gradient, axis=1) / field, 0.7, 6.0)
        return float(np.sqrt(np.mean(np.square(2 * (1 - field**-0.5) / steepness))))

    def _search(self, generations: int) -> Iterator[SearchStep]:
        options, hull = self.options, self.prepared.hull
        adam = Adam(options.learning_rate, options.beta1, options.beta2, options.epsilon)
        descent = GradientDescent(options.learning_rate, options.momentum)
        adam_until = round(options.adam_share * generations)
        rng = np.random.default_rng([self.seed, 3, self.generation + 1])
        last = max(self.generation, 0) + generations
        loss, gradient = loss_and_gradient(hull, self.control)
        if not self._begun:
            self._begun = True
            yield self._record(loss, self._measure_rms(), last, self._pop_note())
        for done in range(generations):
            optimiser: Adam | GradientDescent = adam if done < adam_until else descent
            if optimiser is descent and 0 < options.batch_points < len(hull):
                batch = hull[rng.choice(len(hull), options.batch_points, replace=False)]
                gradient = loss_and_gradient(batch, self.control)[1]
            self.control = self._step_along(self.control, gradient, optimiser)
            loss, gradient = loss_and_gradient(hull, self.control)
            note = "SGD takes over from Adam" if done == adam_until and adam_until else ""
            yield self._record(loss, self._measure_rms(), last, note)

    def _step_along(
        self, control: np.ndarray, gradient: np.ndarray, optimiser: Adam | GradientDescent
    ) -> np.ndarray:
        """Return the control points after one generation, given the gradient of the mean loss."""
        options, moved, slope = self.options, control.copy(), gradient.copy()
        # Optimisers see lengths in `unit`: places are longer by this factor, slopes flatter.
        length = 1.0 if options.unit == "rms radius" else 1.0 / self.prepared.voxel
        if options.reduction == "sum":
            slope *= len(self.prepared.hull)
        slope[:3] /= length
        if options.parameter == "ln k":
            slope[3] *= moved[3]
            change = optimiser.change(slope)
            moved[3] *= np.exp(np.clip(change[3], -50, 50))
        else:
            slope[3] /= length**2
            change = optimiser.change(slope)
            moved[3] = np.maximum(moved[3] + change[3] / length**2, options.least_k)
        moved[:3] += change[:3] / length
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
        return moved
