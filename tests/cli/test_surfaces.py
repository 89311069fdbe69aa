"""``learn --preset surfaces`` and ``generate`` with what it wrote: from meshes to surfaces and metaballs."""

from __future__ import annotations

import json

import pandas as pd
import pytest
import trimesh

from mbstudio.core.cloning.surface_style import learn_surfaces
from mbstudio.core.cloning.surface_style_file import save_surface_style
from mbstudio.core.dem.formats.metaball import read_metaball
from tests.core.cloning.conftest import make_stone


@pytest.fixture
def stones(tmp_path):
    folder = tmp_path / "stones"
    folder.mkdir()
    for seed in range(4):
        make_stone(seed).export(folder / f"stone{seed}.ply")
    return folder


def test_surfaces_are_learned_and_generated(mbstudio, stones, tmp_path):
    style, clones, again = (tmp_path / name for name in ("style", "clones", "again"))
    ran = mbstudio("learn", stones, "--unit", "mm", "--preset", "surfaces", "-n", 12, "-o", style, "--json")
    assert ran.code == 0, ran.err
    told = json.loads(ran.out)
    assert (told["parents"], told["control_points"]) == (4, 12)
    ran = mbstudio("generate", style, "--count", 3, "-o", clones, "--seed", 4, "--workers", 1, "--json")
    assert ran.code == 0, ran.err
    told = json.loads(ran.out)
    assert told["clones"] == told["candidates"] == 3
    meshes = [trimesh.load(clones / f"clone_{i}.ply") for i in (1, 2, 3)]
    factors, table = pd.read_csv(clones / "factors.csv"), pd.read_csv(clones / "clones.csv")
    assert factors["volume_mm3"].to_numpy() == pytest.approx([mesh.volume for mesh in meshes], rel=1e-4)
    assert set(table["parent"]) <= {f"stone{seed}" for seed in range(4)}
    avatar = read_metaball(clones / "clone_2.json")
    assert avatar.n == 12
    assert avatar.mesh(cells=64).volume == pytest.approx(meshes[1].volume, rel=0.02)
    ran = mbstudio("generate", style, "--count", 2, "-o", again, "--seed", 4, "--workers", 2, "--unit", "um")
    assert ran.code == 0, ran.err
    assert trimesh.load(again / "clone_2.ply").volume == pytest.approx(1e9 * meshes[1].volume, rel=1e-5)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("learn", "stones", "--preset", "surfaces", "--on", "style", "-o", "other"),
            "do not apply to preset",
        ),
        (("learn", "stones", "--preset", "surfaces", "-o", "other"), "carries no length unit"),
        (("generate", "style", "-o", "clones", "--report", "r.html"), "mbstudio judge"),
        (("generate", "style", "-o", "style"), "choose another folder"),
        (("generate", "style", "-o", "clones"), "holds no avatars of its parents"),
    ],
)
def test_what_surfaces_cannot_do_is_told(mbstudio, stones, tmp_path, monkeypatch, words, told):
    monkeypatch.chdir(tmp_path)
    save_surface_style(learn_surfaces([make_stone(0, 2), make_stone(1, 2)]), tmp_path / "style")
    ran = mbstudio(*words)
    assert ran.code == 1
    assert told in ran.err
    assert not (tmp_path / "clones").exists()


def test_of_many_grains_some_become_parents(mbstudio, stones, tmp_path, monkeypatch):
    monkeypatch.setattr("mbstudio.core.cloning.parent_choice.ENOUGH_PARENTS", 3)
    words = ("learn", stones, "--unit", "mm", "--preset", "surfaces", "-n", 8, "--json", "-o")
    ran = mbstudio(*words, tmp_path / "some")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["parents"] == 3
    assert "3 of 4 grains become parents" in ran.err
    assert "--limit 4" in ran.err
    ran = mbstudio(*words, tmp_path / "all", "--limit", 4)
    assert json.loads(ran.out)["parents"] == 4
