"""``mbstudio pack`` and ``mbstudio packing``."""

from __future__ import annotations

import json


def test_pack_and_read_back(mbstudio, fitted_project, tmp_path):
    folder = tmp_path / "packing"
    common = ("--count", 14, "--spheres", 4, "--inset", 0.3, "--workers", 1, "--select", "all")
    ran = mbstudio("pack", fitted_project, *common, "-o", folder, "--json")
    assert ran.code == 0, ran.err
    summary = json.loads(ran.out)
    assert 0.2 < summary["porosity"] < 0.8
    assert (folder / "packing.vtp").is_file()
    back = mbstudio(
        "packing", "read", folder / "poses.csv", "--avatars", fitted_project, "--select", "all",
        "--width", summary["width"], "--inset", 0.3, "--json",
    )  # fmt: skip
    assert back.code == 0, back.err
    assert abs(json.loads(back.out)["porosity"] - summary["porosity"]) < 1e-6
    printed = mbstudio("packing", "read", folder / "poses.csv", "--avatars", fitted_project, "--inset", 0.3)
    assert "porosity" in printed.out


def test_what_cannot_be_packed_is_one_message(mbstudio, fitted_project, tmp_path):
    for words, told in (
        (("--count", 1), "at least 2 grains"),
        (("--clones",), "has no clones"),
        (("--with-spheres", "-o", tmp_path / "x"), "is printed and not written"),
    ):
        ran = mbstudio("pack", fitted_project, *words)
        assert ran.code == 1
        assert told in ran.err
        assert len(ran.err.strip().splitlines()) == 1


def test_kinds_are_compared(mbstudio, fitted_project):
    ran = mbstudio(
        "pack", fitted_project, "--count", 14, "--spheres", 4, "--inset", 0.2, "--workers", 1,
        "--with-spheres", "--seeds", 2, "--json",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    found = json.loads(ran.out)
    assert set(found["groups"]) == {"fitted.mbs", "spheres"}
    assert len(found["groups"]["spheres"]["porosity"]["values"]) == 2
