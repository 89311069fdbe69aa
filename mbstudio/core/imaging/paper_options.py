"""Every choice that the paper leaves open, as an option of ``method='paper'``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args, get_origin, get_type_hints

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.preprocess import Cavities


@dataclass(frozen=True)
class PaperOptions:
    """Options of ``method='paper'``: every choice that the paper leaves open.

    Attributes
    ----------
    generations : int
        E_gs. The paper gives no number.
    learning_rate : float
        eta; 0.001 in the paper, for Adam and SGD alike. In units of `unit`.
    adam_share : float
        Part of the generations done by Adam; the rest by SGD. The paper combines both without a
        schedule: Adam travels fast, SGD ends its jitter (the loss has a kink at f = 1).
    beta1, beta2, epsilon : float
        Of Adam (Kingma and Ba's values).
    momentum : float
        Of SGD; 0 is plain gradient descent, as printed.
    batch_points : int
        Hull points, drawn anew by the seed, that a generation of SGD sees; 0 for all of them. The
        paper calls the descent stochastic, but its loss sums over the whole hull.
    weight : {'square', 'radius'}
        Start from k = r**2 (one sphere is then its own metaball), or from k = r as printed.
    radius_offset : float
        Voxels taken off the radius that the distance transform gives: it reaches to the centre of
        the nearest voxel outside, the surface lies half a voxel before it. 0 as printed.
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
    unit : {'rms radius', 'voxel'}
        The length that counts as 1 to the optimisers. The paper only shifts to the origin and
        names no unit; with voxels a learning rate of 0.001 moves a thousandth of a voxel a
        generation, and E_gs must be tens of thousands.
    hull : {'surface', 'voxels'}
        H: points spread evenly over the smoothed surface, or the centres of the outermost voxels,
        which lie half a voxel inside.
    zeroed : {'open', 'closed'}
        Whether Algorithm 1 zeroes the voxels nearer than the radius, or those at the radius too.
    used_up : {'overlap', 'stop'}
        Where Algorithm 1 finds no voxel left before n spheres (in a ball, after one): go on with
        spheres that overlap, or refuse n.
    working_side : int
        Longest side of the working grid in voxels; larger grains are averaged in blocks. The paper
        works on all voxels.
    hull_points : int
        Points of the hull at most. The paper works on all of them.
    cavities : {'fill', 'keep'}
        Fill cavities that the grain encloses, with a warning in the verdict, or let the avatar have
        them: a void of its own for each, as far as n allows, which is then no fault.
    clustering : {'letter', 'incremental'}
        A distance transform for each sphere, or one lowered locally.
    """

    generations: int = 1500
    learning_rate: float = 0.001
    adam_share: float = 0.8
    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-8
    momentum: float = 0.0
    batch_points: int = 0
    weight: Literal["square", "radius"] = "square"
    radius_offset: float = 0.5
    common_factor: bool = True
    parameter: Literal["k", "ln k"] = "ln k"
    least_k: float = 1e-8
    reduction: Literal["mean", "sum"] = "mean"
    unit: Literal["rms radius", "voxel"] = "rms radius"
    hull: Literal["surface", "voxels"] = "surface"
    zeroed: Literal["open", "closed"] = "open"
    used_up: Literal["overlap", "stop"] = "overlap"
    working_side: int = 200
    hull_points: int = 24_000
    cavities: Cavities = "fill"
    clustering: Literal["letter", "incremental"] = "letter"

    def __post_init__(self) -> None:
        for name, kind in get_type_hints(PaperOptions).items():
            value = getattr(self, name)
            if get_origin(kind) is Literal and value not in get_args(kind):
                raise FitError(
                    f"{name} = {value!r} is no choice of method 'paper': use one of {get_args(kind)}."
                )
        above_zero = ("learning_rate", "epsilon", "least_k")
        bad = [name for name in above_zero if not getattr(self, name) > 0]
        whole = {"generations": 1, "working_side": 4, "hull_points": 10, "batch_points": 0}
        bad += [name for name, least in whole.items() if getattr(self, name) < least]
        bad += [name for name in ("beta1", "beta2", "momentum") if not 0 <= getattr(self, name) < 1]
        bad += [name for name, most in (("adam_share", 1.0), ("radius_offset", 1.0))
                if not 0 <= getattr(self, name) <= most]  # fmt: skip
        if self.zeroed == "closed" and self.clustering == "incremental":
            bad.append("zeroed")  # the lowered transform knows spheres, not voxels
        if bad:
            raise FitError(
                f"{bad[0]} = {getattr(self, bad[0])!r} does not suit method 'paper': generations is 1 or "
                "more, working_side 4, hull_points 10, batch_points 0; learning_rate, epsilon and least_k "
                "are above 0; adam_share and radius_offset from 0 to 1; beta1, beta2 and momentum from 0 to "
                "below 1; zeroed = 'closed' needs clustering = 'letter'."
            )
