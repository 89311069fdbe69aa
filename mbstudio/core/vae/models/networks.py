"""Fully connected networks: trained with torch, used with numpy, one dictionary of parameters."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float

from mbstudio.core.vae.models.shape_model import Tensors

if TYPE_CHECKING:
    import torch

Activation = Literal["silu", "leaky_relu"]

LEAK = 0.01
"""Slope of the leaky ReLU below 0: torch's default; the paper gives none."""


def network_shapes(prefix: str, widths: tuple[int, ...]) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the parameters of a network through layers of these widths."""
    shapes: dict[str, tuple[int, ...]] = {}
    for layer, (before, after) in enumerate(pairwise(widths)):
        shapes[f"{prefix}.{layer}.weight"] = (after, before)
        shapes[f"{prefix}.{layer}.bias"] = (after,)
    return shapes


def new_network(
    prefix: str, widths: tuple[int, ...], rng: np.random.Generator, *, silent: bool = False
) -> Tensors:
    """Return fresh parameters, uniform within 1 / sqrt(width before) (torch's usual start).

    Parameters
    ----------
    prefix : str
        Of their names.
    widths : tuple of int
    rng : numpy Generator
    silent : bool
        Whether the last layer is 0, so that the network adds nothing at first.
    """
    tensors: Tensors = {}
    last = f"{prefix}.{len(widths) - 2}."
    for name, shape in network_shapes(prefix, widths).items():
        before = widths[int(name.split(".")[-2])]
        bound = 0.0 if silent and name.startswith(last) else 1.0 / np.sqrt(before)
        tensors[name] = rng.uniform(-bound, bound, shape).astype(np.float32)
    return tensors


def _layers(parameters: object, prefix: str) -> int:
    assert isinstance(parameters, dict)
    return sum(name.startswith(f"{prefix}.") and name.endswith(".weight") for name in parameters)


def apply_network(
    parameters: Tensors, prefix: str, values: Float[np.ndarray, "b before"], activation: Activation
) -> Float[np.ndarray, "b after"]:
    """Return a network's outputs, computed with numpy in double precision."""
    count = _layers(parameters, prefix)
    for layer in range(count):
        weight = parameters[f"{prefix}.{layer}.weight"].astype(np.float64)
        values = values @ weight.T + parameters[f"{prefix}.{layer}.bias"]
        if layer < count - 1:
            if activation == "silu":
                values = values / (1.0 + np.exp(-np.clip(values, -500.0, 500.0)))
            else:
                values = np.where(values >= 0, values, LEAK * values)
    return values


def apply_network_torch(
    parameters: dict[str, torch.Tensor], prefix: str, values: torch.Tensor, activation: Activation
) -> torch.Tensor:
    """Return a network's outputs, computed with torch and recorded for the gradient."""
    from torch.nn import functional

    count = _layers(parameters, prefix)
    for layer in range(count):
        values = functional.linear(
            values, parameters[f"{prefix}.{layer}.weight"], parameters[f"{prefix}.{layer}.bias"]
        )
        if layer < count - 1:
            values = functional.silu(values) if activation == "silu" else functional.leaky_relu(values, LEAK)
    return values
