"""How preset `aligned` learns: steps of its loss."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, Int

from mbstudio.core.vae.models.aligned import (
    HIDDEN,
    INPUTS,
    RADII,
    AlignedModel,
    AlignedOptions,
    input_table,
    raw_inputs,
)  # fmt: skip
from mbstudio.core.vae.models.features import CENTER_SCALE, WEIGHT_SCALE, character, flipped_vectors
from mbstudio.core.vae.models.losses import (
    DistributionAnnealer,
    field_errors,
    normal_divergence,
    parameter_error,
    weighted_item,
)
from mbstudio.core.vae.models.networks import apply_network_torch, new_network
from mbstudio.core.vae.models.optimizer import Parameters, one_cycle_rate, step_rng
from mbstudio.core.vae.models.principal import PrincipalComponents, principal_components
from mbstudio.core.vae.models.probes import Probes
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.shape_model import Tensors
from mbstudio.core.vae.models.style_preset import StylePreset
from mbstudio.core.vae.models.training_data import TrainingData
from mbstudio.core.vae.models.training_step import Losses

if TYPE_CHECKING:
    import torch

_ITEMS = {"field": 144.0, "parameters": 16.0, "size": 1.0}
_FIRST_LOG_SIGMA = np.array([-4.5, -2.0, -2.0])
_FIRST_LOG_VARIANCE = -3.0
_SURFACE_PROBES, _SHELL_PROBES = 64, 24
_SHELL_SHARE = 0.02 / 36.0
_FEW = 100
_ENOUGH_FOR_NETWORKS = 50

FEW_PARENTS = (
    "For fewer than 50 parents principal components (preset 'pca') reproduce held-out parents better than "
    "a network, which has too little data: compare the two."
)


class AlignedTrainer:
    """Parameters of preset `aligned` and one step of their improvement.

    Parameters
    ----------
    data : TrainingData
    options : AlignedOptions
    seed : int
    device : {'cpu', 'cuda'}
    start : AlignedModel, optional
        To go on from, instead of from principal components; it decides on the number of latents.
    """

    def __init__(
        self,
        data: TrainingData,
        options: AlignedOptions,
        seed: int,
        device: str,
        start: AlignedModel | None = None,
    ) -> None:
        if start is not None:
            options = replace(options, latents=start.core)
        self.data, self.options, self.seed = data, options, seed
        self.steps = options.steps or (4000 if len(data.parents) >= _FEW else 2000)
        self.record_every = options.record_every
        self.annealer = DistributionAnnealer(self.steps, options.annealed)
        self.annealing_ends = self.annealer.end
        self.notes: tuple[str, ...] = (FEW_PARENTS,) if len(data.parents) < _ENOUGH_FOR_NETWORKS else ()
        self._old_and_new: tuple[Int[np.ndarray, " old"], Int[np.ndarray, " new"]] | None = None
        raw = raw_inputs(data.scaler, data.parents)
        # By name: a file has no order, and the norm of the gradient is a sum over the parameters.
        known = {} if start is None else dict(sorted(start.numbers.items()))
        numbers = known or initial_numbers(data, options, seed, raw)
        self._fixed = {name: numbers.pop(name) for name in ("input.mean", "input.scale", "parities")}
        numbers.setdefault("log_sigma", _FIRST_LOG_SIGMA.copy())
        self._inputs = ((raw - self._fixed["input.mean"]) / self._fixed["input.scale"]).astype(np.float32)
        self._probes = Probes.from_parents(data.parents)
        self.parameters = Parameters(numbers, device, decay=1e-4, clip=20.0)
        self._place()

    def _place(self) -> None:
        """Bring what does not change to the device."""
        import torch

        device, scaler = self.parameters.device, self.data.scaler

        def tensor(array: np.ndarray) -> torch.Tensor:
            kind = torch.int64 if array.dtype.kind == "i" else torch.float32
            return torch.tensor(array, dtype=kind, device=device)

        sources, turns = scaler.flip_table()
        probes = self._probes
        self._on_device = {
            "inputs": tensor(self._inputs), "exchange": tensor(input_table()[0]),
            "signs": tensor(character(self._fixed["parities"].astype(np.int64))),
            "sources": tensor(sources), "turns": tensor(turns), "vectors": tensor(self.data.vectors),
            "template.centers": tensor(scaler.template.centers),
            "template.log_weights": tensor(scaler.template.log_weights),
            "surface": tensor(probes.surface), "steepness": tensor(probes.steepness),
            "shell": tensor(probes.shell), "shell_log_field": tensor(probes.shell_log_field),
        }  # fmt: skip

    def replay(self, old: Int[np.ndarray, " old"], new: Int[np.ndarray, " new"]) -> None:
        """Draw half of each step's parents from the old ones and half from the new."""
        self._old_and_new = old, new

    def draw_rows(self, rng: np.random.Generator) -> Int[np.ndarray, " batch"]:
        """Return the parents of one step: where old and new ones are told apart, half of each."""
        batch = self.options.batch
        if self._old_and_new is None or not all(len(rows) for rows in self._old_and_new):
            return rng.choice(self.data.trained, batch)
        old, new = self._old_and_new
        return np.concatenate([rng.choice(old, batch - batch // 2), rng.choice(new, batch // 2)])

    def advance(self, step: int) -> Losses:
        """Make one step."""
        rng = step_rng(self.seed, step)
        weight = self.annealer.weight(step)
        items, divergence = self._items(self.draw_rows(rng), rng)
        sigmas = self.parameters.tensors["log_sigma"]
        likelihoods = [
            weighted_item(error, sigmas[place], _ITEMS[name])
            for place, (name, error) in enumerate(items.items())
        ]
        total = likelihoods[0] + likelihoods[1] + likelihoods[2]
        loss = total + self.options.kl_weight * weight * divergence
        self.parameters.improve(loss, one_cycle_rate(step, self.steps, self.options.rate))
        return Losses(total.item(), divergence.item(), weight, loss.item())

    def _items(
        self, chosen: Int[np.ndarray, " batch"], rng: np.random.Generator
    ) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        import torch

        at, batch, latents = self._on_device, len(chosen), self.options.latents
        device = self.parameters.device

        def whole(high: int, *shape: int) -> torch.Tensor:
            return torch.from_numpy(rng.integers(0, high, shape)).to(device)

        rows = torch.from_numpy(chosen).to(device)
        # Encoded in one flip and decoded in another: the two learn to mean the same in all of them.
        flip, other = whole(8, batch), whole(8, batch)
        parameters = self.parameters.tensors
        inputs = at["inputs"][rows].gather(1, at["exchange"][flip])
        spread = apply_network_torch(parameters, "encoder", inputs, "silu")
        means = (inputs @ parameters["encoder.skip"].T + spread[:, :latents]) * at["signs"][flip]
        log_variances = _FIRST_LOG_VARIANCE + spread[:, latents:]
        noise = torch.from_numpy(rng.standard_normal((batch, latents), dtype=np.float32)).to(device)
        drawn = (means + (0.5 * log_variances).exp() * noise) * at["signs"][other]
        decoded = parameters["decoder.mean"] + drawn @ parameters["decoder.skip"].T
        decoded = decoded + apply_network_torch(parameters, "decoder", drawn, "silu")
        decoded = decoded.gather(1, at["sources"][other]) * at["turns"][other]
        truth = at["vectors"][rows]
        n = self.data.scaler.template.n
        centers = at["template.centers"] + decoded[:, : 3 * n].reshape(batch, n, 3) / CENTER_SCALE
        log_weights = at["template.log_weights"] + decoded[:, 3 * n : 4 * n] / WEIGHT_SCALE
        near, far = (
            whole(at["surface"].shape[1], batch, _SURFACE_PROBES),
            whole(at["shell"].shape[1], batch, _SHELL_PROBES),
        )
        surface, shell = field_errors(
            centers, log_weights,
            at["surface"][rows[:, None], near], at["steepness"][rows[:, None], near],
            at["shell"][rows[:, None], far], at["shell_log_field"][rows[:, None], far],
        )  # fmt: skip
        items = {
            "field": surface + _SHELL_SHARE * shell,
            "parameters": parameter_error(decoded, truth, n),
            "size": (decoded[:, -1] - truth[:, -1]).square().mean(),
        }
        return items, normal_divergence(means, log_variances)

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
        self._place()
        return True

    def bare_model(self, weights: Tensors) -> AlignedModel:
        """Return the model of these parameters without details."""
        none = PrincipalComponents(
            np.zeros(self.data.scaler.width), np.zeros((0, self.data.scaler.width)), np.zeros(0, np.int64)
        )
        return AlignedModel(self.data.scaler, weights | self._fixed, none)

    def rms(self, rows: Int[np.ndarray, " rows"]) -> float:
        """Return the mean surface distance of these parents and what the model proper makes of them."""
        model, some = self.bare_model(self.weights()), self.data.parents.take(rows)
        made = model.decode(model.encode(some))
        if not np.isfinite(made.centers).all():
            return float("nan")
        return float(surface_rms(some, made, in_octant=18).mean())

    def model(self, weights: Tensors) -> AlignedModel:
        """Return the finished model: latents in order, with the details that it leaves."""
        bare = self.bare_model(weights)
        bare = bare.order_latents(bare.encode_core(self.data.parents))
        return bare.with_details(self.data.parents, self.options.details)


def initial_numbers(
    data: TrainingData, options: AlignedOptions, seed: int, raw: Float64[np.ndarray, "parents 145"]
) -> Tensors:
    """Return where the training starts: whitened principal components of the radii, regressed upon.

    Notes
    -----
    At the start the networks add nothing, and the model is linear: encoder to the scores of the radii of
    the parents in all flips, decoder by ridge regression of the vectors on them.
    """
    latents = options.latents
    table = input_table()
    mean = np.mean([raw[data.trained][:, exchange].mean(0) for exchange in table[0]], axis=0)
    deviation = float(np.sqrt(np.square(raw[data.trained] - mean)[:, :RADII].mean()))
    scale = np.append(np.full(RADII, max(deviation, 1e-6)), 1.0)
    inputs = (raw[data.trained] - mean) / scale
    basis = principal_components(inputs, table, latents)
    scores = basis.scores(inputs)
    spread = np.maximum(np.sqrt(np.square(scores).mean(0)), 1e-6)
    found = len(basis.parities)
    skip, parities = np.zeros((latents, INPUTS)), np.zeros(latents)
    skip[:found] = basis.components / spread[:, None]
    parities[:found] = basis.parities
    # In all flips, so that the regression does not mix parities.
    flips = data.scaler.flip_table()
    signs = character(parities.astype(np.int64))
    whitened = (inputs - basis.mean) @ skip.T
    codes = np.concatenate([whitened * sign for sign in signs])
    vectors = np.concatenate([flipped_vectors(data.vectors[data.trained], flips, f) for f in range(8)])
    centre = vectors.mean(0)
    ridge = 1e-3 * len(codes) * np.eye(latents)
    decoder = np.linalg.solve(codes.T @ codes + ridge, codes.T @ (vectors - centre)).T
    rng = np.random.default_rng([abs(int(seed)), 3])
    return {
        "input.mean": mean + basis.mean * scale, "input.scale": scale, "parities": parities,
        "encoder.skip": skip, "decoder.skip": decoder, "decoder.mean": centre,
        **new_network("encoder", (INPUTS, *HIDDEN, 2 * latents), rng, silent=True),
        **new_network("decoder", (latents, *HIDDEN, data.scaler.width), rng, silent=True),
    }  # fmt: skip


PRESET = StylePreset(
    name=AlignedModel.preset,
    title="Aligned network",
    summary="A variational autoencoder whose control points correspond: the closest of the networks.",
    model=AlignedModel,
    options=AlignedOptions,
    trainer=AlignedTrainer,
    learning_on={"steps": 2000, "rate": 5e-4, "annealed": 0.0},
    enough_parents=_ENOUGH_FOR_NETWORKS,
)
