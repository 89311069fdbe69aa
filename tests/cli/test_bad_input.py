"""Bad input: one message that names the file, a code other than 0, and nothing overwritten."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
import trimesh


@pytest.fixture
def bad(tmp_path, small_scan_file, fitted_project):
    """Makes one bad input by its name."""
    voxels = tifffile.imread(small_scan_file)

    def make(kind: str) -> Path:
        path = tmp_path / f"{kind}.tif"
        if kind == "missing":
            return path
        if kind == "empty":
            path.touch()
        elif kind == "truncated":
            path.write_bytes(small_scan_file.read_bytes()[:50_000])
        elif kind == "text":
            path.write_text("these are no voxels")
        elif kind == "constant":
            tifffile.imwrite(path, np.full((20, 20, 20), 7, np.uint16), photometric="minisblack")
        elif kind == "nan":
            broken = voxels.astype(np.float32)
            broken[...] = np.nan
            tifffile.imwrite(path, broken, photometric="minisblack")
        elif kind == "slices":
            path = tmp_path / kind
            path.mkdir()
            for index, size in enumerate((30, 30, 31)):
                tifffile.imwrite(path / f"{index}.tif", voxels[0, :size, :30], photometric="minisblack")
        elif kind == "short":
            path = tmp_path / "short.raw"
            path.write_bytes(b"12345")
        elif kind == "open":
            path = tmp_path / "open.ply"
            body = trimesh.creation.icosphere(subdivisions=2)
            body.update_faces(np.arange(len(body.faces)) > 3)
            body.export(path)
        elif kind == "halved":
            path = tmp_path / "halved.mbs"
            whole = fitted_project.read_bytes()
            path.write_bytes(whole[: len(whole) // 2])
        elif kind == "foreign":
            path = tmp_path / "foreign.mbs"
            with h5py.File(path, "w") as file:
                file["x"] = 1
        return path

    return make


SCANS = ("missing", "empty", "truncated", "text", "constant", "nan", "slices")


@pytest.mark.parametrize("kind", SCANS)
@pytest.mark.parametrize("command", ["segment", "fit"])
def test_a_bad_scan(mbstudio, bad, tmp_path, command, kind):
    path = bad(kind)
    output = tmp_path / "out.mbs"
    ran = mbstudio(command, path, "--voxel-size", "14 um", "-o", output)
    assert_one_message(ran, path.name)
    assert not output.exists()


def assert_one_message(ran, *named: str) -> None:
    assert ran.code == 1
    assert ran.out == ""
    messages = [line for line in ran.err.splitlines() if line.startswith("mbstudio: ")]
    assert len(messages) == 1, ran.err
    assert "Traceback" not in ran.err
    assert "bug in mbstudio" not in ran.err
    for name in named:
        assert name in messages[0]


def test_a_short_raw_file(mbstudio, bad):
    path = bad("short")
    ran = mbstudio("segment", path, "--voxel-size", "1 um", "--shape", "9,9,9", "--dtype", "uint16")
    assert_one_message(ran, "short.raw")


@pytest.mark.parametrize("shape", ["9,9", "a,b,c", "9x9x9x9"])
def test_a_shape_that_cannot_be_read(mbstudio, bad, shape):
    ran = mbstudio("segment", bad("short"), "--voxel-size", "1 um", "--shape", shape, "--dtype", "uint16")
    assert_one_message(ran, shape)


@pytest.mark.parametrize("size", [None, "-14 um", "0 um", "14", "14 parsec", "much"])
def test_a_bad_voxel_size(mbstudio, small_scan_file, tmp_path, size):
    given = [] if size is None else ["--voxel-size", size]
    ran = mbstudio("fit", small_scan_file, *given, "-o", tmp_path / "out.mbs")
    assert_one_message(ran, "small.tif" if size is None else size.split(" ")[-1])
    assert not (tmp_path / "out.mbs").exists()


@pytest.mark.parametrize("command", ["measure", "fit"])
def test_a_mesh_that_is_not_closed(mbstudio, bad, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    ran = mbstudio(command, bad("open"), "--unit", "mm")
    assert_one_message(ran, "open.ply")
    assert not (tmp_path / "open.mbs").exists()


@pytest.mark.real_data
def test_a_real_mesh_that_is_not_closed(mbstudio, shared_data, tmp_path):
    stone = trimesh.load(shared_data / "stones" / "stone_E22.ply")
    stone.update_faces(np.arange(len(stone.faces)) > 20)
    stone.export(tmp_path / "stone.ply")
    ran = mbstudio("fit", tmp_path / "stone.ply", "--unit", "m", "-o", tmp_path / "a.mbs")
    assert_one_message(ran, "stone.ply is not closed")
    assert not (tmp_path / "a.mbs").exists()


@pytest.mark.parametrize("kind", ["halved", "foreign"])
@pytest.mark.parametrize(
    "command", [("segment",), ("fit",), ("measure",), ("export", "--to", "stl", "-o", "out")]
)
def test_a_bad_project(mbstudio, bad, tmp_path, monkeypatch, kind, command):
    monkeypatch.chdir(tmp_path)
    path = bad(kind)
    before = path.read_bytes()
    ran = mbstudio(command[0], path, *command[1:])
    assert_one_message(ran, path.name)
    assert path.read_bytes() == before
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("n", [0, -3, 100_000])
def test_an_impossible_number_of_control_points(mbstudio, fitted_project, tmp_path, n):
    before = fitted_project.read_bytes()
    ran = mbstudio("fit", fitted_project, "-n", n, "--workers", 0, "--limit", 1, "-o", tmp_path / "a.mbs")
    assert ran.code == 1
    assert "Traceback" not in ran.err
    assert str(abs(n)) in ran.err.replace(",", "")
    assert fitted_project.read_bytes() == before


def test_a_project_of_avatars_does_not_give_way_to_one_without(mbstudio, fitted_project, tmp_path):
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.ply")
    (tmp_path / "kept.mbs").write_bytes(fitted_project.read_bytes())
    ran = mbstudio(
        "fit", tmp_path / "ball.ply", "--unit", "mm", "--resolution", 20, "-n", 5_000, "--workers", 0,
        "-o", tmp_path / "kept.mbs",
    )  # fmt: skip
    assert ran.code == 1
    assert "5000" in ran.err
    assert (tmp_path / "kept.mbs").read_bytes() == fitted_project.read_bytes()


def test_labels_that_are_not_there(mbstudio, fitted_project, tmp_path):
    assert_one_message(mbstudio("fit", fitted_project, "--grains", 77, "-o", tmp_path / "a.mbs"), "77")
    assert_one_message(mbstudio("fit", fitted_project, "--grains", "x", "-o", tmp_path / "a.mbs"), "--grains")
    ran = mbstudio("export", fitted_project, "--to", "stl", "-o", tmp_path / "o", "--select", "77")
    assert_one_message(ran, "77", "fitted.mbs")


def test_labels_of_another_shape(mbstudio, small_scan_file, tmp_path):
    tifffile.imwrite(tmp_path / "labels.tif", np.ones((3, 4, 5), np.uint8), photometric="minisblack")
    ran = mbstudio("segment", small_scan_file, "--voxel-size", "1 um", "--labels", tmp_path / "labels.tif")
    assert_one_message(ran, "labels.tif")


@pytest.mark.parametrize("name", ["scan.tif", "notes.txt"])
def test_an_output_that_is_something_else_is_not_overwritten(mbstudio, small_scan_file, tmp_path, name):
    path = tmp_path / name
    path.write_bytes(small_scan_file.read_bytes() if name == "scan.tif" else b"do not lose me")
    before = path.read_bytes()
    scan = path if name == "scan.tif" else small_scan_file
    ran = mbstudio("fit", scan, "--voxel-size", "14 um", "-o", path)
    assert_one_message(ran, name)
    assert path.read_bytes() == before


def test_a_project_is_not_overwritten_without_being_named(mbstudio, small_scan_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.mbs").write_bytes(b"an older project")
    ran = mbstudio("fit", small_scan_file, "--voxel-size", "14 um")
    assert_one_message(ran, "small.mbs")
    assert (tmp_path / "small.mbs").read_bytes() == b"an older project"


def test_an_output_in_a_folder_that_is_not_there(mbstudio, small_scan_file, tmp_path):
    ran = mbstudio("fit", small_scan_file, "--voxel-size", "14 um", "-o", tmp_path / "no" / "a.mbs")
    assert_one_message(ran, "a.mbs")


def test_an_output_in_a_read_only_folder(mbstudio, fitted_project, read_only_folder):
    table = read_only_folder / "a.csv"
    assert_one_message(mbstudio("measure", fitted_project, "--csv", table, "--limit", 1), "a.csv")
    ran = mbstudio("export", fitted_project, "--to", "stl", "-o", read_only_folder / "out")
    assert_one_message(ran, str(read_only_folder))
    assert_one_message(mbstudio("tour", "--out", read_only_folder / "tour"), str(read_only_folder))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits the size of files as Linux does")
def test_a_full_disk(fitted_project, tmp_path):
    """The kernel refuses to write beyond a limit: the project saved before stays whole."""
    path = tmp_path / "sand.mbs"
    path.write_bytes(fitted_project.read_bytes())
    script = (
        "import resource, signal; from mbstudio.cli import main; from mbstudio.core.project import Project;"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); save = Project.save;"
        "fill = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000));"
        "Project.save = lambda *a, **k: fill() or save(*a, **k);"
        f"main(['fit', {str(path)!r}, '-n', '4', '--workers', '0', '--limit', '1'])"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert run.returncode == 1
    assert "sand.mbs cannot be saved" in run.stderr
    assert "Traceback" not in run.stderr
    assert path.read_bytes() == fitted_project.read_bytes()
    assert not list(tmp_path.glob("*.part"))


def test_exports_that_make_no_sense(mbstudio, fitted_project, tmp_path):
    out = tmp_path / "out"
    assert_one_message(mbstudio("export", fitted_project, "--to", "edem9", "-o", out), "edem9")
    assert_one_message(mbstudio("export", fitted_project, "--to", "liggghts", "-o", out), "density")
    ran = mbstudio("export", fitted_project, "--to", "liggghts", "--density", -1, "-o", out)
    assert_one_message(ran, "-1")
    assert_one_message(
        mbstudio("export", fitted_project, "--to", "stl", "-o", out, "--option", "x"), "--option x"
    )
    ran = mbstudio("export", fitted_project, "--to", "lammps", "--density", 2650, "--unit", "mm", "-o", out)
    assert_one_message(ran, "always in m")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--curve", "1:0,2:100"], "--specimen N"),
        (["--specimen", 10, "--curve", "1,2"], "cannot be read"),
        (["--specimen", 10, "--curve", "1:0,2:100 furlong"], "furlong"),
        (["--specimen", 10, "--curve", "1:0,2:90"], "0 to 90"),
        (["--specimen", 0, "--curve", "1:0,2:100"], "specimen needs at least 1 particle, not 0"),
        (["--specimen", 10, "--curve", "1:0,2:100", "--share", "nobody=1"], "nobody"),
        (["--specimen", 10, "--curve", "1:0,2:100", "--share", "nobody=much"], "much"),
        (["--specimen", 10, "--curve", "1:0,2:100", "--box-width", 0.5], "no room"),
    ],
)
def test_specimens_that_make_no_sense(words, message, mbstudio, fitted_project, tmp_path):
    out = tmp_path / "out"
    ran = mbstudio("export", fitted_project, "--to", "edem", "--option", "spheres=2", "-o", out, *words)
    assert_one_message(ran, message)
    assert not out.exists()


def test_an_export_folder_with_other_files(mbstudio, fitted_project, tmp_path):
    (tmp_path / "thesis.tex").write_text("do not lose me")
    ran = mbstudio("export", fitted_project, "--to", "stl", "-o", tmp_path)
    assert_one_message(ran, str(tmp_path))
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_tour_into_a_folder_with_other_files(mbstudio, tmp_path):
    (tmp_path / "thesis.tex").write_text("do not lose me")
    assert_one_message(mbstudio("tour", "--out", tmp_path), "thesis.tex")
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_measuring_what_is_no_body(mbstudio, small_scan_file, tmp_path):
    assert_one_message(mbstudio("measure", small_scan_file), "small.tif")
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    assert_one_message(mbstudio("measure", tmp_path / "broken.stl"), "broken.stl")
    assert_one_message(mbstudio("measure", tmp_path / "none.ply"), "none.ply")


def test_the_table_never_replaces_what_is_measured(mbstudio, fitted_project):
    before = fitted_project.read_bytes()
    assert_one_message(mbstudio("measure", fitted_project, "--csv", fitted_project), "fitted.mbs")
    assert fitted_project.read_bytes() == before


@pytest.mark.parametrize("words", [["fit"], ["nonsense"], ["fit", "a.tif", "--no-such"], ["export", "a.mbs"]])
def test_a_wrong_call_exits_with_2(mbstudio, words):
    ran = mbstudio(*words)
    assert ran.code == 2
    assert "Traceback" not in ran.err


def test_the_window_without_a_display(mbstudio, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform.startswith("linux"):
        assert_one_message(mbstudio("gui"), "no display")


def test_debug_shows_where(capsys, tmp_path):
    from mbstudio.cli import main
    from mbstudio.core.errors import ProjectError

    with pytest.raises(ProjectError):
        main(["--debug", "measure", str(tmp_path / "none.mbs")])


def test_an_unknown_way_with_cavities(mbstudio, fitted_project, tmp_path):
    ran = mbstudio(
        "fit", fitted_project, "--refit", "--limit", 1, "--workers", 0, "--cavities", "leave",
        "-o", tmp_path / "a.mbs",
    )  # fmt: skip
    assert_one_message(ran, "cavities=leave")
    assert not (tmp_path / "a.mbs").exists()


def test_filled_cavities_are_told_and_kept_on_request(mbstudio, tmp_path):
    labels = np.zeros((30, 30, 30), np.uint8)
    square = ((np.indices(labels.shape) - 15) ** 2).sum(axis=0)
    labels[(square < 100) & (square > 16)] = 1
    tifffile.imwrite(tmp_path / "scan.tif", (labels * 200).astype(np.uint16), photometric="minisblack")
    tifffile.imwrite(tmp_path / "labels.tif", labels, photometric="minisblack")
    call = ("fit", tmp_path / "scan.tif", "--voxel-size", "5 um", "--labels", tmp_path / "labels.tif",
            "--workers", 0, "-n", 30, "--grains", 1)  # fmt: skip
    ran = mbstudio(*call, "-o", tmp_path / "filled.mbs")
    assert ran.code == 0
    assert "grain 1: Cavities of 257 voxels inside the grain were filled" in ran.err
    ran = mbstudio(*call, "--cavities", "keep", "-o", tmp_path / "kept.mbs")
    assert ran.code == 0
    assert "grain 1: The grain's cavities (1) were kept as requested" in ran.err
