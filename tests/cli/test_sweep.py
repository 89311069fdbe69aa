from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import trimesh

from mbstudio.core.project import Project

QUICK = ("--option", "generations=5")


def table(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


def test_sweep_of_a_project(mbstudio, fitted_project, tmp_path):
    path, figure = tmp_path / "sweep.csv", tmp_path / "sweep.svg"
    labels = Project.open(fitted_project).grains.interior_labels[:2]
    words = (
        "sweep",
        fitted_project,
        "--grains",
        f"{labels[1]},{labels[0]}",
        "--n",
        "9,3",
        "-o",
        path,
        *QUICK,
    )
    ran = mbstudio(*words, "--figure", figure)
    assert ran.code == 0
    assert [(int(row["label"]), int(row["n"])) for row in table(path)] == [
        (labels[1], 3), (labels[1], 9), (labels[0], 3), (labels[0], 9)
    ]  # fmt: skip
    assert float(table(path)[1]["error_sphericity"]) == pytest.approx(0, abs=0.1)
    assert "n = 3" in ran.out
    assert "sphericity" in ran.out
    assert figure.stat().st_size > 10_000
    # It is not replaced without being asked, and gone on with where it is.
    again = mbstudio(*words)
    assert again.code == 1
    assert "--resume" in again.err
    before = table(path)
    more = mbstudio(*words[:5], "3,4", *words[6:], "--resume", "--error", 5, "--json")
    assert more.code == 0
    told = json.loads(more.out)
    assert [row["n"] for row in told["rows"]] == [3, 4, 3, 4]
    assert told["error"] == 0.05
    assert set(told["smallest_n"]) >= {"csf", "hausdorff", "overlap_error"}
    after = table(path)
    assert len(after) == 6
    assert all(row in after for row in before)  # CPU seconds and all: not done again


def test_an_interrupted_sweep_goes_on(mbstudio, fitted_project, tmp_path, monkeypatch):
    from mbstudio.core.imaging import sweep

    path, compared, done = tmp_path / "sweep.csv", sweep.compared, []

    def interrupted(*arguments, **about):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(about["n"])
        return compared(*arguments, **about)

    monkeypatch.setattr(sweep, "compared", interrupted)
    words = ("sweep", fitted_project, "--grains", "1-2", "-n", "2,4", "-o", path, *QUICK)
    labels = Project.open(fitted_project).grains.interior_labels
    words = (*words[:3], ",".join(map(str, labels[:2])), *words[4:])
    ran = mbstudio(*words)
    assert ran.code == 130
    assert "--resume" in ran.err
    assert len(table(path)) == 2
    monkeypatch.setattr(sweep, "compared", compared)
    assert mbstudio(*words, "--resume").code == 0
    assert len(table(path)) == 4


def test_sweep_of_a_mesh(mbstudio, tmp_path):
    trimesh.creation.icosphere(subdivisions=3, radius=2.0).export(tmp_path / "ball.ply")
    ran = mbstudio(
        "sweep", tmp_path / "ball.ply", "--unit", "mm", "--resolution", 20, "-n", "1,2", "--json",
        "-o", tmp_path / "a.csv", *QUICK,
    )  # fmt: skip
    assert ran.code == 0
    rows = json.loads(ran.out)["rows"]
    assert [row["n"] for row in rows] == [1, 2]
    assert rows[0]["iou"] > 0.95


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--grains", "99"), "no grain 99"),
        (("--n", "0,5"), "n = 0"),
        (("--n", "ten"), "--n"),
        (("--figure", "a.bmp"), "a.bmp"),
        (("--error", "0"), "--error"),
        (("-o", "/nowhere/a.csv"), "/nowhere"),
        (("--method", "slow"), "slow"),
    ],
)
def test_bad_words(mbstudio, fitted_project, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    ran = mbstudio("sweep", fitted_project, *words)
    assert ran.code == 1
    assert message in ran.err
    assert len(ran.err.splitlines()) == 1
    assert not (tmp_path / "sweep.csv").exists()


def test_the_table_never_replaces_what_is_swept(mbstudio, fitted_project):
    before = fitted_project.read_bytes()
    assert mbstudio("sweep", fitted_project, "-o", fitted_project, "--resume").code == 1
    assert fitted_project.read_bytes() == before


def test_fit_with_a_target(mbstudio, fitted_project, tmp_path):
    path = tmp_path / "a.mbs"
    words = ("fit", fitted_project, "--target", "volume 2 % and rms 3%", "--workers", 0, "-o", path, "--json")
    ran = mbstudio(*words)
    assert ran.code == 0
    told = json.loads(ran.out)
    assert told["fitted"] == told["reached_target"] == 3
    with Project.open(path) as project:
        assert project.state.fit_settings.target == "volume 2 % and rms 3 %"
        for label, fit in project.fits.items():
            assert fit.target == "volume 2 % and rms 3 %"
            assert fit.reached["rms"] <= 0.03
            rms = fit.verdict.rms / project.grains.grain(label).nominal_diameter
            assert fit.reached["rms"] == pytest.approx(rms)
        numbers = [fit.n for fit in project.fits.values()]
    assert told["median_control_points"] == np.median(numbers)
    # They are as asked: nothing is left to do; without the target they are not.
    assert json.loads(mbstudio("fit", path, *words[2:6], "--json").out)["fitted"] == 0
    assert json.loads(mbstudio("fit", path, "-n", 3, "--workers", 0, "--json").out)["fitted"] == 3


def test_a_target_that_is_none(mbstudio, fitted_project, tmp_path):
    ran = mbstudio("fit", fitted_project, "--target", "beauty 1 %", "-o", tmp_path / "a.mbs")
    assert ran.code == 1
    assert "beauty" in ran.err
    assert not (tmp_path / "a.mbs").exists()


def test_a_target_out_of_reach_is_told(mbstudio, fitted_project, tmp_path):
    ran = mbstudio(
        "fit", fitted_project, "--target", "iou 0.9999 and n 3", "--workers", 0, "--limit", 1,
        "-o", tmp_path / "a.mbs",
    )  # fmt: skip
    assert ran.code == 0
    assert "was not reached" in ran.err
