"""The disk is full while something is written: what was there stays, the message names it, no litter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mbstudio.cli.measuring import write_csv
from mbstudio.core.dem import export, targets
from mbstudio.core.grains.label_writing import write_label_image
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.imaging.sweep import SweepRow, write_sweep
from mbstudio.core.metaball import Avatar
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.units import VoxelSize
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.serialize.serialization import save_serialization
from tests.core.vae.populations import population
from tests.full_disk import POSSIBLE, require_nothing_is_lost

pytestmark = [
    pytest.mark.skipif(not POSSIBLE, reason="the size of files is limited as on Linux"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of libraries that cannot end their files
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def _grains():
    labels = np.zeros((20, 24, 28), np.int32)
    rng = np.random.default_rng(1)
    labels[2:18, 2:20, 2:26] = rng.integers(1, 4, (16, 18, 24))
    return build_grain_set(labels, VoxelSize(10, 10, 10, "um"), (0.0, 0.0, 0.0))


def _table(path: Path) -> None:
    write_csv(path, pd.DataFrame({"label": range(400), "csf": np.linspace(0, 1, 400)}))


def _sweep(path: Path) -> None:
    row = SweepRow(
        1, "grain 1", 10, "fast", 0, 0.1, 0.02, 0.01, 0.9, 0.1, {"csf": 0.01}, True, 2.0, "", {"hull": "mesh"}
    )
    write_sweep(path, [row] * 60)


def _project(path: Path) -> None:
    project = Project(ProjectState(grains=_grains()))
    try:
        project.save(path)
    finally:
        project.close()


WRITERS: dict[str, Callable[[Path], object]] = {
    "table.csv": _table,
    "sweep.csv": _sweep,
    "avatars.npz": lambda path: save_serialization(population(12), path),
    "sand.mbs": _project,
    **{
        f"labels.{ending}": lambda path: write_label_image(path, _grains())
        for ending in ("tif", "nrrd", "mha", "mhd", "zarr")
    },
}


@pytest.mark.parametrize("name", WRITERS)
def test_files_are_whole_or_as_they_were(tmp_path: Path, name: str) -> None:
    require_nothing_is_lost(tmp_path, name, WRITERS[name])


def test_a_style_is_whole_or_as_it_was(tmp_path: Path) -> None:
    learners = [learn(population(count), "pca") for count in (12, 13)]
    turn = iter(range(100))
    require_nothing_is_lost(tmp_path, "style", lambda path: learners[next(turn) % 2].save(path))


@pytest.mark.parametrize("target", list(targets()))
def test_exports_are_whole_or_as_they_were(tmp_path: Path, target: str) -> None:
    rng = np.random.default_rng(3)
    avatar = Avatar(rng.normal(size=(6, 3)) * 0.3, rng.uniform(0.1, 0.2, 6), "mm", label=3, name="pebble")
    require_nothing_is_lost(
        tmp_path,
        "out",
        lambda path: export([avatar], target, path, density=2650.0, overwrite=True),
        ("over",),
    )
