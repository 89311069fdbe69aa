"""Grains of few control points, and packings that others made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metaball import Avatar
from mbstudio.core.packing.grain_kinds import GrainKinds, prepare_kinds
from mbstudio.core.packing.packer import pack
from mbstudio.core.packing.packing import Packing


def sphere(diameter: float = 1.0, unit: str = "mm") -> Avatar:
    return Avatar(np.zeros((1, 3)), np.array([diameter**2 / 4]), unit, name="ball")


def irregular(seed: int) -> Avatar:
    rng = np.random.default_rng(seed)
    centers = rng.normal(size=(8, 3)) * [0.35, 0.25, 0.2] + [5, -3, 2]
    return Avatar(centers, rng.uniform(0.3, 0.6, 8) ** 2 * 6 / 8, "mm", label=seed, name=f"grain_{seed}")


@pytest.fixture(scope="session")
def grains() -> list[Avatar]:
    return [irregular(seed) for seed in (1, 2, 3)]


@pytest.fixture(scope="session")
def kinds(grains: list[Avatar]) -> GrainKinds:
    return prepare_kinds(grains, spheres=6, processes=1)


@pytest.fixture(scope="session")
def settled(kinds: GrainKinds) -> Packing:
    """Twenty small clumps at rest."""
    return pack(kinds, 20, seed=4)


@pytest.fixture(scope="session")
def balls() -> GrainKinds:
    return prepare_kinds([sphere()])
