from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv

from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.scene.layers.slices import SlicePlanes, cut


@pytest.fixture
def planes():
    rng = np.random.default_rng(3)
    scan = Scan(rng.integers(0, 200, (9, 8, 7), dtype=np.uint8), VoxelSize(2.0, 2.0, 2.0, "um"))
    plotter = pv.Plotter(off_screen=True)
    yield SlicePlanes(plotter, scan, ("red", "green", "blue"))
    plotter.close()


def test_slices_that_are_not_seen_are_laid_into_space_once_they_are(planes):
    labels = np.zeros((9, 8, 7), np.int32)
    labels[2:5, 2:5, 2:5] = 1
    planes.move("z", 3)
    planes.set_labels(LabelVolume(labels), 1)
    assert not planes.images, "nothing is drawn for a layer that is hidden"
    assert (planes.labels["z"] == labels[3]).all(), "but the flat slices have it"
    planes.set_visible(True)
    first = planes.images["z"]
    planes.show("z", False)
    planes.move("z", 6)
    assert planes.images["z"] is first
    planes.show("z", True)
    assert (planes.images["z"] == planes.greys["z"][..., None]).all()
    assert planes._planes["z"].GetBounds()[4:] == (12.0, 12.0)


def test_cuts_lie_in_one_piece(planes):
    volume = np.arange(2 * 3 * 4).reshape(2, 3, 4)
    for axis, expected in (("z", volume[1]), ("y", volume[:, 1]), ("x", volume[:, :, 1])):
        found = cut(volume, axis, 1)
        assert (found == expected).all()
        assert found.flags.c_contiguous
