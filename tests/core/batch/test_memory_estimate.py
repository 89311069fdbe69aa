"""The estimate of a segmentation's memory is near to what one takes, and above it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.batch import memory_estimate
from mbstudio.core.batch.memory_estimate import MemoryNeed, need_of_segmentation, segmentation_bytes
from mbstudio.core.scan import Scan
from mbstudio.core.scan.slice_stack import SliceStack
from mbstudio.core.units import VoxelSize

BENCHMARK = Path(__file__).parents[3] / "benchmarks" / "memory.py"


@pytest.mark.skipif(sys.platform != "linux", reason="the benchmark reads /proc")
def test_a_segmentation_takes_what_was_estimated(tmp_path: Path) -> None:
    """Peak of a process of its own, as in the benchmark; the mapped file counts in it."""
    shape, kind = (130, 130, 130), np.dtype("float32")
    grey = np.tile(np.random.default_rng(0).normal(60, 8, (10, 130, 130)), (13, 1, 1))
    z, y, x = np.indices(shape) % 26
    grey[(z - 13) ** 2 + (y - 13) ** 2 + (x - 13) ** 2 < 100] += 120
    grey[:, :2] = np.nan
    np.save(tmp_path / "scan.npy", grey.clip(0, 255).astype(kind))
    told = subprocess.run(
        [sys.executable, BENCHMARK, "--child", tmp_path / "scan.npy"],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    found = json.loads(told.stdout.splitlines()[-1])
    assert found["grains"] == 125
    estimate = segmentation_bytes(shape, kind)
    mapped = grey.size * kind.itemsize
    assert 0.25 * estimate < found["bytes"] < estimate + mapped


def test_what_is_yet_to_be_read_or_copied_counts() -> None:
    shape = (100, 100, 100)
    plain = segmentation_bytes(shape, np.dtype("u2"))
    assert segmentation_bytes(shape, np.dtype("u2"), in_memory=False) == plain + 2e6
    # Impulses are replaced in a copy.
    assert segmentation_bytes(shape, np.dtype("f4")) == plain + 2e6
    assert segmentation_bytes(shape, np.dtype("u1")) == plain - 1e6
    # More voxels than four bytes can number.
    assert segmentation_bytes((2000, 2000, 2000), np.dtype("u1")) > 4.4 * segmentation_bytes(
        (500, 2000, 2000), np.dtype("u1")
    )


@pytest.mark.parametrize(
    ("free", "fits", "worth_telling"),
    [(None, True, False), (10**10, True, False), (300_000_000, True, True), (10_000_000, False, True)],
)
def test_what_is_needed_is_held_against_what_is_free(
    monkeypatch: pytest.MonkeyPatch, free: int | None, fits: bool, worth_telling: bool
) -> None:
    monkeypatch.setattr(memory_estimate, "free_memory", lambda: free)
    voxels = np.zeros((100, 100, 100), np.uint8)
    size = VoxelSize(1, 1, 1, "um")
    need = need_of_segmentation(Scan(voxels, size))
    assert (need.fits, need.is_worth_telling, need.free) == (fits, worth_telling, free)
    lazy = SliceStack(lambda index: voxels[index], voxels.shape, voxels.dtype)
    assert need_of_segmentation(Scan(lazy, size)).needed == need.needed + voxels.nbytes


def test_the_words() -> None:
    assert MemoryNeed(14_200_000_000, 9_040_000_000).describe() == ("about 14 GB of memory, 9.0 GB are free")
    assert MemoryNeed(448_000_000, None).describe() == "about 448 MB of memory"
