"""Parameters under Adam on one device: the part of a trainer that presets share."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.vae.models.shape_model import Tensors

if TYPE_CHECKING:
    import torch


class Parameters:
    """Parameters of a model as torch tensors, and their optimizer.

    Parameters
    ----------
    start : dict of float arrays
    device : str
    decay : float
        Weight decay of AdamW; 0 gives Adam.
    clip : float, optional
        Greatest norm of the gradient.
    """

    def __init__(self, start: Tensors, device: str, *, decay: float = 0.0, clip: float | None = None) -> None:
        self.decay, self.clip, self.device = decay, clip, device
        self._place(start)

    def _place(self, start: Tensors) -> None:
        import torch

        # All in one layout: products of matrices round differently in another.
        self.tensors: dict[str, torch.Tensor] = {
            name: torch.tensor(
                np.ascontiguousarray(array), dtype=torch.float32, device=self.device, requires_grad=True
            )
            for name, array in start.items()
        }
        self.optimizer = torch.optim.AdamW(self.tensors.values(), lr=1e-3, weight_decay=self.decay)

    def improve(self, loss: torch.Tensor, rate: float) -> None:
        """Go one step down the gradient of the loss."""
        import torch

        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        if self.clip is not None:
            torch.nn.utils.clip_grad_norm_(self.tensors.values(), self.clip)
        self.optimizer.step()

    def weights(self) -> Tensors:
        """Return a copy of the parameters."""
        return {name: tensor.detach().cpu().numpy().copy() for name, tensor in self.tensors.items()}

    def state(self) -> Tensors:
        """Return the parameters and the optimizer's memory of each."""
        state = self.weights()
        for name, tensor in self.tensors.items():
            for key, value in self.optimizer.state.get(tensor, {}).items():
                state[f"{name}|{key}"] = value.detach().cpu().numpy().copy()
        return state

    def restore(self, state: Tensors) -> None:
        """Go back to a state."""
        import torch

        # In the order as it was: the norm of the gradient is a sum over the parameters.
        self._place({name: state[name] for name in self.tensors})
        for name, tensor in self.tensors.items():
            memory = {
                key.split("|")[1]: torch.tensor(array, device="cpu" if key.endswith("|step") else self.device)
                for key, array in state.items()
                if key.startswith(f"{name}|")
            }
            if memory:
                self.optimizer.state[tensor] = memory

    def move(self, device: str) -> None:
        """Go on, on another device."""
        state = self.state()
        self.device = device
        self.restore(state)


def one_cycle_rate(step: int, steps: int, highest: float, *, rise: float = 0.3) -> float:
    """Return the learning rate of a step: up from 1/25 of the highest by a cosine, then down to nothing.

    Notes
    -----
    Smith and Topin (2019), "Super-convergence", with the constants of torch's OneCycleLR.
    """
    top = max(1.0, rise * steps)
    if step < top:
        low, share = highest / 25.0, step / top
        return low + (highest - low) * 0.5 * (1.0 - math.cos(math.pi * share))
    share = min(1.0, (step - top) / max(1.0, steps - top))
    return highest * (1e-5 + (1 - 1e-5) * 0.5 * (1.0 + math.cos(math.pi * share)))


def step_rng(seed: int, step: int) -> np.random.Generator:
    """Return the chance of one step: that of any step is known without those before it."""
    return np.random.default_rng([abs(int(seed)), 2, step])
