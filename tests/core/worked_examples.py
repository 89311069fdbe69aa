"""What the examples of CONTRIBUTING.md add to the core, used in a copy of mbstudio that has them.

Only tests/test_contributing.py runs this file: mbstudio itself has none of it.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import mbstudio as mb
from mbstudio.cli.app import app
from mbstudio.core.dem import targets, validate
from mbstudio.core.errors import ExportError, ScanError
from mbstudio.core.metrics import FACTORS
from mbstudio.core.populations import measure_population
from mbstudio.core.vae.models.presets import PRESETS
from tests.core.vae.boxes import boxes


@pytest.fixture
def mrc_file(tmp_path):
    """A volume of 3 x 4 x 5 voxels, 20 nm wide, behind 80 bytes of an extended header."""
    words = np.zeros(256, "<i4")
    words[:4] = (5, 4, 3, 1)
    words[7:10] = (5, 4, 3)
    words[10:13] = (np.array([5, 4, 3], "<f4") * 200).view("<i4")  # ångströms
    words[23] = 80
    voxels = np.arange(60, dtype="<i2").reshape(3, 4, 5)
    path = tmp_path / "pores.mrc"
    path.write_bytes(words.tobytes() + bytes(80) + voxels.tobytes())
    return path


def test_a_reader(mrc_file):
    scan = mb.open_scan(mrc_file)
    assert scan.shape == (3, 4, 5)
    assert scan.voxel_size.zyx == pytest.approx((20, 20, 20))
    assert scan.voxel_size.unit == "nm"
    np.testing.assert_array_equal(scan.voxels, np.arange(60).reshape(3, 4, 5))
    other = mrc_file.with_suffix(".xyz")
    other.write_bytes(b"nothing")
    with pytest.raises(ScanError, match=r"\.mrc, \.rec"):
        mb.open_scan(other)
    content = mrc_file.read_bytes()
    mrc_file.write_bytes(content[:-2])
    with pytest.raises(ScanError, match=r"pores\.mrc cannot be read as MRC volume"):
        mb.open_scan(mrc_file)
    mrc_file.write_bytes(content[:12] + b"\x04" + content[13:])
    with pytest.raises(ScanError, match="mode 4"):
        mb.open_scan(mrc_file)


def test_a_target(tmp_path):
    rng = np.random.default_rng(1)
    avatar = mb.Avatar(
        rng.normal(size=(12, 3)) * [0.45, 0.3, 0.2], rng.uniform(0.05, 0.18, 12), "mm", name="g"
    )
    assert "off" in targets()
    mb.export([avatar], "off", tmp_path / "shapes", unit="mm", cells=16)
    assert validate(tmp_path / "shapes")["target"] == "off"
    mesh = trimesh.load_mesh(tmp_path / "shapes" / "g.off")
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(mb.measure(avatar).volume, rel=0.02)
    (tmp_path / "shapes" / "g.off").write_text("OFF\n0 0 0\n")
    with pytest.raises(ExportError, match=r"g\.off"):
        validate(tmp_path / "shapes", digests=False)
    assert "OFF meshes" in CliRunner().invoke(app, ["export", "--targets"]).output


def test_a_factor():
    box = trimesh.creation.box((1, 2, 3))
    assert mb.measure(box, unit="mm").as_dict()["specific_surface"] == pytest.approx(22 / 6)
    table = measure_population([box], unit="mm").table()
    assert table["specific_surface_per_mm"].tolist() == pytest.approx([22 / 6])
    assert FACTORS["specific_surface"].heading("mm") == "Specific surface S_V (mm⁻¹)"


def test_a_preset(tmp_path):
    assert "leading" in PRESETS
    parents = boxes(20, np.random.default_rng(2))
    learner = mb.learn(parents, preset="leading", share=0.5)
    assert 0 < learner.model.dimension < mb.learn(parents, preset="pca").model.dimension
    learner.save(tmp_path / "style")
    again = mb.load_style_learner(tmp_path / "style")
    assert again.model.preset == "leading"
    np.testing.assert_array_equal(
        again.decode(again.latents).centers, learner.decode(learner.latents).centers
    )
    assert len(mb.generate(again, 3, seed=0, measured=False)) == 3
