from __future__ import annotations

import imageio.v3 as imageio
import numpy as np
import pytest

import mbstudio as mb
from mbstudio.scene.pictures import pictures
from mbstudio.scene.pictures.pictures import BlankPictureError, render_tour, require_picture


@pytest.fixture(scope="module")
def project(small_scan_file):
    scan = mb.open_scan(small_scan_file, voxel_size="14 um")
    grains = mb.segment(scan)
    label = grains.interior_labels[0]
    project = mb.Project.new(scan)
    project.change("Find grains", grains=grains)
    project.add_fits({label: mb.fit(grains.grain(label), n=12)})
    return project


def test_every_station_has_its_picture(project, tmp_path):
    written = render_tour(project, tmp_path)
    assert {"scan", "grains", "avatars", "grain_and_avatar"} <= {path.stem for path in written}
    assert sorted(written) == sorted(tmp_path.iterdir())
    for path in written:
        image = imageio.imread(path)[..., :3].astype(float)
        # Something stands beside the left edge that differs from it.
        assert np.abs(image - image[:, :1]).max() > 30, path.name


def test_a_project_without_avatars_has_fewer_pictures(project, tmp_path):
    written = render_tour(mb.Project.new(project.scan), tmp_path)
    assert {path.stem for path in written} & {"grains", "avatars", "grain_and_avatar"} == set()
    assert "scan" in {path.stem for path in written}


def test_a_blank_picture_is_an_error():
    gradient = np.linspace(200, 255, 480).astype(np.uint8)[:, None, None] * np.ones((1, 640, 3), np.uint8)
    for image in (np.zeros((480, 640, 3), np.uint8), gradient):
        with pytest.raises(BlankPictureError, match=r"avatars\.png came out blank"):
            require_picture(image, "avatars.png")


def test_a_blank_picture_is_not_written(project, tmp_path, monkeypatch):
    blank = np.full((960, 1280, 3), 255, np.uint8)
    monkeypatch.setattr(pictures, "_render", lambda draw, size=None: blank)
    with pytest.raises(BlankPictureError):
        render_tour(project, tmp_path)
    assert list(tmp_path.iterdir()) == []
