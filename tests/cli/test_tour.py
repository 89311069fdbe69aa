"""The tour: what a machine without a display shows of the program."""

from __future__ import annotations

import csv
import json

import imageio.v3 as imageio
import numpy as np
import pytest

from mbstudio.cli.tour import prepare_folder
from mbstudio.core.dem import validate
from mbstudio.core.errors import MbstudioError
from mbstudio.core.project import Project


@pytest.fixture(scope="module")
def toured(tmp_path_factory):
    from mbstudio.cli import main

    folder = tmp_path_factory.mktemp("tour") / "out"
    with pytest.raises(SystemExit) as left:
        main(["tour", "--out", str(folder), "-n", "10", "--limit", "2", "--workers", "0"])
    assert not left.value.code
    return folder


def test_the_summary_tells_how_well_it_went(toured):
    summary = json.loads((toured / "summary.json").read_text(encoding="utf-8"))
    assert 60 <= summary["true_grains"] <= 120
    assert summary["foreground_iou"] > 0.9
    assert summary["instance_f1"] > 0.9
    assert summary["fitted"] == summary["valid"] == 2


def test_every_picture_shows_something(toured):
    pictures = list((toured / "pictures").iterdir())
    assert {"scan.png", "grains.png", "avatars.png", "grain_and_avatar.png"} <= {
        path.name for path in pictures
    }
    for path in pictures:
        assert np.asarray(imageio.imread(path), dtype=float).std(axis=1).max() > 3, path.name


def test_the_project_opens_with_its_scan(toured):
    with Project.open(toured / "sample.mbs") as project:
        assert project.scan.shape == (160, 160, 160)
        assert len(project.avatars) == 2
        assert project.grains.labels.shape == (160, 160, 160)


def test_the_factors_are_a_table(toured):
    with (toured / "factors.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 2
    assert all(0 < float(row["grain_sphericity"]) <= 1 for row in rows)


@pytest.mark.parametrize("target", ["stl", "metaball", "liggghts"])
def test_the_dem_files_are_sound(toured, target):
    assert len(validate(toured / target)["items"]) == 2


def test_the_tour_can_be_repeated_in_its_folder(toured):
    (toured / "pictures" / "scan.png").rename(toured / "kept.png")
    with pytest.raises(MbstudioError, match=r"contains other files \(kept\.png\)"):
        prepare_folder(toured)
    (toured / "kept.png").rename(toured / "pictures" / "scan.png")
    prepare_folder(toured)
    assert (toured / "sample.mbs").exists()
