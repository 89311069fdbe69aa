"""RAW files that something beside them describes open at once; the window asks where it is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.scan.readers import SUFFIXES
from mbstudio.ui.stations.scan.dialog import ScanDialog

VGI = (
    "{volume1}\n[representation]\nsize = 12 11 10\n[file1]\nSkipHeader = 0\nSize = 12 11 10\nName = s.vol\n"
    "Datatype = unsigned integer\nBitsPerElement = 8\n{volumeprimitive12}\n[geometry]\n"
    "resolution = 0.014 0.014 0.014\nunit = mm\n"
)


@pytest.fixture
def voxels() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (10, 11, 12)).astype(np.uint8)


def test_a_described_volume_opens_without_questions(window, idle, tmp_path: Path, voxels: np.ndarray) -> None:
    (tmp_path / "s.vgi").write_text(VGI)
    (tmp_path / "s.vol").write_bytes(voxels.tobytes())
    for name in ("s.vol", "s.vgi"):
        window.project_files.open_path(tmp_path / name)
        idle()
        assert not window.findChildren(ScanDialog)
        np.testing.assert_array_equal(np.asarray(window.workspace.scan.voxels), voxels)
        assert window.workspace.scan.voxel_size.to("um").x == pytest.approx(14)


def test_where_a_description_is_wrong_the_window_asks(
    window, idle, tmp_path: Path, voxels: np.ndarray
) -> None:
    (tmp_path / "s.vgi").write_text(VGI.replace("12 11 10", "12 11 13"))
    (tmp_path / "s.vol").write_bytes(voxels.tobytes())
    window.project_files.open_path(tmp_path / "s.vol")
    idle()
    (dialog,) = window.findChildren(ScanDialog)
    dialog.size_field.setText("14")
    for field, count in zip(dialog.shape_fields, voxels.shape, strict=True):
        field.setValue(count)
    dialog.type_field.setCurrentText("uint8")
    dialog.open_button.click()
    idle()
    np.testing.assert_array_equal(np.asarray(window.workspace.scan.voxels), voxels)


def test_a_name_that_describes_is_told(window, idle, tmp_path: Path, voxels: np.ndarray) -> None:
    path = tmp_path / "cube_10x10x10_uint8.raw"
    path.write_bytes(voxels[:, :10, :10].tobytes())
    window.stations.scan.work.open(path, "14 um")
    idle()
    assert window.workspace.scan.shape == (10, 10, 10)
    assert window.messages.level == "warning"
    assert "by its name alone" in window.messages.text


def test_the_dialogs_know_the_endings(window, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def answer(*arguments: object) -> tuple[str, str]:
        asked.append(str(arguments[3]))
        return "", ""

    monkeypatch.setattr("PySide6.QtWidgets.QFileDialog.getOpenFileName", answer)
    window.stations.scan.link.ask_scan()
    window.stations.grains.link.ask_labels()
    for ending in (".vgi", ".xtekct", ".pcr", ".txm", ".am", ".raw", ".vol"):
        assert ending in SUFFIXES
        assert all(f"*{ending}" in kinds for kinds in asked)
    assert len(asked) == 2
