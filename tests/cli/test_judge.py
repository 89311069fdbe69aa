"""``mbstudio judge``: clones against true grains, from files of every kind."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from mbstudio.core.dem import export
from mbstudio.core.judging import comparing
from mbstudio.core.metaball.avatar import Avatar
from tests.core.judging.bodies import rough_grain


@pytest.fixture(autouse=True)
def _fewer_repeats(monkeypatch):
    fewer = tuple((word, scorer, 2, 4) for word, scorer, _, _ in comparing._CLASSIFIERS)
    monkeypatch.setattr(comparing, "_CLASSIFIERS", fewer)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Twelve angular grains, twelve that are like them, and twelve that are flatter."""
    root = tmp_path_factory.mktemp("judged")
    rng = np.random.default_rng(1)
    for name, flatter in (("true", 1.0), ("like", 1.0), ("flat", 0.55)):
        (root / name).mkdir()
        for number in range(12):
            mesh = rough_grain(rng, level=3)
            mesh.vertices = np.asarray(mesh.vertices) * [1.0, 1.0, flatter]
            mesh.export(root / name / f"g{number}.ply")
    return root


def rows_of(path):
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def parents_table(path, names, parents):
    with path.open("w", newline="", encoding="utf-8") as lines:
        csv.writer(lines).writerows([("name", "parent"), *zip(names, parents, strict=True)])
    return path


def test_flatter_clones_are_told_and_all_is_written(mbstudio, folders, tmp_path):
    table = parents_table(tmp_path / "p.csv", [f"g{n}" for n in range(12)], [f"x{n}" for n in range(12)])
    ran = mbstudio(
        "judge", folders / "flat", "--against", folders / "true", "--parents", table,
        "--fits", folders / "true",
        "-o", tmp_path / "r.html", "--csv", tmp_path / "a.csv", "--drift", tmp_path / "d.csv", "--workers", 0,
    )  # fmt: skip
    assert ran.code == 0, ran.err
    assert "told apart" in ran.out
    assert "True grains against clones (12, 12)" in ran.out
    areas = {(row["comparison"], row["features"]): row for row in rows_of(tmp_path / "a.csv")}
    assert float(areas["true against clones", "form"]["logistic_auc"]) > 0.9
    paired = areas["true against their own fits", "all"]
    # A fit that is the grain itself cannot be told from it.
    assert abs(float(paired["logistic_auc"]) - 0.5) < 0.1
    assert paired["verdict"] == "not told apart, within the error"
    drifts = {row["feature"]: row for row in rows_of(tmp_path / "d.csv")}
    assert float(drifts["si"]["drift_in_deviations"]) < -1.0
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "12 true grains, 12 clones" in text
    assert "Drawn and turned at random" in text
    assert text.count("<img ") == 1
    assert not {"http:", "https:"} & set(text.split('"'))


def test_json_and_the_same_seed(mbstudio, folders):
    words = ("judge", folders / "like", "--against", folders / "true", "--workers", 0, "--seed", 3, "--json")
    one, same = (mbstudio(*words) for _ in range(2))
    assert one.code == same.code == 0, one.err
    assert one.out == same.out
    found = json.loads(one.out)
    assert found["numbers"] == [12, 12]
    assert found["seed"] == 3
    assert any("parents of the clones are not known" in note for note in found["notes"])


def test_exported_avatars_are_judged(mbstudio, folders, tmp_path):
    rng = np.random.default_rng(0)
    avatars = [Avatar(0.3 * rng.standard_normal((6, 3)), np.full(6, 0.15), "mm") for _ in range(11)]
    names = [f"a{number}" for number in range(11)]
    export(avatars, "metaball", tmp_path / "out", names=names)
    ran = mbstudio("judge", tmp_path / "out", "--against", folders / "true", "--workers", 0, "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["numbers"] == [12, 11]


def test_what_cannot_be_judged_is_said(mbstudio, folders, tmp_path):
    true = ("--against", folders / "true", "--workers", 0)
    ran = mbstudio("judge", folders / "like" / "g1.ply", *true)
    assert ran.code == 1
    assert "10 clones, not 12 and 1" in ran.err
    one = parents_table(tmp_path / "one.csv", [f"g{n}" for n in range(12)], ["g1"] * 12)
    ran = mbstudio("judge", folders / "like", *true, "--parents", one)
    assert "all of one parent" in ran.err
    short = parents_table(tmp_path / "short.csv", ["g0"], ["g1"])
    ran = mbstudio("judge", folders / "like", *true, "--parents", short)
    assert "no parent of 11 of 12 clones, the first 'g1'" in ran.err
    (tmp_path / "other.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    ran = mbstudio("judge", folders / "like", *true, "--parents", tmp_path / "other.csv")
    assert "must have the columns 'name' and 'parent'" in ran.err
    ran = mbstudio("judge", tmp_path / "nothing", *true)
    assert "does not exist" in ran.err
    ran = mbstudio("judge", folders / "like", *true, "-o", tmp_path / "no" / "r.html")
    assert "does not exist" in ran.err
    empty = tmp_path / "empty"
    empty.mkdir()
    ran = mbstudio("judge", empty, *true)
    assert "neither a mesh" in ran.err


def test_grains_and_avatars_of_a_project_are_read(fitted_project):
    from mbstudio.cli import judge

    grains, avatars = (
        judge._named_bodies([fitted_project], grains=True),
        judge._named_bodies([fitted_project]),
    )
    assert list(grains) == list(avatars)
    assert len(grains) == 3
    assert all(isinstance(body, Avatar) for body in avatars.values())


def test_of_clones_from_surfaces_the_surfaces_are_judged(mbstudio, folders, tmp_path):
    """And not the metaballs beside them, which are their fits."""
    style, clones = tmp_path / "style", tmp_path / "clones"
    preset = ("--preset", "surfaces", "-n", 8)
    ran = mbstudio("learn", folders / "true", "--unit", "mm", *preset, "-o", style, "--workers", 1)
    assert ran.code == 0, ran.err
    assert mbstudio("generate", style, "--count", 12, "-o", clones, "--workers", 1).code == 0
    ran = mbstudio("judge", clones, "--against", folders / "true", "--json", "--workers", 0)
    assert ran.code == 0, ran.err
    told = json.loads(ran.out)
    names = [comparison["name"] for comparison in told["comparisons"]]
    assert "true against fits of clones" in names
    assert np.isfinite(told["likeness"]["source_correlation"])
    curved = [
        next(row for row in comparison["results"] if row["features"] == "curvature")
        for comparison in told["comparisons"]
        if comparison["name"] in ("true against clones", "true against fits of clones")
    ]
    # Eight control points make no faces: they are told apart, the surfaces less so.
    assert curved[0]["logistic"]["value"] < curved[1]["logistic"]["value"]
