"""Avatars built by hand, and the DEM engines that may be there."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest

from mbstudio.core.dem.engines import VARIABLE, find_engine
from mbstudio.core.dem.formats import clump_files
from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.metaball import Avatar


def _make_avatar(seed: int, points: int = 12) -> Avatar:
    rng = np.random.default_rng(seed)
    centers = rng.normal(size=(points, 3)) * [0.45, 0.3, 0.2] + [10, -20, 30]
    weights = rng.uniform(0.3, 0.6, points) ** 2 * 6 / points
    return Avatar(centers, weights, "mm", label=seed, name=f"grain_{seed}")


@pytest.fixture(scope="session")
def avatar() -> Avatar:
    """An irregular avatar of about 2 mm, far from the origin and not along its axes."""
    return _make_avatar(1)


@pytest.fixture(scope="session")
def avatars() -> list[Avatar]:
    """Three irregular avatars."""
    return [_make_avatar(seed) for seed in (1, 2, 3)]


@pytest.fixture(scope="session")
def ring() -> Avatar:
    """A torus-like avatar: not star-shaped, genus 1."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    centers = 3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return Avatar(centers, np.full(12, 0.35), "mm", name="ring")


@pytest.fixture(scope="session", autouse=True)
def _clumps_are_fitted_once() -> Iterator[None]:
    """Nine targets are tested on the same few avatars: the same clump is not fitted anew for each."""
    known: dict[tuple, Clump] = {}

    def fitted(avatar: Avatar, spheres: int = 40, *, seed: int = 0) -> Clump:
        key = (avatar.centers.tobytes(), avatar.weights.tobytes(), avatar.unit, spheres, seed)
        if key not in known:
            known[key] = sphere_clump(avatar, spheres, seed=seed)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clump_files, "sphere_clump", fitted)
        yield


EXPECTED = "MBSTUDIO_EXPECTED_ENGINES"  # set by run.py test: what it has set up


def engine_or_skip(name: str) -> list[str]:
    """Return the command that starts an engine; skip the test by the engine's name without it.

    An engine that the set-up has brought must be there: then its absence is a failure.
    """
    command = find_engine(name)
    if command is None and name in os.environ.get(EXPECTED, "").split(","):
        pytest.fail(f"the DEM engine {name} was set up by run.py test and cannot be found")
    if command is None:
        pytest.skip(f"the DEM engine {name} is not installed (see mbstudio doctor and {VARIABLE})")
    return command


@pytest.fixture(scope="session")
def liggghts() -> str:
    """The LIGGGHTS executable."""
    return engine_or_skip("LIGGGHTS")[0]


@pytest.fixture(scope="session")
def lammps() -> str:
    """The LAMMPS executable."""
    return engine_or_skip("LAMMPS")[0]


@pytest.fixture(scope="session")
def kratos() -> str:
    """An interpreter with Kratos and its DEM application."""
    return engine_or_skip("Kratos")[0]


@pytest.fixture(scope="session")
def peclet() -> str:
    """An interpreter with peclet-dem."""
    return engine_or_skip("peclet-dem")[0]


@pytest.fixture(scope="session")
def yade() -> str:
    """The Yade executable."""
    return engine_or_skip("Yade")[0]
