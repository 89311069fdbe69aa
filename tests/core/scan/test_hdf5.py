"""HDF5 files: the one volume, the named one, or the default; axes by ilastik's tags."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project
from mbstudio.core.scan import open_scan
from mbstudio.core.scan.readers.hdf5 import volume as hdf5


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 250, (5, 7, 11)).astype(np.uint16)


def tags(axes: str) -> str:
    return json.dumps({"axes": [{"key": key, "typeFlags": 2, "resolution": 0} for key in axes]})


@pytest.mark.parametrize("axes", ["zyx", "zyxc", "czyx", "xyz", "tzyxc", "xyzc"])
@pytest.mark.parametrize("packed", [None, "gzip"])
def test_axes_by_ilastiks_tags(
    tmp_path: Path, volume: np.ndarray, axes: str, packed: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = volume.transpose(["zyx".index(key) for key in axes if key in "zyx"])
    stored = stored.reshape([volume.shape["zyx".index(key)] if key in "zyx" else 1 for key in axes])
    with h5py.File(tmp_path / "s.h5", "w") as file:
        data = file.create_dataset("exported_data", data=stored, compression=packed)
        data.attrs["axistags"] = tags(axes)
    scan = open_scan(tmp_path / "s.h5", "10 um")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    assert scan.is_memory_mapped == (packed is None and "xyz" not in axes)
    monkeypatch.setattr(hdf5, "UNPACK_AT_ONCE_BYTES", 0)
    lazy = open_scan(tmp_path / "s.h5", "10 um")
    np.testing.assert_array_equal(lazy.voxels[2], volume[2])
    np.testing.assert_array_equal(np.asarray(lazy.voxels), volume)


def test_probabilities_are_refused(tmp_path: Path, volume: np.ndarray) -> None:
    with h5py.File(tmp_path / "p.h5", "w") as file:
        data = file.create_dataset("exported_data", data=np.stack([volume, volume], -1) / 250)
        data.attrs["axistags"] = tags("zyxc")
    with pytest.raises(ScanError, match="probabilities of classes"):
        open_scan(tmp_path / "p.h5", "10 um")


def test_several_arrays_are_named(tmp_path: Path, volume: np.ndarray) -> None:
    with h5py.File(tmp_path / "s.h5", "w") as file:
        file["entry/raw"], file["entry/filtered"] = volume, volume + 1
        file["entry/theta"] = np.arange(5.0)
    with pytest.raises(ScanError, match=r"2 arrays.*/entry/filtered \(5 x 7 x 11\)"):
        open_scan(tmp_path / "s.h5", "10 um")
    for name in (f"{tmp_path}/s.h5:/entry/filtered", f"{tmp_path}/s.h5/entry/filtered"):
        scan = open_scan(name, "10 um")
        np.testing.assert_array_equal(np.asarray(scan.voxels), volume + 1)
    with pytest.raises(ScanError, match="no array 'entry/none'"):
        open_scan(f"{tmp_path}/s.h5:/entry/none", "10 um")
    project = Project.new(scan)
    project.save(tmp_path / "p.mbs")
    again = Project.open(tmp_path / "p.mbs").scan
    assert again is not None
    np.testing.assert_array_equal(np.asarray(again.voxels), volume + 1)


def test_the_default_of_nexus_with_its_places(tmp_path: Path, volume: np.ndarray) -> None:
    with h5py.File(tmp_path / "s.nxs", "w") as file:
        file.attrs["default"] = "entry"
        data = file.create_group("entry/data")
        file["entry"].attrs["default"] = "data"
        file["entry/raw"] = volume + 1
        data["image"] = volume
        data.attrs["signal"], data.attrs["axes"] = "image", ["z", "y", "x"]
        for axis, count, edge in zip("zyx", volume.shape, (20e-6, 10e-6, 10e-6), strict=True):
            data[axis] = np.arange(count) * edge
            data[axis].attrs["units"] = "m"
    scan = open_scan(tmp_path / "s.nxs")
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    assert scan.voxel_size.to("um").zyx == pytest.approx((20, 10, 10))


@pytest.mark.parametrize(
    ("attributes", "zyx"),
    [({"element_size_um": [2.0, 1.0, 1.0]}, (2, 1, 1)), ({"voxel_size": 0.01, "unit": "mm"}, (10, 10, 10)),
     ({"spacing": [3.0, 2.0, 2.0], "units": b"\xb5m"}, (3, 2, 2))],
)  # fmt: skip
def test_sizes_in_attributes(
    tmp_path: Path, volume: np.ndarray, attributes: dict[str, object], zyx: tuple[float, ...]
) -> None:
    with h5py.File(tmp_path / "s.h5", "w") as file:
        file["data"] = volume
        for name, value in attributes.items():
            file["data"].attrs[name] = np.bytes_(value) if isinstance(value, bytes) else value
    assert open_scan(tmp_path / "s.h5").voxel_size.to("um").zyx == pytest.approx(zyx)


def test_a_size_without_unit_is_asked_about(tmp_path: Path, volume: np.ndarray) -> None:
    with h5py.File(tmp_path / "s.h5", "w") as file:
        file["data"] = volume
        file["data"].attrs["voxel_size"] = 10.0
    with pytest.raises(UnitError, match="without a unit"):
        open_scan(tmp_path / "s.h5")


def test_no_other_file_is_opened(tmp_path: Path, volume: np.ndarray) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = volume
    with h5py.File(tmp_path / "s.h5", "w") as file:
        file["data"] = h5py.ExternalLink("other.h5", "/data")
        layout = h5py.VirtualLayout(volume.shape, volume.dtype)
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "data", volume.shape)
        file.create_virtual_dataset("virtual", layout)
    with pytest.raises(ScanError, match="in another file"):
        open_scan(f"{tmp_path}/s.h5:/data", "10 um")
    with pytest.raises(ScanError, match="lies in other files"):
        open_scan(f"{tmp_path}/s.h5:/virtual", "10 um")


def test_what_is_no_volume(tmp_path: Path, volume: np.ndarray) -> None:
    (tmp_path / "s.h5").write_bytes(b"nothing")
    with pytest.raises(ScanError, match="not an HDF5 file"):
        open_scan(tmp_path / "s.h5", "10 um")
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["table"] = np.zeros((5, 6))
    with pytest.raises(ScanError, match="no array with three axes"):
        open_scan(tmp_path / "t.h5", "10 um")
    with h5py.File(tmp_path / "u.h5", "w") as file:
        file.create_dataset("data", volume.shape, "u2", chunks=True)
    with pytest.raises(ScanError, match="never filled"):
        open_scan(tmp_path / "u.h5", "10 um")


def test_truth_values_are_a_mask(tmp_path: Path) -> None:
    mask = np.zeros((12, 12, 12), bool)
    mask[2:6, 2:6, 2:6] = True
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file["mask"] = mask
    assert load_labels(tmp_path / "m.h5", voxel_size="10 um").table["voxels"].tolist() == [64]
