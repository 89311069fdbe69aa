"""Meshes on the command line: files, folders and patterns, with the same words in every command."""

from __future__ import annotations

import json
from pathlib import Path

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
    assert "several inputs only if all are meshes" in ran.err
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


def test_a_project_of_meshes_measures_what_the_files_do(mbstudio, stones):
    ran = mbstudio("fit", stones, "--unit", "mm", "--resolution", 20, "-n", 5, "--workers", 0)
    assert ran.code == 0, ran.err
    of_files = json.loads(mbstudio("measure", stones, "--unit", "mm", "--json").out)["bodies"]
    ran = mbstudio("measure", "stones.mbs", "--json", "--csv", "a.csv")
    of_project = json.loads(ran.out)["grains"]
    assert [row["name"] for row in of_project] == ["s0", "s1", "s2"]
    for one, other in zip(of_files, of_project, strict=True):
        for factor in ("volume", "area", "sphericity", "csf"):
            assert other["grain"][factor] == pytest.approx(one[factor], rel=1e-6)
    assert "name" in Path("a.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    assert "2, s1" in mbstudio("measure", "stones.mbs").out
    ran = mbstudio("measure", "stones.mbs", "--intervals")
    assert ran.code == 1
    assert "a mesh is exact" in ran.err
    ran = mbstudio("report", "stones.mbs")
    assert ran.code == 0, ran.err
    page = Path("stones.html").read_text(encoding="utf-8")
    assert "3 bodies of 3 mesh files" in page
    assert all(name in page for name in ("s0.ply", "s1.stl", "s2.obj"))


def test_bodies_are_chosen_by_number_in_every_command(mbstudio, stones):
    ran = mbstudio("measure", stones, "--unit", "mm", "--grains", "3,1", "--json")
    assert [body["name"] for body in json.loads(ran.out)["bodies"]] == ["s2.obj", "s0.ply"]
    ran = mbstudio("measure", stones, "--unit", "mm", "--grains", "4")
    assert ran.code == 1
    assert "There is no grain 4: the meshes hold 1 to 3." in ran.err
    ran = mbstudio(
        "fit", stones, "--unit", "mm", "--resolution", 16, "-n", 3, "--grains", "3", "--workers", 0
    )
    assert ran.code == 0, ran.err
    assert list(Project.open("stones.mbs").fits) == [3]


def test_a_limit_counts_bodies_and_not_files(mbstudio, stones):
    balls = [trimesh.creation.icosphere(subdivisions=2).apply_translation((3 * i, 0, 0)) for i in range(3)]
    trimesh.util.concatenate(balls).export(stones / "a_pack.stl")
    ran = mbstudio("measure", stones, "--unit", "mm", "--limit", 2, "--json")
    assert [body["name"] for body in json.loads(ran.out)["bodies"]] == ["a_pack.stl#1", "a_pack.stl#2"]


def test_learn_leaves_out_what_cannot_be_read_and_says_so(mbstudio, stones, broken):
    for number in range(4):
        ball = trimesh.creation.icosphere(subdivisions=2)
        ball.vertices *= (1, 1 + 0.1 * number, 0.8)
        ball.export(stones / f"t{number}.ply")
    ran = mbstudio("learn", stones, "-o", "style", "--unit", "mm", "--preset", "pca", "-n", 5, "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["parents"] == 7
    assert "left out" in ran.err
    assert "broken.ply is not closed" in ran.err
    ran = mbstudio("learn", stones, "-o", "other", "--unit", "mm", "--cavities", "keep")
    assert ran.code == 1
    assert "leave --cavities keep out" in ran.err


@pytest.mark.filterwarnings("ignore::mbstudio.core.errors.GrainWarning")
def test_a_sweep_keeps_the_cavities_that_it_was_told_to_keep(mbstudio, stones):
    ball = trimesh.creation.icosphere(subdivisions=3)
    inner = trimesh.creation.icosphere(subdivisions=3, radius=0.6)
    inner.invert()
    trimesh.util.concatenate([ball, inner]).export("hollow.ply")
    iou = {}
    for word in ("fill", "keep"):
        ran = mbstudio(
            "sweep", "hollow.ply", "--unit", "mm", "--resolution", 24, "-n", "12", "--cavities", word,
            "-o", f"{word}.csv", "--json",
        )  # fmt: skip
        assert ran.code == 0, ran.err
        (row,) = json.loads(ran.out)["rows"]
        iou[word] = row["volume_error"]
    assert iou["fill"] != iou["keep"]


@pytest.mark.parametrize(
    "words", [("--voxel-size", "1 mm"), ("--splitting", "0.5"), ("--threshold", "9"), ("--shape", "1,2,3")]
)
def test_options_of_scans_are_refused_for_meshes(mbstudio, stones, words):
    ran = mbstudio("fit", stones, "--unit", "mm", *words)
    assert ran.code == 1
    assert f"{words[0]} is an option of scans" in ran.err
