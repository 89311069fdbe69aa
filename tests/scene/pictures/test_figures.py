"""Figures show what they were given."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.scene.pictures.figures import convergence_figure, slices_figure
from mbstudio.scene.pictures.pictures import BlankPictureError, require_picture
from mbstudio.scene.theme import LIGHT, rgb


def near(image, colour):
    return (np.abs(image.astype(int) - rgb(colour)).max(axis=2) < 30).sum()


def test_slices_are_to_scale_and_outlined(rng):
    grey = rng.integers(0, 255, (10, 40, 40)).astype(np.uint8)
    labels = np.zeros(grey.shape, dtype=np.int32)
    labels[2:8, 10:30, 10:30] = 1
    scan = Scan(grey, VoxelSize(40, 10, 10, "um"))
    plain = slices_figure(scan)
    outlined = slices_figure(scan, SimpleNamespace(labels=labels))
    saturation = lambda image: np.ptp(image.astype(int), axis=2)  # noqa: E731
    assert (saturation(outlined) > 20).sum() > 10 * (saturation(plain) > 20).sum()
    # 10 slices 40 apart are as high as 40 voxels of 10: all three pictures are square.
    grey_rows = (np.abs(plain.astype(int) - 255).max(axis=2) > 100).sum(axis=1)
    assert np.count_nonzero(grey_rows > 300) == pytest.approx(grey_rows.max() / 3, rel=0.12)


def test_the_convergence_figure_shows_the_median_in_the_avatars_colour():
    fits = {n: SimpleNamespace(history=np.geomspace(0.1 * n, 1e-3, 10 + n)) for n in (1, 2, 3)}
    image = convergence_figure(fits)
    assert near(image, LIGHT.avatar) > 500


def test_a_blank_picture_is_an_error():
    gradient = np.repeat(np.linspace(0, 255, 50).astype(np.uint8)[:, None, None], 80, axis=1).repeat(
        3, axis=2
    )
    with pytest.raises(BlankPictureError, match="tour"):
        require_picture(gradient, "tour")
    gradient[20:30, 20:30] = 0
    require_picture(gradient, "tour")
