"""Small populations with known structure, for the tests of the style-learners."""

from __future__ import annotations

import numpy as np

from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization, Template


def make_template(generators: int = 2) -> Template:
    """Sixteen points of two boxes: a symmetric body about 1 across."""
    boxes = np.array([[0.28, 0.22, 0.16], [0.10, 0.17, 0.07], [0.2, 0.05, 0.1]])[:generators]
    centers = (boxes[:, None] * FLIPS).reshape(-1, 3)
    row = np.arange(8 * generators)
    exchange = np.array([8 * (row // 8) + (row % 8 ^ flip) for flip in range(8)])
    return Template(centers, np.full(8 * generators, np.log(0.2 / (8 * generators))), exchange)


def population(
    count: int = 24, *, seed: int = 0, generators: int = 2, ways: int = 4, unit: str = "mm"
) -> Serialization:
    """Avatars that vary from the template in `ways` fixed ways, and in size."""
    template = make_template(generators)
    n = template.n
    shapes = np.random.default_rng(99)
    shifts, weights = shapes.normal(size=(ways, n, 3)), shapes.normal(size=(ways, n))
    rng = np.random.default_rng(seed)
    share = rng.normal(size=(count, ways)) / np.sqrt(ways)
    return Serialization(
        template,
        template.centers + 0.03 * np.einsum("cw,wnx->cnx", share, shifts),
        template.log_weights + 0.05 * share @ weights,
        np.exp(rng.normal(0.0, 0.2, count)),
        unit,
        tuple(f"p{seed}-{i}" for i in range(count)),
        np.full(count, 0.004),
        np.ones(count, dtype=bool),
    )
