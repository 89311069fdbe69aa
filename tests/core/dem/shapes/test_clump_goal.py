"""Clumps with as few spheres as reach a target."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbstudio.core.dem import Clump, ClumpGoal, clump_for_target, export, sphere_clump
from mbstudio.core.errors import ExportError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import mass_properties


def test_words_become_aims():
    target = ClumpGoal.parse("IoU 0.95, hausdorff < 3 % and inertia 0.01 and n 80")
    assert [(aim.measure, aim.limit) for aim in target.aims] == [
        ("iou", 0.95), ("hausdorff", 0.03), ("inertia", 0.01),
    ]  # fmt: skip
    assert target.most == 80
    assert ClumpGoal.parse(str(target)) == target


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "contains no measure"),
        ("n 20", "contains no measure"),
        ("roundness 2 %", "not a goal for a clump"),
        ("iou", "not a goal for a clump"),
        ("iou 1.5", "impossible"),
        ("volume 0 %", "impossible"),
        ("iou 0.9 and iou 0.8", "twice"),
        ("iou 0.9 and n 1", "not a number of spheres"),
        ("iou 0.9 and n 20 %", "not a number of spheres"),
    ],
)
def test_what_is_no_target_is_named(text, message):
    with pytest.raises(ExportError, match=message):
        ClumpGoal.parse(text)


def _made(avatar: Avatar, spheres: int) -> Clump:
    """A clump whose figures are known functions of the number of spheres."""
    n = float(spheres)
    diameter = (6 * mass_properties(avatar, 1.0).volume / np.pi) ** (1 / 3)
    return Clump(
        np.zeros((spheres, 3)), np.ones(spheres), avatar.unit,
        iou=1 - 1 / n, volume_ratio=1 - 0.1 / n, inertia_error=0.5 / n, hausdorff=2 * diameter / n,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("target", "fewest"),
    [
        ("iou 0.951", 21),  # 1 - 1/21 = 0.9524, 1 - 1/20 = 0.95
        ("hausdorff 3.2 %", 63),  # 2/63 = 3.17 %, 2/62 = 3.23 %
        ("volume 4 %", 3),  # 0.1/3 = 3.3 %, 0.1/2 = 5 %
        ("volume 6 %", 2),
        ("inertia 1.2 %", 42),  # 0.5/42 = 1.19 %, 0.5/41 = 1.22 %
        ("inertia 1.2 % and hausdorff 3.2 %", 63),
    ],
)
def test_the_smallest_number_that_will_do_is_found(target, fewest, avatar):
    found = clump_for_target(avatar, target, fit=_made)
    assert len(found.clump.radii) == fewest
    assert found.is_met
    assert found.warning == ""
    # The number before was tried and would not do, but for the least there can be.
    assert fewest == 2 or not found.goal.is_met(found.tried[fewest - 1])


def test_a_target_out_of_reach_gives_the_best_and_says_so(avatar):
    found = clump_for_target(avatar, "iou 0.99 and volume 5 % and n 30", fit=_made)
    assert not found.is_met
    assert len(found.clump.radii) == 30
    assert "not reached with 30 spheres" in found.warning
    assert "iou 0.9667" in found.warning
    assert "volume" not in found.warning.split("has ")[1].split(".")[0]
    assert "n 60" in found.warning


def test_the_clump_is_that_of_its_number_of_spheres(avatar):
    found = clump_for_target(avatar, "iou 0.97")
    assert found.clump.iou >= 0.97
    same = sphere_clump(avatar, len(found.clump.radii))
    assert np.array_equal(found.clump.centers, same.centers)
    assert max(values["iou"] for n, values in found.tried.items() if n < len(same.radii)) < 0.97


def test_an_export_writes_as_many_spheres_as_each_grain_needs(avatars, tmp_path):
    report = export(
        avatars[:2], "edem", tmp_path / "out", density=2650, clump_target="iou 0.96 and inertia 2 %"
    )
    for item in report.items:
        details = item["details"]
        assert details["clump_target"] == "iou 0.96 and inertia 2 %"
        assert details["iou"] >= 0.96
        assert details["inertia_error"] <= 0.02
        rows = (tmp_path / "out" / item["files"][0]).read_text().splitlines()[1:]
        assert len(rows) == details["spheres"] < 40
    assert not report.warnings


def test_an_export_that_misses_its_target_warns_and_names_the_grain(avatar, tmp_path):
    report = export(avatar, "pfc", tmp_path / "out", clump_target="iou 0.999 and n 12", names=["a"])
    assert len(report.warnings) == 1
    assert report.warnings[0].startswith("a: The goal 'iou 0.999 and n 12' was not reached")
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["items"][0]["details"]["spheres"] == 12


def test_a_target_that_cannot_be_read_writes_nothing(avatar, tmp_path):
    with pytest.raises(ExportError, match="not a goal for a clump"):
        export(avatar, "edem", tmp_path / "out", density=2650, clump_target="roundness 1 %")
    assert not (tmp_path / "out").exists()
