"""Fabric: how the normals of contacts are spread over directions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def fabric_tensor(normals: Float[np.ndarray, "contacts 3"]) -> Float[np.ndarray, "3 3"]:
    """Return the mean of n n' over unit normals; its trace is one.

    Source: Satake (1982), Fabric tensor in granular materials.
    """
    tensor: np.ndarray = normals.T @ normals / max(len(normals), 1)
    return tensor


def anisotropy(tensors: Float[np.ndarray, "... 3 3"]) -> Float[np.ndarray, "..."]:
    """Return ``sqrt(3/2 D:D)`` of ``D = 15/2 (F - I/3)``: 0 for no preferred direction, 7.5 for one alone.

    Source: Guo & Zhao (2013), The signature of shear-induced anisotropy in granular media.
    """
    deviator = 7.5 * (tensors - np.eye(3) / 3)
    found: np.ndarray = np.sqrt(1.5 * (deviator**2).sum(axis=(-1, -2)))
    return found


def rose(normals: Float[np.ndarray, "contacts 3"], bins: int = 18) -> Float[np.ndarray, " bins"]:
    """Return shares of contacts by the angle of their normal to the horizontal, over what chance would give.

    Normals have no sense: angles go from 0 to 90 degrees. One everywhere means that all directions are alike.
    """
    sines = np.clip(np.abs(normals[:, 2]), 0.0, 1.0)
    edges = np.sin(np.linspace(0, np.pi / 2, bins + 1))
    found = np.histogram(sines, edges)[0] / max(len(normals), 1)
    shares: np.ndarray = found / np.diff(edges)  # directions are uniform in the sine
    return shares
