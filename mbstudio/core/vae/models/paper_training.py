"""How preset `paper` learns: rotated and shuffled control points under the paper's loss."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Int

from mbstudio.core.vae.models.losses import DistributionAnnealer, normal_divergence, reconstruction_item
from mbstudio.core.vae.models.networks import LEAK, apply_network_torch, new_network
from mbstudio.core.vae.models.optimizer import Parameters, step_rng
from mbstudio.core.vae.models.paper import (
    EXPECTATION,
    PaperModel,
    PaperOptions,
    control_values,
    paper_widths,
)  # fmt: skip
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.shape_model import Tensors
from mbstudio.core.vae.models.style_preset import StylePreset
from mbstudio.core.vae.models.training_data import TrainingData
from mbstudio.core.vae.models.training_step import Losses

_MANY = 100
_ENOUGH_FOR_NETWORKS = 50


class Augmentation:
    """Rotated and shuffled control points of parents (Zhao et al. 2023, "Dataset and Metrics").

    Parameters
    ----------
    values : float array, shape (parents, n, 4)
        (k, x, y, z) of the control points.
    rotations : int
        Random ones, beside the original.
    shuffles : int
        Random orders of every rotated parent.
    rng : numpy Generator
    """

    def __init__(
        self,
        values: Float[np.ndarray, "parents n 4"],
        rotations: int,
        shuffles: int,
        rng: np.random.Generator,
    ) -> None:
        from scipy.spatial.transform import Rotation

        count, n, _ = values.shape
        turns = Rotation.random(count * rotations, rng=rng).as_matrix().reshape(count, rotations, 3, 3)
        turned = np.einsum("prxy,pny->prnx", turns, values[:, :, 1:])
        weights = np.repeat(values[:, None, :, :1], rotations, axis=1)
        rotated = np.concatenate([weights, turned], axis=3)
        self.values = np.concatenate([values[:, None], rotated], axis=1).astype(np.float32)
        orders = np.tile(np.arange(n, dtype=np.int16), (count, rotations + 1, shuffles, 1))
        self.orders = rng.permuted(orders, axis=3)

    def __len__(self) -> int:
        return int(np.prod(self.orders.shape[:3]))

    def draw(self, size: int, rng: np.random.Generator) -> Float32[np.ndarray, "size numbers"]:
        """Return this many augmented avatars as rows of 4 n numbers."""
        parent, turn, order = (rng.integers(0, high, size) for high in self.orders.shape[:3])
        points = self.values[parent, turn]
        shuffled = np.take_along_axis(points, self.orders[parent, turn, order][:, :, None], axis=1)
        return shuffled.reshape(size, -1)


class PaperTrainer:
    """Parameters of preset `paper` and one step of their improvement.

    Parameters
    ----------
    data : TrainingData
    options : PaperOptions
    seed : int
    device : {'cpu', 'cuda'}
    start : PaperModel, optional
        To go on from, instead of from random numbers.

    Notes
    -----
    The networks compute in D_n of the mean parent whatever the unit; the loss is taken in the unit asked
    for. With Adam, which does not mind the scale of a loss, this is the paper's network behind one fixed
    scaling of its inputs and outputs.
    """

    def __init__(
        self,
        data: TrainingData,
        options: PaperOptions,
        seed: int,
        device: str,
        start: PaperModel | None = None,
    ) -> None:
        self.data, self.options, self.seed = data, options, seed
        self.steps, self.record_every = options.steps, options.record_every
        self.annealer = DistributionAnnealer(self.steps, options.annealed)
        self.annealing_ends = self.annealer.end
        n = data.parents.template.n
        rng = np.random.default_rng([abs(int(seed)), 3])
        numbers: Tensors = {}
        for prefix, widths in paper_widths(n).items():
            numbers |= new_network(prefix, widths, rng)
        mean_diameter = np.array([data.parents.diameters.mean()])
        if start is not None:
            numbers = dict(sorted(start.numbers.items()))  # a file has no order, sums have
            mean_diameter = numbers.pop("mean_diameter")
        self._mean_diameter = mean_diameter
        sizes = data.parents.diameters / mean_diameter
        rotations = options.rotations or (9 if len(data.parents) >= _MANY else 5)
        self.augmentation = Augmentation(
            control_values(data.parents, sizes)[data.trained], rotations, options.shuffles, rng
        )
        self.notes: tuple[str, ...] = (
            EXPECTATION,
            f"Trained on {len(self.augmentation)} rotated and shuffled avatars, D_n of the mean parent "
            f"counted as {options.length_unit:g}.",
        )
        unit = options.length_unit
        self._lengths = np.tile([unit**2, unit, unit, unit], n).astype(np.float32)
        self.parameters = Parameters(numbers, device)

    def advance(self, step: int) -> Losses:
        """Make one step."""
        import torch

        rng, device = step_rng(self.seed, step), self.parameters.device
        # A copy by torch is aligned; numpy's memory may lie anywhere, and rounding can depend on that.
        values = torch.tensor(self.augmentation.draw(self.options.batch, rng), device=device)
        parameters = self.parameters.tensors
        coded = torch.nn.functional.leaky_relu(
            apply_network_torch(parameters, "encoder", values, "leaky_relu"), LEAK
        )
        means = apply_network_torch(parameters, "means", coded, "leaky_relu")
        log_variances = apply_network_torch(parameters, "log_variances", coded, "leaky_relu")
        noise = torch.from_numpy(rng.standard_normal(tuple(means.shape), dtype=np.float32)).to(device)
        drawn = means + (0.5 * log_variances).exp() * noise
        made = apply_network_torch(parameters, "decoder", drawn, "leaky_relu")
        lengths = torch.from_numpy(self._lengths).to(device)
        reconstruction = reconstruction_item(made * lengths, values * lengths)
        divergence = normal_divergence(means, log_variances)
        weight = self.annealer.weight(step)
        loss = reconstruction + weight * divergence
        self.parameters.improve(loss, self.options.rate)
        return Losses(reconstruction.item(), divergence.item(), weight, loss.item())

    def replay(self, old: Int[np.ndarray, " old"], new: Int[np.ndarray, " new"]) -> None:
        """Do nothing: the augmentation draws from all parents alike."""

    def weights(self) -> Tensors:
        """Return a copy of the parameters."""
        return self.parameters.weights()

    def state(self) -> Tensors:
        """Return parameters and the optimizer's memory."""
        return self.parameters.state()

    def restore(self, state: Tensors) -> None:
        """Go back to a state."""
        self.parameters.restore(state)

    def move_to_processor(self) -> bool:
        """Leave the GPU; False if it was not there."""
        if self.parameters.device == "cpu":
            return False
        self.parameters.move("cpu")
        return True

    def rms(self, rows: Int[np.ndarray, " rows"]) -> float:
        """Return the mean surface distance of these parents and what the model makes of them."""
        weights = self.weights()
        if not all(np.isfinite(array).all() for array in weights.values()):
            return float("nan")
        model, some = self.model(weights), self.data.parents.take(rows)
        return float(surface_rms(some, model.decode(model.encode(some)), in_octant=18).mean())

    def model(self, weights: Tensors) -> PaperModel:
        """Return the model of these parameters."""
        return PaperModel(self.data.scaler, weights | {"mean_diameter": self._mean_diameter})


PRESET = StylePreset(
    name=PaperModel.preset,
    title="As in the paper",
    summary="The paper's network on shuffled, rotated control points, for comparison.",
    model=PaperModel,
    options=PaperOptions,
    trainer=PaperTrainer,
    learning_on={"steps": 2000, "annealed": 0.0},
    enough_parents=_ENOUGH_FOR_NETWORKS,
)
