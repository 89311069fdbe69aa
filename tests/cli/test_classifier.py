"""``mbstudio segment --classifier``: what was learned from strokes is used on other scans."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile

import mbstudio as mb
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.units import VoxelSize
from tests.core.grains.classifying.simulated_strokes import paint_slices
from tests.core.grains.degraded import scanned, scattered


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A classifier of one scan, and another scan of the kind."""
    folder = tmp_path_factory.mktemp("classifier")
    truth, other = scattered(0.2, 3, 56), scattered(0.2, 4, 56)
    scan = mb.Scan(scanned(truth, seed=3), VoxelSize(10, 10, 10, "um"))
    mb.VoxelClassifier.learned(scan, paint_slices(truth, 7, borders=0), trees=8).save(folder / "sand.mbclf")
    tifffile.imwrite(folder / "other.tif", scanned(other, seed=4), photometric="minisblack")
    return folder, other


def test_another_scan_is_segmented(mbstudio, files, tmp_path):
    folder, truth = files
    ran = mbstudio(
        "segment", folder / "other.tif", "--voxel-size", "10 um", "--classifier", folder / "sand.mbclf",
        "--smallest", "100", "-o", tmp_path / "a.mbs", "--write-labels", tmp_path / "labels.tif", "--json",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["grains"] > 3
    assert agreement(tifffile.imread(tmp_path / "labels.tif").astype(np.int32), truth).f1 > 0.85
    with mb.Project.open(tmp_path / "a.mbs") as project:
        assert project.state.classifier is not None
        assert project.state.segmentation.by_classifier


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--threshold", "100"), "give one of them"),
        (("--labels", "labels.tif"), "give one of them"),
        (("--dark",), "give one of them"),
    ],
)
def test_a_classifier_and_what_it_replaces_are_refused(mbstudio, files, more, words):
    folder, _ = files
    ran = mbstudio(
        "segment", folder / "other.tif", "--voxel-size", "10 um", "--classifier", folder / "sand.mbclf", *more
    )
    assert ran.code == 1
    assert words in ran.err


def test_a_file_that_is_no_classifier_is_named(mbstudio, files):
    folder, _ = files
    ran = mbstudio(
        "segment", folder / "other.tif", "--voxel-size", "10 um", "--classifier", folder / "other.tif"
    )
    assert ran.code == 1
    assert "other.tif is no classifier" in " ".join(ran.err.split())


@pytest.mark.filterwarnings("always::mbstudio.core.errors.SegmentationWarning")
def test_another_voxel_size_is_told(mbstudio, files):
    folder, _ = files
    ran = mbstudio(
        "segment", folder / "other.tif", "--voxel-size", "14 um", "--classifier", folder / "sand.mbclf",
        "--json",
    )  # fmt: skip
    assert ran.code == 0
    assert "learned at voxels of" in " ".join(ran.err.split())
