"""Avatars with numbers at the edge pass project, tables, serialization, pictures and export, or are refused.

A refusal is one line that names the avatar; what is kept is kept to the last bit. What is measured of such
bodies is in tests/core/metaball/test_edge_numbers.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.dem import export
from mbstudio.core.dem.exporting import validate
from mbstudio.core.errors import AvatarError, MbstudioError
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.metaball import Avatar
from mbstudio.core.populations import measure_population
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.vae.serialize.serializer import serialize
from mbstudio.scene.surfaces import avatar_surface
from tests.core.project.conftest import ANISOTROPIC, make_fit

CENTERS = np.random.default_rng(3).normal(size=(6, 3)) * 0.3
WEIGHTS = np.random.default_rng(4).uniform(0.02, 0.1, 6)


def avatar(centers: object, weights: object) -> Avatar:
    return Avatar(np.asarray(centers, float), np.asarray(weights, float), "mm", label=2, name="pebble")


BODIES = {
    "points 1e9 apart": avatar([[0, 0, 0], [1e9, 0, 0]], [0.05, 0.05]),
    "bodies 1e4 apart": avatar([[0, 0, 0], [0.1, 0, 0], [1e4, 0, 0], [1e4 + 0.1, 0, 0]], [0.05] * 4),
    "very small": avatar(CENTERS * 1e-25, WEIGHTS * 1e-50),
    "very large": avatar(CENTERS * 1e25, WEIGHTS * 1e50),
}


def _through_a_project(body: Avatar, folder: Path) -> None:
    labels = np.zeros((6, 9, 10), np.int32)
    labels[1:4, 1:4, 1:5], labels[2:5, 5:8, 5:9] = 1, 2
    grains = build_grain_set(labels, ANISOTROPIC, (0.0, 0.0, 0.0))
    fit = replace(make_fit(2, 2, np.random.default_rng(1)), avatar=body)
    project = Project(ProjectState(grains=grains).with_fits({2: fit}))
    project.save(folder / "pebble.mbs")
    project.close()
    again = Project.open(folder / "pebble.mbs")
    kept = again.fits[2].avatar
    again.close()
    np.testing.assert_array_equal(kept.centers, body.centers)
    np.testing.assert_array_equal(kept.weights, body.weights)


def _serialized(body: Avatar, _: Path) -> None:
    assert np.isfinite(serialize([body, *[avatar(CENTERS, WEIGHTS)] * 5], 8).centers).all()


def _pictured(body: Avatar, _: Path) -> None:
    points = np.asarray(avatar_surface(body).points)
    assert len(points) > 100
    assert np.isfinite(points).all()


def _in_a_table(body: Avatar, _: Path) -> None:
    row = measure_population([body]).table().iloc[0]
    assert np.isfinite(row["volume_mm3"]) or row["not_measured"]


def _exported(body: Avatar, folder: Path) -> None:
    for target in ("metaball", "stl", "comflusom"):
        export([body], target, folder / target, density=2650.0)
        validate(folder / target, digests=True)


WAYS = {
    "project": _through_a_project,
    "serialization": _serialized,
    "picture": _pictured,
    "table": _in_a_table,
    "export": _exported,
}


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("way", WAYS.values(), ids=list(WAYS))
@pytest.mark.parametrize("body", BODIES.values(), ids=list(BODIES))
def test_edge_numbers_pass_or_are_refused_by_name(
    body: Avatar, way: Callable[[Avatar, Path], None], tmp_path: Path
) -> None:
    try:
        way(body, tmp_path)
    except MbstudioError as error:
        assert "pebble" in str(error)  # noqa: PT017 - a refusal is one of two right answers
        assert "\n" not in str(error)  # noqa: PT017


@pytest.mark.parametrize("body", BODIES.values(), ids=list(BODIES))
def test_a_project_keeps_them_all(body: Avatar, tmp_path: Path) -> None:
    _through_a_project(body, tmp_path)


@pytest.mark.parametrize("weights", [[1e-300] * 6, [1e300] * 6, [1e-300, 1e300, 0.1, 0.1, 0.1, 0.1]])
def test_numbers_beyond_all_lengths_are_no_avatar(weights: list[float]) -> None:
    with pytest.raises(AvatarError, match=r"'pebble'.*Check the unit"):
        avatar(CENTERS * (1e-155 if max(weights) < 1e-200 else 1), weights)
