"""What the commands do when all is well."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
import trimesh

import mbstudio as package
from mbstudio.core.project import Project


def test_version(mbstudio):
    ran = mbstudio("--version")
    assert (ran.code, ran.out) == (0, f"mbstudio {package.__version__}\n")


def test_help_names_every_command(mbstudio):
    ran = mbstudio("--help")
    assert ran.code == 0
    for command in ("gui", "tour", "segment", "fit", "measure", "report", "export", "judge", "doctor"):
        assert command in ran.out


def test_help_needs_no_heavy_import():
    script = (
        "import sys\nfrom mbstudio.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not {"numpy", "h5py", "pandas", "numba", "torch", "pyvista", "PySide6", "trimesh"} & set(
        run.stderr.split()
    )


def test_python_m_mbstudio():
    run = subprocess.run([sys.executable, "-m", "mbstudio", "--version"], capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (0, f"mbstudio {package.__version__}\n")


def test_segment(mbstudio, small_scan_file, tmp_path):
    labels, project = tmp_path / "labels.tif", tmp_path / "sand.mbs"
    ran = mbstudio(
        "segment", small_scan_file, "--voxel-size", "14 um", "-o", project, "--write-labels", labels, "--json"
    )
    assert ran.code == 0
    result = json.loads(ran.out)
    assert (result["grains"], result["interior"], result["unit"]) == (4, 3, "um")
    written = tifffile.imread(labels)
    np.testing.assert_array_equal(written, Project.open(project).grains.labels)
    assert result["verdict"]["level"] == "green"
    assert result["verdict"]["figures"]["contrast_to_noise"] > 1
    assert Project.open(project).grains.verdict.to_record() == result["verdict"]


def test_segment_tells_what_the_scan_does_not_bear_out(mbstudio, small_scan_file):
    scan = tifffile.imread(small_scan_file)
    stated = ("--threshold", str(np.quantile(scan, 0.97)))
    ran = mbstudio("segment", small_scan_file, "--voxel-size", "14 um", *stated)
    assert ran.code == 0
    assert "verdict" in ran.out
    assert "The grains are in doubt." in ran.err
    ran = mbstudio("segment", small_scan_file, "--voxel-size", "14 um", *stated, "--json")
    verdict = json.loads(ran.out)["verdict"]
    assert verdict["level"] != "green"
    assert all(doubt["advice"] for doubt in verdict["doubts"])


def test_segment_with_labels_made_elsewhere(mbstudio, small_scan_file, tmp_path):
    labels = np.zeros((56, 56, 56), np.uint8)
    labels[10:20, 10:20, 10:20] = 5
    tifffile.imwrite(tmp_path / "labels.tif", labels, photometric="minisblack")
    ran = mbstudio(
        "segment", small_scan_file, "--voxel-size", "14 um", "--labels", tmp_path / "labels.tif", "--json"
    )
    assert ran.code == 0
    assert json.loads(ran.out)["grains"] == 1


def test_fit_saves_a_project_with_the_whole_way_in_it(fitted_project, small_scan_file):
    with Project.open(fitted_project) as project:
        assert project.scan.shape == (56, 56, 56)
        assert project.scan.path == small_scan_file.resolve()
        assert sorted(project.fits) == project.grains.interior_labels
        for label, fit in project.fits.items():
            assert fit.verdict.valid
            assert fit.avatar.mesh().volume == pytest.approx(project.grains.grain(label).volume, rel=0.05)
        assert project.state.segmentation is not None
        assert project.state.fit_settings.n == 12


def test_fit_prints_json_and_nothing_else_on_stdout(mbstudio, small_scan_file, tmp_path):
    ran = mbstudio(
        "fit", small_scan_file, "--voxel-size", "14 um", "-n", 4, "--limit", 1, "--workers", 0,
        "-o", tmp_path / "a.mbs", "--json",
    )  # fmt: skip
    assert ran.code == 0
    result = json.loads(ran.out)
    assert (result["grains"], result["interior"], result["fitted"], result["failed"]) == (4, 3, 1, 0)
    assert result["interrupted"] is False
    assert "Fitting" in ran.err


def test_fit_goes_on_where_it_stopped(mbstudio, fitted_project, tmp_path):
    project = Project.open(fitted_project)
    kept = dict(list(project.fits.items())[:2])
    project.change("Drop one", fits=kept)
    project.save(tmp_path / "part.mbs")
    ran = mbstudio("fit", tmp_path / "part.mbs", "-n", 12, "--workers", 0, "--json")
    assert ran.code == 0
    assert json.loads(ran.out)["fitted"] == 1
    done = Project.open(tmp_path / "part.mbs")
    assert sorted(done.fits) == done.grains.interior_labels
    for label, fit in kept.items():
        np.testing.assert_array_equal(done.fits[label].avatar.centers, fit.avatar.centers)


def test_fit_of_named_grains_and_anew(mbstudio, fitted_project, tmp_path):
    label = Project.open(fitted_project).grains.interior_labels[1]
    ran = mbstudio(
        "fit", fitted_project, "--grains", label, "-n", 5, "--workers", 0, "-o", tmp_path / "b.mbs", "--json"
    )
    assert ran.code == 0
    fits = Project.open(tmp_path / "b.mbs").fits
    assert {fit.n for name, fit in fits.items() if name != label} == {12}
    assert fits[label].n == 5
    assert {fit.n for fit in Project.open(fitted_project).fits.values()} == {12}


def test_options_of_a_method(mbstudio, fitted_project, tmp_path):
    path = tmp_path / "paper.mbs"

    def fitted(*options: str) -> int:
        source = path if path.exists() else fitted_project
        words = [word for option in options for word in ("--option", option)]
        ran = mbstudio(
            "fit", source, "--method", "paper", "-n", 5, *words, "--limit", 1, "--workers", 0,
            "-o", path, "--json",
        )  # fmt: skip
        assert ran.code == 0, ran.err
        return json.loads(ran.out)["fitted"]

    assert fitted("generations=3", "unit=voxel", "common_factor=no") == 1
    with Project.open(path) as project:
        (fit,) = (fit for fit in project.fits.values() if fit.method == "paper")
        assert len(fit.history) == 4
        given = {"generations": 3, "unit": "voxel", "common_factor": False}
        assert dict(fit.options) == given
        assert dict(project.state.fit_settings.options) == given
        (label,) = (label for label, fit in project.fits.items() if fit.method == "paper")
    # The same options go on with the next grain; others begin with the first again.
    assert fitted("common_factor=no", "generations=3", "unit=voxel") == 1
    with Project.open(path) as project:
        assert sum(fit.method == "paper" for fit in project.fits.values()) == 2
    assert fitted("generations=2") == 1
    with Project.open(path) as project:
        assert len(project.fits[label].history) == 3
    before = path.read_bytes()
    for option, words in (
        ("speed=3", "no option 'speed'"),
        ("weight=cube", "weight=square"),
        ("n", "name=value"),
    ):
        ran = mbstudio("fit", path, "--method", "paper", "--option", option)
        assert ran.code == 1
        assert words in ran.err
    assert path.read_bytes() == before


def test_an_interrupted_fit_keeps_what_is_done(mbstudio, small_scan_file, tmp_path, monkeypatch):
    from mbstudio.core.batch import many_fits

    fit_many = many_fits.fit_many

    def interrupted(*arguments, **options):
        items = fit_many(*arguments, **options)
        yield next(items)
        signal.raise_signal(signal.SIGINT)
        yield next(items)

    monkeypatch.setattr(many_fits, "fit_many", interrupted)
    path = tmp_path / "part.mbs"
    # A suite that runs in the background of a shell inherits an ignored SIGINT.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        ran = mbstudio(
            "fit", small_scan_file, "--voxel-size", "14 um", "-n", 4, "--workers", 0, "-o", path, "--json"
        )
    finally:
        signal.signal(signal.SIGINT, before)
    assert ran.code == 130
    assert "2 grains are left" in ran.err
    assert json.loads(ran.out)["interrupted"] is True
    assert len(Project.open(path).fits) == 1


def test_fit_and_measure_a_mesh(mbstudio, tmp_path):
    body = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    body.apply_translation([10, 20, 30])
    body.export(tmp_path / "ball.stl")
    ran = mbstudio(
        "fit", tmp_path / "ball.stl", "--unit", "mm", "--resolution", 40, "-n", 12,
        "-o", tmp_path / "ball.mbs", "--workers", 0, "--json",
    )  # fmt: skip
    assert ran.code == 0
    assert json.loads(ran.out)["valid"] == 1
    project = Project.open(tmp_path / "ball.mbs")
    assert project.scan is None
    mesh = project.avatars[0].mesh()
    assert project.avatars[0].unit == "mm"
    assert mesh.volume == pytest.approx(body.volume, rel=0.05)
    np.testing.assert_allclose(mesh.center_mass, [10, 20, 30], atol=0.1)

    ran = mbstudio("measure", tmp_path / "ball.stl", "--unit", "mm", "--json")
    factors = json.loads(ran.out)
    assert factors["unit"] == "mm"
    assert factors["dn"] == pytest.approx(4.0, rel=0.01)


def test_measure_a_project(mbstudio, fitted_project, tmp_path):
    table = tmp_path / "factors.csv"
    ran = mbstudio("measure", fitted_project, "--csv", table, "--unit", "mm", "--json")
    assert ran.code == 0
    result = json.loads(ran.out)
    assert len(result["grains"]) == 3
    for row in result["grains"]:
        expected = row["avatar"]["volume"] / row["grain"]["volume"] - 1
        assert row["relative_error"]["volume"] == pytest.approx(expected)
        assert abs(row["relative_error"]["volume"]) < 0.05
        # 14 um voxels and radii of 8 to 12 of them
        assert 2 * 8 * 0.014 < row["grain"]["dn"] < 2 * 12 * 0.014
    with table.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["label"]) for row in rows] == [row["label"] for row in result["grains"]]
    assert float(rows[0]["grain_sphericity"]) == pytest.approx(result["grains"][0]["grain"]["sphericity"])


def test_measure_prints_a_table(mbstudio, fitted_project):
    ran = mbstudio("measure", fitted_project, "--limit", 1)
    assert ran.code == 0
    assert "sphericity" in ran.out


@pytest.mark.parametrize("target", ["stl", "metaball", "liggghts", "pfc", "comflusom"])
def test_export(mbstudio, fitted_project, tmp_path, target):
    folder = tmp_path / "out"
    ran = mbstudio(
        "export", fitted_project, "--to", target, "--density", 2650, "--unit", "mm", "-o", folder, "--json"
    )
    assert ran.code == 0
    result = json.loads(ran.out)
    assert result["avatars"] == 3
    assert sorted(entry.name for entry in folder.iterdir()) == sorted(
        Path(name).name for name in result["files"]
    )


def test_export_tells_its_targets_with_their_options(mbstudio):
    ran = mbstudio("export", "--targets")
    assert ran.code == 0
    assert "lammps: LAMMPS rigid molecules, needs --density" in ran.out
    assert "    spheres=40  spheres in each clump" in ran.out


def test_export_of_a_specimen(mbstudio, fitted_project, tmp_path):
    folder = tmp_path / "out"
    ran = mbstudio(
        "export", fitted_project, "--to", "lammps", "--density", 2650, "--spheres", 4, "-o", folder,
        "--specimen", 15, "--curve", "100:0,200:50,300:100 um", "--seed", 3, "--json",
    )  # fmt: skip
    assert ran.code == 0
    assert "in.specimen" in {Path(name).name for name in json.loads(ran.out)["files"]}
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["specimen"]["count"] == 15
    assert manifest["specimen"]["seed"] == 3
    assert manifest["specimen"]["wanted"] == {"unit": "um", "sizes": [100, 200, 300], "finer": [0, 50, 100]}
    rows = np.loadtxt(folder / "specimen.csv", delimiter=",", skiprows=1, usecols=range(1, 10))
    assert rows.shape == (15, 9)
    assert rows[:, 1].min() >= 100e-6  # sizes, in m
    assert rows[:, 1].max() <= 300e-6


def test_export_of_clumps_that_reach_a_target(mbstudio, fitted_project, tmp_path):
    command = ("export", fitted_project, "--to", "pfc", "-o", tmp_path / "out", "--json")
    label = str(min(Project.open(fitted_project).fits))
    command += ("--select", label)
    ran = mbstudio(*command, "--clump-target", "iou 0.7 and volume 1 %")
    assert ran.code == 0
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    for item in manifest["items"]:
        assert item["details"]["iou"] >= 0.7
        assert item["details"]["spheres"] < 40
    ran = mbstudio(*command, "--clump-target", "iou 0.9", "--spheres", 5)
    assert ran.code != 0
    assert "Give either" in ran.err


def test_export_of_meshes_within_an_error(mbstudio, fitted_project, tmp_path):
    label = str(min(Project.open(fitted_project).fits))
    triangles = {}
    for error in (0.4, 4):
        folder = tmp_path / str(error)
        ran = mbstudio(
            "export", fitted_project, "--to", "obj", "-o", folder, "--select", label, "--error", error
        )
        assert ran.code == 0
        (item,) = json.loads((folder / "manifest.json").read_text())["items"]
        assert item["details"]["hausdorff_over_Dn"] <= error / 100
        triangles[error] = item["details"]["triangles"]
    assert triangles[0.4] > triangles[4]
    ran = mbstudio("export", fitted_project, "--to", "pfc", "-o", tmp_path / "no", "--error", 1)
    assert ran.code != 0
    assert "no option 'error'" in ran.err


def test_export_of_named_avatars_with_options(mbstudio, fitted_project, tmp_path):
    labels = sorted(Project.open(fitted_project).fits)[:2]
    ran = mbstudio(
        "export", fitted_project, "--to", "liggghts", "--density", 2650, "--spheres", 12,
        "-o", tmp_path / "out", "--select", ",".join(map(str, labels)), "--json",
    )  # fmt: skip
    assert ran.code == 0
    assert json.loads(ran.out)["avatars"] == 2
    clumps = list((tmp_path / "out").glob("*.multisphere"))
    assert len(clumps) == 2
    for clump in clumps:
        rows = [line for line in clump.read_text().splitlines() if line and not line.startswith("#")]
        assert 2 <= len(rows) <= 12


def test_doctor(mbstudio):
    ran = mbstudio("doctor", "--json")
    assert ran.code == 0
    result = json.loads(ran.out)
    assert result["packages"]["numpy"] == np.__version__
    assert result["opengl"]["largest_3d_texture"] >= 256
    assert result["opengl"]["renderer"]
    assert result["cores"] >= 1
    assert "LIGGGHTS" in result["engines"]


def test_doctor_survives_an_opengl_that_crashes(monkeypatch):
    from mbstudio.cli import doctor

    monkeypatch.setattr(doctor, "_ASK_OPENGL", "import os; os.abort()")
    assert "code -6" in doctor.ask_opengl()["error"]


def test_a_scan_that_moved_can_be_given(mbstudio, small_scan_file, tmp_path):
    moved = tmp_path / "scan.tif"
    moved.write_bytes(small_scan_file.read_bytes())
    assert mbstudio("segment", moved, "--voxel-size", "14 um", "-o", tmp_path / "a.mbs").code == 0
    moved.rename(tmp_path / "elsewhere.tif")
    ran = mbstudio("segment", tmp_path / "a.mbs")
    assert ran.code == 1
    assert "scan.tif does not exist" in ran.err
    ran = mbstudio("segment", tmp_path / "a.mbs", "--scan", tmp_path / "elsewhere.tif", "--json")
    assert json.loads(ran.out)["grains"] == 4


def test_output_into_a_closed_pipe_is_no_fault(fitted_project):
    command = [sys.executable, "-m", "mbstudio", "measure", str(fitted_project), "--limit", "1", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    process.wait()
    assert "Traceback" not in error
    assert "fault" not in error


def test_figures_refuses_a_file_as_folder(mbstudio, tmp_path):
    (tmp_path / "figures").write_text("")
    ran = mbstudio("figures", "--out", tmp_path / "figures")
    assert ran.code == 1
    assert "is a file" in ran.err
    assert "mbstudio: " in ran.err


def test_figures_draws_into_the_folder(mbstudio, tmp_path, monkeypatch):
    from mbstudio.scene.figures import paper_figures

    drawn = []

    def draw(folder, plan, progress):
        drawn.append(plan)
        (folder / "figure_2.png").write_bytes(b"")
        return [folder / "figure_2.png"]

    monkeypatch.setattr(paper_figures, "render_paper_figures", draw)
    ran = mbstudio("figures", "--out", tmp_path / "new", "--grains", "1", "--diameter", "30", "--json")
    assert ran.code == 0
    assert json.loads(ran.out)["files"] == ["figure_2.png"]
    assert (drawn[0].grains, drawn[0].diameter) == (1, 30)
