"""Files that hold several arrays: the window asks which, for scans, labels, and what was moved."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import zarr

from mbstudio.core.scan.readers import names_folder
from mbstudio.ui.widgets.array_dialog import ArrayDialog
from tests.core.scan.readers.test_dicom import write_series
from tests.core.scan.readers.test_ome_zarr import write_image


@pytest.fixture(scope="module")
def grains():
    """A scan, and the labels of its two grains."""
    scan, labels = np.full((12, 14, 16), 20, np.uint8), np.zeros((12, 14, 16), np.uint8)
    labels[2:6, 3:7, 4:8], labels[7:10, 8:12, 9:14] = 1, 2
    scan[labels > 0] = 200
    return scan, labels


@pytest.fixture(scope="module")
def folder(tmp_path_factory, grains):
    """Files of both, written before a test looks which threads there are: zarr's writing keeps some."""
    scan, labels = grains
    folder = tmp_path_factory.mktemp("arrays")
    write_image(folder / "s.ome.zarr", np.stack([scan, 255 - scan]), names="czyx")
    group = zarr.open_group(folder / "l.zarr", mode="w")
    group.create_array("pores", data=labels[::-1])
    group.create_array("grains", data=labels)
    write_series(folder / "series", scan, edges=(0.02, 0.02, 0.02))
    return folder


def choose(window, name):
    (dialog,) = window.findChildren(ArrayDialog)
    names = [dialog.list.item(row).text() for row in range(dialog.list.count())]
    dialog.list.setCurrentRow(names.index(name))
    dialog.open_button.click()
    return names


def test_a_folder_of_ome_zarr_with_channels(window, idle, folder, grains):
    scan, _ = grains
    window.project_files.open_path(folder / "s.ome.zarr")
    idle()
    assert choose(window, "0,c=1") == ["0,c=0", "0,c=1"]
    idle()
    np.testing.assert_array_equal(window.workspace.scan.voxels, 255 - scan)
    assert window.workspace.scan.voxel_size.zyx == (20, 15, 14)
    assert not [dialog for dialog in window.findChildren(ArrayDialog) if dialog.isVisible()]


def test_a_file_of_hdf5_that_was_moved(window, idle, tmp_path, grains):
    scan, _ = grains
    with h5py.File(tmp_path / "s.h5", "w") as file:
        file["raw"], file["filtered"] = scan, scan + 1
    window.stations.scan.work.open(tmp_path / "s.h5", "10 um")
    idle()
    assert choose(window, "/filtered") == ["/filtered", "/raw"]
    idle()
    np.testing.assert_array_equal(window.workspace.scan.voxels, scan + 1)
    (tmp_path / "s.h5").rename(tmp_path / "t.h5")
    window.stations.scan.work.relocate(tmp_path / "t.h5")
    idle()
    choose(window, "/filtered")
    idle()
    assert window.messages.level == "success"
    assert window.workspace.state.scan.path == tmp_path / "t.h5:/filtered"


def test_a_folder_of_dicom_and_labels_of_zarr(window, idle, folder, grains):
    scan, labels = grains
    window.project_files.open_path(folder / "series")
    idle()
    np.testing.assert_array_equal(window.workspace.scan.voxels, scan)
    window.stations.grains.work.load(folder / "l.zarr")
    idle()
    choose(window, "grains")
    idle()
    np.testing.assert_array_equal(window.workspace.state.grains.labels, labels)


def test_which_names_are_folders(tmp_path):
    for name in ("slices", "s.zarr", "s.ome.zarr", "s.zarr:labels/grains", "s.zarr:0,c=1"):
        assert names_folder(tmp_path / name), name
    for name in ("s.tif", "s.h5", "s.h5:/entry/data", "s.vti:grey", "s.zarr.zip", "s.zarr.zip:0", "s.dcm"):
        assert not names_folder(tmp_path / name), name
