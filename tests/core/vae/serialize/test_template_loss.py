"""What a template takes from grains is measured against the grains themselves."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from mbstudio.core.vae.serialize.serializer import serialize
from mbstudio.core.vae.serialize.template_loss import measure_loss
from tests.core.cloning.conftest import make_stone


def test_the_loss_is_that_of_the_bodies_themselves():
    stones = [make_stone(seed, 2) for seed in range(5)]
    serialized = serialize(stones, 8, seed=0)
    loss = measure_loss(stones, serialized)
    made = [avatar.mesh(cells=96) for avatar in serialized.avatars()]
    volumes = [b.volume / a.volume - 1 for a, b in zip(stones, made, strict=True)]
    convexities = [
        b.volume / b.convex_hull.volume - a.volume / a.convex_hull.volume
        for a, b in zip(stones, made, strict=True)
    ]
    assert loss.grains == 5
    assert loss.volume == pytest.approx(np.mean(volumes), abs=1e-6)
    assert loss.convexity == pytest.approx(np.mean(convexities), abs=1e-6)


def test_few_bodies_stand_for_many():
    stones = [make_stone(seed, 2) for seed in range(5)]
    serialized = serialize(stones, 8, seed=0)
    assert measure_loss(stones * 10, _repeated(serialized, 10)).grains == 24


def _repeated(serialized, times):
    return replace(
        serialized,
        **{
            field.name: np.concatenate([getattr(serialized, field.name)] * times)
            for field in fields(serialized)
            if isinstance(getattr(serialized, field.name), np.ndarray)
        },
        names=tuple(f"{name} {k}" for k in range(times) for name in serialized.names),
    )
