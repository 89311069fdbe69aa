"""A small project made by hand: every field holds something other than its default."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import tifffile

from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.validity import Verdict
from mbstudio.core.project import FitSettings, ProjectState
from mbstudio.core.scan import open_scan
from mbstudio.core.units import VoxelSize

ANISOTROPIC = VoxelSize(20.0, 14.0, 14.5, "um")


def make_fit(label: int, n: int, rng: np.random.Generator) -> FitResult:
    avatar = Avatar(rng.normal(size=(n, 3)), rng.uniform(1, 2, n), "um", label=label, name=f"Korn {label} µ")
    verdict = Verdict(
        valid=False,
        pieces=2,
        voids=1,
        genus=None if label % 2 else 3,
        points_outside=4,
        volume_error=-0.07,
        rms=1.25,
        reasons=("2 pieces: fit with more control points", "a void"),
        smallest_neck=None if label % 2 else 0.375,
        warnings=("a cavity was filled",),
    )
    return FitResult(
        avatar=avatar,
        history=rng.uniform(size=n + 2),
        rms_history=rng.uniform(size=n),
        verdict=verdict,
        method="paper",
        n=n + 1,
        seed=17,
        options={"learning_rate": 0.1 + label / 3, "hull": "voxels", "common_factor": False},
        target="iou 0.97 and volume 1 %",
        reached={"iou": 0.9 + label / 100, "volume": 0.07},
    )


@pytest.fixture
def grains() -> GrainSet:
    labels = np.zeros((4, 5, 6), np.int32)
    labels[1:3, 1:3, 1:3] = 2
    labels[3, 4, 5] = 7
    table = pd.DataFrame(
        {
            "label": [2, 7],
            "voxels": [8, 1],
            "volume": [8 * 4060.0, 4060.0],
            "touches_border": [False, True],
            "kind": ["sand", "Glimmer µ"],
        }
    )
    return GrainSet(labels, table, ANISOTROPIC, (1.0, 2.0, 3.0))


@pytest.fixture
def state(grains, rng) -> ProjectState:
    fits = {7: make_fit(7, 3, rng), 2: make_fit(2, 5, rng)}
    return ProjectState(
        grains=grains, fit_settings=FitSettings(25, "paper", 4, {"momentum": 0.1, "unit": "voxel"}, "csf 2 %")
    ).with_fits(fits)


@pytest.fixture
def scan(tmp_path, rng):
    path = tmp_path / "scan.tif"
    tifffile.imwrite(path, rng.integers(0, 60000, (4, 5, 6), dtype=np.uint16), photometric="minisblack")
    return open_scan(path, ANISOTROPIC)
