"""Style-learner `paper`: the variational autoencoder as the paper describes it, for comparison."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.options import OptionRecord, option
from mbstudio.core.threads import one_thread
from mbstudio.core.units import conversion_factor
from mbstudio.core.vae.models.features import Scaler, clone_names
from mbstudio.core.vae.models.networks import LEAK, apply_network, network_shapes
from mbstudio.core.vae.models.radii import outermost_radii
from mbstudio.core.vae.models.shape_model import Tensors
from mbstudio.core.vae.serialize.serialization import Serialization

LATENTS = 128
WIDTHS = (1024, 512, 256, 128)

EXPECTATION = (
    "Preset 'paper' follows the text literally. Shuffled control points under a mean square loss have their "
    "best answer where all of them coincide: expect clones that are all alike and nearly spheres. Use it for "
    "comparison, and preset 'aligned' or 'pca' for grains."
)


@dataclass(frozen=True)
class PaperOptions(OptionRecord, owner="preset 'paper'", error=StyleError):
    """Options of preset `paper`."""

    length_unit: float = option(
        1.0,
        "What the parents' mean nominal diameter is in the numbers of the loss (1: D_n; 100: about voxels; "
        "10,000: micrometres). The reconstruction item is a mean of squared lengths and k's, the "
        "distribution item a sum of pure numbers: the unit decides on their balance, and the paper does not "
        "state it.",
        above=0,
    )
    steps: int = option(20000, "Of Adam; the paper plots 20,000 and goes on.", minimum=1)
    batch: int = option(64, "Of Adam; the paper gives none.", minimum=1)
    rate: float = option(1e-4, "Learning rate eta.", above=0)
    rotations: int = option(
        0,
        "Augmentation: random rotations beside the original. 0 chooses 9 for 100 parents or more and 5 for "
        "fewer (145,000 and 6,000 avatars in all).",
        minimum=0,
    )
    shuffles: int = option(
        50, "Augmentation: random orders of the control points of each rotation.", minimum=1
    )
    annealed: float = option(
        0.4,
        "Share of the steps over which the distribution item's weight rises from 0 to 1.",
        minimum=0, maximum=1,
    )  # fmt: skip
    held_out: float = option(0.1, "Share of the parents held out for the validation error.")
    record_every: int = option(200, "Steps between two records.", minimum=1)


@dataclass(frozen=True, eq=False)
class PaperModel:
    """Trained model of preset `paper`.

    Attributes
    ----------
    scaler : Scaler
        Only its template, as a place to stand, and its unit are used.
    numbers : dict of float arrays
        Parameters of the networks, and ``mean_diameter``, shape (1,), in the scaler's unit.
    """

    preset: ClassVar[str] = "paper"
    scaler: Scaler
    numbers: Tensors

    @property
    def core(self) -> int:
        return LATENTS

    @property
    def dimension(self) -> int:
        return LATENTS

    @property
    def signs(self) -> None:
        """None: a flipped avatar is just another one to this model."""
        return None

    @property
    def bands(self) -> tuple[tuple[int, int], ...]:
        return ()

    @property
    def mean_diameter(self) -> float:
        """Mean nominal diameter of the parents, in the scaler's unit."""
        return float(self.numbers["mean_diameter"][0])

    def encode(self, avatars: Serialization) -> Float64[np.ndarray, "avatars 128"]:
        """Return the means of the latents of avatars, as they stand: unturned and in their order."""
        sizes = avatars.diameters * conversion_factor(avatars.unit, self.scaler.unit) / self.mean_diameter
        values = control_values(avatars, sizes).reshape(len(avatars), -1)
        with one_thread():
            coded = apply_network(self.numbers, "encoder", values, "leaky_relu")
            coded = np.where(coded >= 0, coded, LEAK * coded)
            return apply_network(self.numbers, "means", coded, "leaky_relu")

    def decode(
        self, latents: Float[np.ndarray, "avatars 128"], names: tuple[str, ...] | None = None
    ) -> Serialization:
        """Return the avatars of latents; a weight that is not positive becomes next to nothing."""
        with one_thread():
            values = apply_network(self.numbers, "decoder", np.asarray(latents, float), "leaky_relu")
        count, n = len(values), self.scaler.template.n
        points = values.reshape(count, n, 4)
        log_weights = np.log(np.maximum(points[:, :, 0], 1e-8))
        centers = points[:, :, 1:] - points[:, :, 1:].mean(1, keepdims=True)
        radii = outermost_radii(centers, log_weights)
        sizes = 2.0 * np.cbrt(np.power(radii, 3).mean(1))
        return Serialization(
            template=self.scaler.template,
            centers=centers / sizes[:, None, None],
            log_weights=log_weights - 2.0 * np.log(sizes)[:, None],
            diameters=sizes * self.mean_diameter,
            unit=self.scaler.unit,
            names=names or clone_names(count),
            rms=np.full(count, np.nan),
            valid=np.ones(count, dtype=bool),
        )

    def with_sizes(self, factor: float) -> PaperModel:
        """Return the model of parents that are so many times as large."""
        numbers = {**self.numbers, "mean_diameter": self.numbers["mean_diameter"] * factor}
        return replace(self, scaler=self.scaler.with_sizes(factor), numbers=numbers)

    def tensors(self) -> Tensors:
        """Return all numbers."""
        return dict(self.numbers)

    def settings(self) -> dict[str, Any]:
        """Return what the shapes of the tensors follow from: nothing but n."""
        return {}

    @classmethod
    def shapes(cls, settings: dict[str, Any], n: int) -> dict[str, tuple[int, ...]]:
        """Return the shapes that the tensors of a file must have."""
        return {"mean_diameter": (1,)} | paper_shapes(n)

    @classmethod
    def from_tensors(cls, scaler: Scaler, tensors: Tensors, settings: dict[str, Any]) -> PaperModel:
        """Return the model of a file's numbers."""
        return cls(scaler, tensors)


def paper_widths(n: int) -> dict[str, tuple[int, ...]]:
    """Return the layers' widths of each network: encoder, reparameterizer (two), decoder."""
    return {
        "encoder": (4 * n, *WIDTHS),
        "means": (WIDTHS[-1], LATENTS),
        "log_variances": (WIDTHS[-1], LATENTS),
        "decoder": (LATENTS, *WIDTHS[-2::-1], 4 * n),
    }


def paper_shapes(n: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of all parameters."""
    shapes: dict[str, tuple[int, ...]] = {}
    for prefix, widths in paper_widths(n).items():
        shapes |= network_shapes(prefix, widths)
    return shapes


def control_values(
    avatars: Serialization, sizes: Float[np.ndarray, " avatars"]
) -> Float64[np.ndarray, "avatars n 4"]:
    """Return (k, x, y, z) of all control points, in lengths of which D_n has `sizes`."""
    return np.concatenate(
        [
            np.exp(avatars.log_weights)[:, :, None] * np.square(sizes)[:, None, None],
            avatars.centers * sizes[:, None, None],
        ],
        axis=2,
    )
