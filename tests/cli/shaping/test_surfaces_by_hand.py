"""``mbstudio latent`` on a style of surfaces: each operation from a saved style to files."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import trimesh

from mbstudio.core.cloning.surface_style_file import save_surface_style
from tests.core.cloning.stone_styles import fitted_stones


@pytest.fixture(scope="module")
def style(tmp_path_factory):
    folder = tmp_path_factory.mktemp("surfaces") / "style"
    save_surface_style(fitted_stones(), folder)
    return folder


def test_a_style_of_surfaces_is_described(mbstudio, style):
    ran = mbstudio("latent", style, "--json")
    assert ran.code == 0, ran.err
    told = json.loads(ran.out)
    assert (told["preset"], told["parents"]) == ("surfaces", 4)
    assert {row["meaning"] for row in told["meanings"]} >= {"size", "csf", "convexity", "roughness"}


def test_a_designed_grain_has_what_was_asked_for(mbstudio, style, tmp_path):
    out = tmp_path / "a"
    ran = mbstudio("latent", style, "--design", "csf=0.6", "--design", "sphericity=0.85", "-o", out, "--json")
    assert ran.code == 0, ran.err
    (row,) = json.loads(ran.out)["table"]
    assert row["csf"] == pytest.approx(0.6, rel=1e-6)
    mesh = trimesh.load(out / "design_1.ply")
    assert np.cbrt(36 * np.pi * mesh.volume**2) / mesh.area == pytest.approx(0.85, rel=0.005)
    assert (out / "design_1.json").is_file(), "the metaball beside it"
    table = pd.read_csv(out / "clones.csv")
    assert table["name"].tolist() == ["design_1"]
    # What was made is taken up again, and moved from there.
    shape = f"{out / 'shapes.json'}:design_1"
    ran = mbstudio("latent", style, "--move", shape, "--by", "csf=-0.5", "-o", tmp_path / "b", "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["table"][0]["csf"] < 0.6


@pytest.mark.parametrize(
    ("operation", "names"),
    [
        (("--interpolate", "1", "stone 2", "--steps", "3"), ["steps_1", "steps_2", "steps_3"]),
        (("--blend", "1=0.5", "--blend", "3=0.5"), ["blend_1"]),
        (("--noise", "2", "--count", "2", "--sigma", "0.2"), ["variation_1", "variation_2"]),
        (("--add", "2", "1", "3", "--strength", "0.3"), ["sum_1"]),
        (("--take", "4"), ["grain_1"]),
    ],
)
def test_operations_write_surfaces_and_metaballs(mbstudio, style, tmp_path, operation, names):
    ran = mbstudio("latent", style, *operation, "-o", tmp_path / "out", "--json")
    assert ran.code == 0, ran.err
    assert [row["name"] for row in json.loads(ran.out)["table"]] == names
    factors = pd.read_csv(tmp_path / "out" / "factors.csv")
    for name, volume in zip(names, factors["volume_mm3"], strict=True):
        mesh = trimesh.load(tmp_path / "out" / f"{name}.ply")
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(volume, rel=1e-4)
        assert (tmp_path / "out" / f"{name}.json").is_file()


@pytest.mark.parametrize(
    ("operation", "told"),
    [
        (("--design", "sphericity=0.99", "--design", "csf=0.4"), "the most spherical body of csf 0.4 has"),
        (("--move", "1"), "--move needs a distance"),
        (("--move", "1", "--by", "colour=1"), "no factor of shape"),
        (("--blend", "1=1"), "A blend of surfaces is of two grains"),
        (("--interpolate", "1", "1"), "of the same parent"),
        (("--take", "stone 9"), "The style has no parent 'stone 9'"),
        (("--take", "gone.json:one"), "cannot be read"),
    ],
)
def test_what_surfaces_cannot_be_asked_is_told(mbstudio, style, tmp_path, operation, told):
    ran = mbstudio("latent", style, *operation, "-o", tmp_path / "out")
    assert ran.code == 1
    assert told in ran.err
    assert not (tmp_path / "out").exists()


def test_grains_go_into_another_folder_than_the_style(mbstudio, style):
    ran = mbstudio("latent", style, "--take", "1", "-o", style)
    assert ran.code == 1
    assert "choose another folder" in ran.err
    ran = mbstudio("latent", style, "--take", "1")
    assert "give -o FOLDER" in ran.err
