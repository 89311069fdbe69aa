"""``mbstudio enough``, ``grading``, ``porosity``, and what the report says for a laboratory."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbstudio.core.project import Project

TABLE = "Maschenweite [mm];Siebdurchgang [%]\n0,1;0\n0,2;30\n0,4;80\n1;100\n"


def test_enough_says_what_is_needed_and_what_cannot_be_told(mbstudio, fitted_project):
    ran = mbstudio("enough", fitted_project, "--workers", 0, "--json")
    assert ran.code == 0
    found = json.loads(ran.out)
    rows = {row["number"]: row for row in found["needs"]}
    assert {"mean", "d10", "d50", "d90", "sphericity"} <= set(rows)
    # Three grains: too few to draw again, so that nothing is said to be enough.
    assert rows["d50"]["enough"] is None
    assert rows["d50"]["low"] is None
    assert rows["d50"]["by_lognormal"] >= 1
    assert "cannot be told" in mbstudio("enough", fitted_project, "--workers", 0).out
    assert mbstudio("enough", fitted_project, "--precision", 5).code == 2


def test_grading_beside_a_laboratorys_table(mbstudio, fitted_project, tmp_path):
    table = tmp_path / "sieb.csv"
    table.write_text(TABLE, encoding="utf-8")
    ran = mbstudio("grading", fitted_project, "--workers", 0, "--laboratory", table, "--border", "--json")
    assert ran.code == 0
    found = json.loads(ran.out)
    assert sum(found["classes_percent"]["wentworth"].values()) == pytest.approx(100.0)
    against = found["laboratory"][0]
    assert against["curve"]["percent_finer"] == [0.0, 30.0, 80.0, 100.0]
    gaps = np.subtract(against["scan"]["percent_finer"], against["curve"]["percent_finer"])
    assert abs(against["largest_difference_percent"]) == pytest.approx(np.abs(gaps).max())
    assert found["curve"]["corrected_for_border"]
    words = mbstudio("grading", fitted_project, "--workers", 0, "--laboratory", table).out
    assert "largest difference" in words
    assert "No grain is of a size that BS 812" in words
    table.write_text(TABLE.replace("80", "20"), encoding="utf-8")
    ran = mbstudio("grading", fitted_project, "--laboratory", table)
    assert ran.code == 1
    assert "must rise" in ran.err


def test_porosity_is_one_less_the_share_of_grains(mbstudio, fitted_project, tmp_path):
    csv = tmp_path / "pores.csv"
    ran = mbstudio("porosity", fitted_project, "--json", "--csv", csv)
    assert ran.code == 0
    found = json.loads(ran.out)
    grains = Project.open(fitted_project).grains
    if grains.view is None or grains.view.footprint.all():
        assert found["porosity"] == pytest.approx(1 - np.count_nonzero(grains.labels) / grains.labels.size)
    assert found["solid_fraction"] == pytest.approx(1 - found["porosity"])
    assert len(found["profiles"]["z"]["places"]) == grains.labels.shape[0]
    assert csv.read_text("utf-8").startswith("along,place_")
    assert "void ratio" in mbstudio("porosity", fitted_project).out
    ran = mbstudio("porosity", fitted_project, "--diameter", 1e6)
    assert ran.code == 1
    assert "does not lie within" in ran.err


def test_the_report_for_people_for_print_and_for_machines(mbstudio, fitted_project, tmp_path):
    table = tmp_path / "sieb.csv"
    table.write_text(TABLE, encoding="utf-8")
    options = ("--workers", 0, "--laboratory", table)
    page, paper, data, sheet = (tmp_path / name for name in ("r.html", "r.pdf", "r.json", "c.pdf"))
    assert mbstudio("report", fitted_project, "-o", page, *options).code == 0
    text = page.read_text("utf-8")
    for said in (
        "Enough grains?", "ISO 14688-1", "p after Holm", "Porosity", "Methods", "Masuda", "SHA-256",
        "sieb.csv: opening (mm)", "Volume V", " *</td>",
    ):  # fmt: skip
        assert said in text, said
    assert mbstudio("report", fitted_project, "-o", paper, "--certificate", sheet, *options).code == 0
    assert paper.read_bytes().startswith(b"%PDF")
    assert paper.read_bytes().count(b"/Type /Page ") >= 5
    assert sheet.read_bytes().count(b"/Type /Page ") == 1
    assert mbstudio("report", fitted_project, "-o", data, *options).code == 0
    record = json.loads(data.read_text("utf-8"))
    project = Project.open(fitted_project)
    assert record["repeat"]["scan"]["sha256"] == project.state.scan.digest
    assert record["repeat"]["bootstrap"]["seed"] == 0
    assert len(record["grains"]) == len(record["avatars"]) == 3
    assert record["findings"]["sizes"]["d50"]["low"] is None
    ran = mbstudio("report", fitted_project, "-o", page, "--border", "--certificate", sheet, *options)
    assert ran.code == 0, ran.err
    assert "those of the grains inside as they are" in page.read_text("utf-8")
    again = data.read_bytes()
    assert mbstudio("report", fitted_project, "-o", data, *options).code == 0
    assert data.read_bytes() == again
