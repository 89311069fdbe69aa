"""``mbstudio report``: one file that needs nothing else."""

from __future__ import annotations

import re
from dataclasses import replace

from mbstudio.cli.measuring import measure_grains
from mbstudio.core.project import Project
from mbstudio.scene.reports.population_report import write_report


def test_the_report_needs_nothing_else(mbstudio, fitted_project, tmp_path):
    path = tmp_path / "report.html"
    ran = mbstudio("report", fitted_project, "-o", path, "--workers", 0, "--sieves", "astm", "--unit", "mm")
    assert ran.code == 0
    text = path.read_text(encoding="utf-8")
    assert "3 grains and 3 avatars" in text
    # Seven figures, all within the file; nothing that a browser would fetch or run.
    assert text.count("data:image/svg+xml;base64,") == text.count("<img ") == 7
    outside = re.sub(r'src="data:[^"]*"', "", text)
    assert not re.search(r"https?:|src=|href=|url\(|@import|<script", outside)
    for said in (
        "ASTM E11",
        "Volume V (mm³)",
        "oriented bounding box",
        "K-S D",
        "lightly smoothed surface",
        "D50 (mm)",
        "14 µm",
        "Verdict: green.",
    ):
        assert said in text
    assert list(tmp_path.iterdir()) == [path]


def test_what_went_wrong_stands_in_it(fitted_project, tmp_path):
    project = Project.open(fitted_project)
    labels = sorted(project.fits)
    fit = project.fits[labels[0]]
    bad = replace(fit, verdict=replace(fit.verdict, valid=False, reasons=("Too <small>.",)))
    project.change("Spoil", fits={**project.fits, labels[0]: bad})
    populations = measure_grains(project, labels, workers=0)
    lost = replace(populations.grains, reasons=("", "The grain is flat.", ""), warnings=("", "", "Mind it."))
    text = write_report(tmp_path / "r.html", project, replace(populations, grains=lost)).read_text("utf-8")
    assert f"<td>{labels[0]}</td><td>Too &lt;small&gt;.</td>" in text
    assert f"<td>grains</td><td>{labels[1]}</td><td>The grain is flat.</td>" in text
    assert f"<td>grains</td><td>{labels[2]}</td><td>Mind it.</td>" in text
    assert "3 fitted, 2 valid, 3 measured" in text
    again = write_report(tmp_path / "s.html", project, replace(populations, grains=lost)).read_text("utf-8")
    assert again == text


def test_a_project_without_avatars(mbstudio, small_scan_file, tmp_path):
    project = tmp_path / "a.mbs"
    assert mbstudio("segment", small_scan_file, "--voxel-size", "14 um", "-o", project).code == 0
    assert mbstudio("report", project, "--workers", 0).code == 0
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "No avatar was fitted" in text
    assert "K-S D" not in text
    assert "Part of it" not in text


def test_the_part_of_the_scan_is_named(mbstudio, small_scan_file, tmp_path):
    project = tmp_path / "a.mbs"
    ran = mbstudio(
        "segment", small_scan_file, "--voxel-size", "14 um", "--crop", ":30,:30,:30", "-o", project
    )
    assert ran.code == 0
    assert mbstudio("report", project, "--workers", 0).code == 0
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert small_scan_file.name in text
    assert "voxels 0:30, 0:30, 0:30 of 56 × 56 × 56 (z, y, x)" in text


def test_outputs_that_make_no_sense(mbstudio, fitted_project, tmp_path):
    for output, named in (
        (fitted_project, "is the input"),
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "r.html", "does not exist"),
    ):
        ran = mbstudio("report", fitted_project, "-o", output)
        assert ran.code == 1
        assert named in ran.err
    assert not list(tmp_path.iterdir())


def test_a_report_that_fails_leaves_the_old_one(mbstudio, fitted_project, tmp_path, monkeypatch):
    from mbstudio.scene.reports import population_report

    path = tmp_path / "r.html"
    path.write_text("old")

    def stop(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(population_report, "joint_figure", stop)
    assert mbstudio("report", fitted_project, "-o", path, "--limit", 2, "--workers", 0).code == 130
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
