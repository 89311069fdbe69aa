"""The libraries of a format are loaded when such a file is opened, and not before."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

LIBRARIES = {"nibabel", "pydicom", "zarr", "numcodecs", "olefile", "vtkmodules", "nrrd", "SimpleITK", "h5py"}


def test_opening_a_scan_loads_no_other_formats_library(tmp_path: Path) -> None:
    np.save(tmp_path / "s.npy", np.ones((3, 4, 5), np.uint8))
    script = (
        "import sys\nfrom mbstudio.core.scan import open_scan\n"
        f"open_scan({str(tmp_path / 's.npy')!r}, '10 um')\nprint(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not LIBRARIES & set(run.stdout.split())
