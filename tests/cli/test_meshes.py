"""Meshes on the command line: files, folders and patterns, with the same words in every command."""

from __future__ import annotations

import json

import pytest
import trimesh

from mbstudio.core.project import Project

RADII = (1.0, 1.3, 0.9)


@pytest.fixture
def stones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "stones"
    folder.mkdir()
    for number, radius in enumerate(RADII):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
        ball.vertices *= (1, 1.2, 0.8)
        ball.export(folder / f"s{number}.{('ply', 'stl', 'obj')[number]}")
    return folder


@pytest.fixture
def broken(stones):
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.update_faces(list(range(2, len(ball.faces))))
    ball.export(stones / "broken.ply")
    return stones / "broken.ply"


def test_measure_many_meshes(mbstudio, stones, broken):
    for given in ((stones,), (f"{stones}/*",), tuple(sorted(stones.iterdir()))):
        ran = mbstudio("measure", *given, "--unit", "mm", "--json", "--csv", "a.csv")
        assert ran.code == 0, ran.err
        found = json.loads(ran.out)
        assert [body["name"] for body in found["bodies"]] == ["s0.ply", "s1.stl", "s2.obj"]
        ball = trimesh.creation.icosphere(subdivisions=3)
        for body, radius in zip(found["bodies"], RADII, strict=True):
            assert body["volume"] == pytest.approx(0.96 * ball.volume * radius**3, rel=1e-5)
        assert "left out" in ran.err
        assert "broken.ply is not closed" in ran.err
    ran = mbstudio("measure", stones, "--unit", "mm")
    assert "3 bodies of 4 meshes" in ran.out
    assert "s1.stl" in ran.out


def test_fit_many_meshes_into_one_project(mbstudio, stones, broken):
    ran = mbstudio("fit", stones, "--unit", "mm", "--resolution", 20, "-n", 5, "--workers", 0, "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["names"] == {"1": "s0", "2": "s1", "3": "s2"}
    assert "broken.ply is not closed" in ran.err
    project = Project.open("stones.mbs")
    assert len(project.fits) == 3
    ran = mbstudio("fit", "stones.mbs", "-n", 6, "--workers", 0)
    assert ran.code == 0
    assert "s1" in ran.out


def test_sweep_many_meshes(mbstudio, stones):
    ran = mbstudio("sweep", f"{stones}/s[01].*", "--unit", "mm", "--resolution", 16, "-n", "2,3", "--json")
    assert ran.code == 0, ran.err
    assert len(json.loads(ran.out)["rows"]) == 4


def test_every_command_refuses_a_mesh_with_the_same_words(mbstudio, stones, broken):
    told = {}
    for command, *more in (("measure",), ("fit",), ("sweep", "-n", "2"), ("learn", "-o", "style")):
        ran = mbstudio(command, broken, "--unit", "mm", *more)
        assert ran.code == 1
        told[command] = ran.err
    assert len(set(told.values())) == 1, told
    assert "6 open edges bound 1 hole" in told["fit"]


def test_several_inputs_are_meshes(mbstudio, stones, small_scan_file):
    ran = mbstudio("fit", stones, small_scan_file, "-o", "a.mbs")
    assert ran.code == 1
    assert "several inputs only of meshes" in ran.err
    ran = mbstudio("measure", stones, "missing.ply")
    assert "missing.ply does not exist" in ran.err
    ran = mbstudio("measure", "none*.ply")
    assert "matches no meshes" in ran.err


@pytest.mark.filterwarnings("always::mbstudio.core.errors.GrainWarning")
def test_cavities_are_filled_or_kept_on_request(mbstudio, stones):
    ball = trimesh.creation.icosphere(subdivisions=3)
    inner = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    inner.invert()
    trimesh.util.concatenate([ball, inner]).export("hollow.ply")
    ran = mbstudio("measure", "hollow.ply", "--json")
    assert json.loads(ran.out)["volume"] == pytest.approx(ball.volume, rel=1e-6)
    assert "1 enclosed cavity (12.50% of its volume), which was filled" in ran.err
    ran = mbstudio("measure", "hollow.ply", "--json", "--cavities", "keep")
    assert json.loads(ran.out)["volume"] == pytest.approx(0.875 * ball.volume, rel=1e-6)
    assert not ran.err
    assert mbstudio("measure", "hollow.ply", "--cavities", "maybe").code == 1
