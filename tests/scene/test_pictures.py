from __future__ import annotations

import imageio.v3 as imageio
import numpy as np
import pytest

import mbstudio as mb
from mbstudio.scene import pictures
from mbstudio.scene.pictures import BlankPictureError, render_tour, require_picture


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
    assert [path.name for path in written] == [
        "scan.png",
        "grains.png",
        "avatars.png",
        "grain_and_avatar.png",
    ]
    assert written == [tmp_path / path.name for path in written]
    for path in written:
        image = imageio.imread(path)
        assert image.shape == (*pictures.SIZE[::-1], 3)
        # Something stands in the middle of the picture that differs from its left edge.
        middle = image[image.shape[0] // 4 : -image.shape[0] // 4].astype(float)
        assert np.abs(middle - middle[:, :1]).max() > 30


def test_a_project_without_avatars_has_fewer_pictures(project, tmp_path):
    early = mb.Project.new(project.scan)
    assert [path.name for path in render_tour(early, tmp_path)] == ["scan.png"]


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
