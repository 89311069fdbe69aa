"""A style-learner of boxes of eight points, quick and with known answers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbstudio.core.vae.models.sampling import Sample
from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization, Template


def eight_points() -> Template:
    """The corners of a box: flip f of corner i is corner i with f's bits turned."""
    exchange = np.array([[i ^ f for i in range(8)] for f in range(8)])
    return Template(FLIPS * [0.26, 0.22, 0.18], np.full(8, np.log(0.025)), exchange)


def boxes(count: int, rng: np.random.Generator, *, unit: str = "mm") -> Serialization:
    """Bodies whose three axes and size differ."""
    template = eight_points()
    axes = np.exp(0.12 * rng.normal(size=(count, 1, 3)))
    return Serialization(
        template,
        template.centers * axes + 0.01 * rng.normal(size=(count, 8, 3)),
        template.log_weights + 0.05 * rng.normal(size=(count, 8)),
        0.4 * np.exp(0.2 * rng.normal(size=count)),
        unit,
        tuple(f"box {i}" for i in range(count)),
        np.zeros(count),
        np.ones(count, bool),
    )


@dataclass(frozen=True)
class BoxLearner:
    """Draws boxes; every so-manieth with its first corner far outside, or with one twice too far."""

    parents: Serialization
    stray_every: int = 0
    loose_every: int = 0

    def sample(self, count: int, seed: int = 0) -> Sample:
        drawn = boxes(count, np.random.default_rng(seed))
        centers = drawn.centers.copy()
        if self.stray_every:
            centers[:: self.stray_every, 0] = 1e6
        if self.loose_every:
            centers[1 :: self.loose_every, 0] *= 2.6
        return Sample(replace(drawn, centers=centers), np.zeros((count, 1)), np.full(count, -1))
