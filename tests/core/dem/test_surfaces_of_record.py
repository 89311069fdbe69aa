"""Mesh targets take the surface of record, metaball targets the avatar; the manifest says how they differ."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.cloning.surface_generation import SurfaceGeneration, generate_surfaces
from mbstudio.core.dem import export
from mbstudio.core.errors import ExportError
from tests.core.cloning.stone_styles import fitted_stones


@pytest.fixture(scope="module")
def clones() -> SurfaceGeneration:
    return generate_surfaces(fitted_stones(), 2, seed=1)


def test_a_mesh_target_writes_the_surface_itself(tmp_path, clones):
    report = export(
        clones.avatars(), "ply", tmp_path, names=clones.names, unit="mm", surfaces=clones.meshes()
    )
    for clone, item in zip(clones.clones, report.items, strict=True):
        written = trimesh.load(tmp_path / f"{clone.name}.ply", process=False)
        assert len(written.faces) == len(clone.surface.faces)
        assert item["volume"] == pytest.approx(clone.mesh().volume, rel=1e-9)
        assert written.volume == pytest.approx(clone.mesh().volume, rel=1e-5)
        np.testing.assert_allclose(written.center_mass, 0, atol=1e-4)
        told = item["details"]["surface_of_record"]
        assert told["taken"] is True
        assert told["metaball_volume_error"] == pytest.approx(clone.fitted.volume_error, abs=0.01)
        assert 0 < told["metaball_rms_over_Dn"] < told["metaball_largest_over_Dn"] < 0.2


@pytest.mark.parametrize("target", ["metaball", "liggghts"])
def test_other_targets_take_the_metaball_and_say_how_it_differs(tmp_path, clones, target):
    options = {"spheres": 8} if target == "liggghts" else {}
    report = export(
        clones.avatars(), target, tmp_path, names=clones.names, unit="mm", surfaces=clones.meshes(),
        density=2650.0, **options,
    )  # fmt: skip
    alone = export(clones.avatars()[:1], "metaball", tmp_path / "alone", unit="mm").items[0]
    told = report.items[0]["details"]["surface_of_record"]
    assert told["taken"] is False
    assert report.items[0]["volume"] == pytest.approx(alone["volume"], rel=1e-9)
    assert alone["volume"] / told["volume"] - 1 == pytest.approx(told["metaball_volume_error"], abs=1e-9)
    assert "surface_of_record" not in alone["details"]


def test_the_difference_is_in_the_unit_of_the_files(tmp_path, clones):
    item = export(clones.avatars(), "ply", tmp_path, unit="m", surfaces=clones.meshes()).items[0]
    volume = item["details"]["surface_of_record"]["volume"]
    assert volume == pytest.approx(1e-9 * clones.clones[0].mesh().volume)
    assert item["volume"] == pytest.approx(volume)


def test_one_surface_for_each_avatar(tmp_path, clones):
    with pytest.raises(ExportError, match="1 surfaces were given for 2 avatars"):
        export(clones.avatars(), "ply", tmp_path / "none", surfaces=clones.meshes()[:1])
    assert not (tmp_path / "none").exists()
