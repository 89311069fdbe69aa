"""Scans and labels of the formats that laboratories have, from the command line."""

from __future__ import annotations

import json

import nibabel
import numpy as np
import pytest
import tifffile

from tests.core.scan.readers.test_dicom import write_series
from tests.core.scan.readers.test_ome_zarr import scaled, write_image
from tests.core.scan.readers.test_vtk_image import write as write_vti


@pytest.fixture(scope="module")
def scans(small_scan_file, tmp_path_factory):
    """One scan with voxels of 14 um in several formats."""
    folder, voxels = tmp_path_factory.mktemp("scans"), tifffile.imread(small_scan_file)
    write_image(folder / "s.ome.zarr", voxels, place=[scaled(14, 14, 14)], chunks=(32, 32, 32))
    write_series(folder / "dicom", voxels, edges=(0.014, 0.014, 0.014))
    write_vti(folder / "s.vti", {"grey": voxels, "square": voxels // 2})
    image = nibabel.Nifti1Image(voxels.T, np.diag([14.0, 14.0, 14.0, 1.0]))
    image.header.set_xyzt_units("micron")
    nibabel.save(image, folder / "s.nii.gz")
    return folder


@pytest.mark.parametrize(
    ("name", "options"),
    [("s.ome.zarr", ()), ("dicom", ()), ("dicom/IM007.dcm", ()), ("s.nii.gz", ()),
     ("s.vti:grey", ("--voxel-size", "14 um"))],
)  # fmt: skip
def test_segment(mbstudio, scans, name, options):
    ran = mbstudio("segment", scans / name, *options, "--json")
    assert ran.code == 0, ran.err
    result = json.loads(ran.out)
    assert (result["grains"], result["interior"]) == (4, 3)
    factor = {"um": 1, "mm": 1000}[result["unit"]]
    # Between the third and the second largest ellipsoid, which are whole.
    median = 14 * ((12 * 10 * 9) ** (1 / 3) + (8 * 11 * 9) ** (1 / 3))
    assert result["median_dn"] * factor == pytest.approx(median, rel=0.01)


def test_labels_go_out_and_in_as_ome_zarr(mbstudio, scans, tmp_path):
    out = tmp_path / "labels.ome.zarr"
    assert mbstudio("segment", scans / "s.ome.zarr", "--write-labels", out, "--json").code == 0
    for source in (scans / "s.ome.zarr", scans / "dicom"):
        ran = mbstudio("segment", source, "--labels", out, "--json")
        assert ran.code == 0, ran.err
        assert json.loads(ran.out)["grains"] == 4


@pytest.mark.parametrize(
    ("name", "told"),
    [("s.vti", "s.vti holds 2 arrays"), ("s.vti:none", "no array 'none'"), ("s.ome.zarr:1", "no array '1'"),
     ("s.ome.zarr:c=1", "no axis 'c'")],
)  # fmt: skip
def test_a_refusal_is_one_line_that_names_the_file(mbstudio, scans, name, told):
    ran = mbstudio("segment", scans / name, "--voxel-size", "14 um")
    assert ran.code != 0
    (line,) = ran.err.strip().splitlines()
    assert line.startswith("mbstudio: ")
    assert told in line
