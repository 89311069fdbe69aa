"""Tables of measured projects: processes, units, bodies that cannot be measured."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from mbstudio.cli import measuring
from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics import (
    CORE_FACTORS,
    DETAILED_FACTORS,
    FACTORS,
    Factor,
    factor_intervals,
    measure,
)
from mbstudio.core.project import Project


@pytest.fixture
def one_flat(fitted_project, monkeypatch):
    """The project's labels, of which the second grain cannot be measured."""
    from mbstudio.core.grains import Grain
    from mbstudio.core.populations import measuring as library

    labels = sorted(Project.open(fitted_project).fits)

    def fail_for_one(body, **options):
        if isinstance(body, Grain) and body.label == labels[1]:
            raise MeasureError("the grain is flat")
        return measure(body, **options)

    monkeypatch.setattr(library, "measure", fail_for_one)
    return labels


def table_in(path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_processes_change_neither_order_nor_values(fitted_project):
    project = Project.open(fitted_project)
    labels = sorted(project.fits, reverse=True)
    alone = measuring.measure_grains(project, labels, workers=0)
    together = measuring.measure_grains(project, labels, workers=2)
    assert together.grains.labels.tolist() == together.avatars.labels.tolist() == labels
    for name in CORE_FACTORS:
        np.testing.assert_allclose(together.grains.column(name), alone.grains.column(name), rtol=1e-12)
        np.testing.assert_allclose(together.avatars.column(name), alone.avatars.column(name), rtol=1e-12)


def test_one_grain_that_cannot_be_measured_keeps_its_row(mbstudio, fitted_project, one_flat, tmp_path):
    ran = mbstudio("measure", fitted_project, "--workers", 0, "--csv", tmp_path / "a.csv", "--json")
    assert ran.code == 0
    assert f"grain {one_flat[1]} could not be measured: the grain is flat" in ran.err
    result = json.loads(ran.out)
    assert result["failures"] == {"grains": {str(one_flat[1]): "the grain is flat"}, "avatars": {}}
    assert ["grain" in row for row in result["grains"]] == [True, False, True]
    assert all("avatar" in row for row in result["grains"])
    rows = table_in(tmp_path / "a.csv")
    assert [row["grain_not_measured"] for row in rows] == ["", "the grain is flat", ""]
    assert [row["grain_volume_um3"] == "" for row in rows] == [False, True, False]
    assert [row["relative_error_volume"] == "" for row in rows] == [False, True, False]


def test_columns_state_unit_and_conventions(mbstudio, fitted_project, tmp_path):
    ran = mbstudio(
        "measure", fitted_project, "--limit", 1, "--unit", "mm", "--axes", "inertia", "--surface", "crofton",
        "--detail", "--workers", 0, "--csv", tmp_path / "a.csv",
    )  # fmt: skip
    assert ran.code == 0
    (row,) = table_in(tmp_path / "a.csv")
    project = Project.open(fitted_project)
    grain = project.grains.grain(int(row["label"]))
    known = measure(grain, unit="mm", axes="inertia", surface="crofton")
    assert float(row["grain_area_mm2"]) == pytest.approx(known.area)
    assert float(row["grain_longest_mm"]) == pytest.approx(known.longest)
    assert (row["unit"], row["axes"], row["grain_surface"]) == ("mm", "inertia", "crofton voxels")
    assert row["avatar_valid"] == "True"
    error = float(row["avatar_csf"]) / float(row["grain_csf"]) - 1
    assert float(row["relative_error_csf"]) == pytest.approx(error)
    dimensionless = set(CORE_FACTORS) | set(DETAILED_FACTORS)
    assert {name for name in dimensionless if f"relative_error_{name}" not in row} == set()


def test_a_mesh_as_a_table(mbstudio, tmp_path):
    import trimesh

    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.stl")
    arguments = ("measure", tmp_path / "box.stl", "--unit", "cm", "--csv", tmp_path / "a.csv")
    assert mbstudio(*arguments).code == 0
    (row,) = table_in(tmp_path / "a.csv")
    assert row["name"] == "box.stl"
    assert float(row["volume_cm3"]) == pytest.approx(6)
    assert float(row["area_cm2"]) == pytest.approx(22)


def test_parquet_needs_pyarrow(mbstudio, fitted_project, tmp_path, monkeypatch):
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pyarrow" else found(name))
    ran = mbstudio("measure", fitted_project, "--parquet", tmp_path / "a.parquet")
    assert ran.code == 1
    assert "pip install 'mbstudio[parquet]'" in ran.err
    assert not list(tmp_path.iterdir())


def test_parquet_holds_the_same_table(mbstudio, fitted_project, tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow, of the extra 'parquet'")
    import pandas as pd

    few = ("measure", fitted_project, "--limit", 2, "--workers", 0)
    ran = mbstudio(*few, "--parquet", tmp_path / "a.parquet", "--csv", tmp_path / "a.csv")
    assert ran.code == 0
    table, rows = pd.read_parquet(tmp_path / "a.parquet"), table_in(tmp_path / "a.csv")
    assert list(table.columns) == list(rows[0])
    np.testing.assert_allclose(table["grain_volume_um3"], [float(row["grain_volume_um3"]) for row in rows])


def test_intervals_stand_beside_grain_and_avatar(mbstudio, fitted_project, tmp_path):
    labels = sorted(Project.open(fitted_project).fits)
    chosen = ("measure", fitted_project, "--grains", labels[0], "--workers", 0, "--intervals")
    ran = mbstudio(*chosen, "--unit", "mm", "--csv", tmp_path / "a.csv", "--json")
    assert ran.code == 0, ran.err
    assert "labels as they are" in ran.err
    (told,) = json.loads(ran.out)["grains"]
    known = factor_intervals(Project.open(fitted_project).grains.grain(labels[0]), unit="mm")
    assert set(told["interval"]) == set(CORE_FACTORS)
    for name, (low, high) in known.intervals.items():
        assert told["interval"][name] == pytest.approx([low, high])
        assert low <= told["grain"][name] <= high
    (row,) = table_in(tmp_path / "a.csv")
    assert float(row["grain_area_mm2_low"]) == pytest.approx(known.intervals["area"][0])
    assert float(row["grain_csf_high"]) == pytest.approx(known.intervals["csf"][1])
    text = mbstudio(*chosen).out
    assert "avatar" in text
    assert "sphericity" in text


def test_a_mesh_has_no_intervals(mbstudio, tmp_path):
    import trimesh

    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.stl")
    ran = mbstudio("measure", tmp_path / "box.stl", "--unit", "cm", "--intervals")
    assert ran.code == 1
    assert "a mesh is exact" in ran.err


def test_a_factor_that_is_added_to_the_table_has_its_columns(mbstudio, fitted_project, tmp_path):
    added = Factor(
        name="specific_surface", title="Specific surface", meaning="Surface area over volume", power=-1,
        derive=lambda area, volume: area / volume,
    )  # fmt: skip
    chosen = ("measure", fitted_project, "--limit", 1, "--workers", 0, "--intervals")
    with FACTORS.extended(added):
        ran = mbstudio(*chosen, "--csv", tmp_path / "a.csv", "--json")
    assert ran.code == 0, ran.err
    (row,) = table_in(tmp_path / "a.csv")
    of_grain = float(row["grain_area_um2"]) / float(row["grain_volume_um3"])
    assert float(row["grain_specific_surface_per_um"]) == pytest.approx(of_grain)
    assert float(row["grain_specific_surface_per_um_low"]) <= of_grain
    error = float(row["avatar_specific_surface_per_um"]) / of_grain - 1
    assert float(row["relative_error_specific_surface"]) == pytest.approx(error)
    assert json.loads(ran.out)["summary"]["specific_surface"]["grain"] == pytest.approx(of_grain)
    assert mbstudio("measure", fitted_project, "--limit", 1, "--csv", tmp_path / "b.csv").code == 0
    (plain,) = table_in(tmp_path / "b.csv")
    assert not [column for column in plain if "specific_surface" in column]


def test_the_table_says_which_errors_are_small_by_construction(mbstudio, fitted_project):
    assert "small by construction" in mbstudio("measure", fitted_project, "--workers", 0, "--limit", 1).out
