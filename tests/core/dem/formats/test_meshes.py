"""STL, OBJ and PLY: read back by others, refused by ours when corrupted, taken by a real engine."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mbstudio.core.dem import export, validate
from mbstudio.core.errors import ExportError
from mbstudio.core.metrics import mass_properties

FORMS = [("stl", {}), ("stl", {"binary": True}), ("obj", {}), ("ply", {})]


@pytest.mark.parametrize(("target", "options"), FORMS)
@pytest.mark.parametrize("unit", ["m", "mm", "um"])
def test_another_reader_sees_a_centred_closed_solid_of_the_right_size(
    target, options, unit, avatar, tmp_path
):
    report = export(avatar, target, tmp_path / "out", density=2650, unit=unit, cells=16, **options)
    (name,) = report.items[0]["files"]
    mesh = trimesh.load_mesh(tmp_path / "out" / name)
    expected = mass_properties(avatar, 2650).to(unit)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(expected.volume, rel=1e-3)
    size = expected.volume ** (1 / 3)
    assert mesh.center_mass / size == pytest.approx(np.zeros(3), abs=2e-3)
    tensor = mesh.moment_inertia / mesh.volume * expected.volume * (expected.mass / expected.volume)
    assert np.diag(tensor) == pytest.approx(expected.principal, rel=0.01)
    assert np.abs(tensor - np.diag(np.diag(tensor))).max() < 0.005 * expected.principal.max()
    details = report.items[0]["details"]
    assert details["smallest_angle_degrees"] > 22
    assert details["triangles"] == len(mesh.faces)


def test_the_default_unit_is_the_metre(avatar, tmp_path):
    assert export(avatar, "stl", tmp_path / "out", cells=12).manifest["unit"] == "m"


def test_the_files_of_the_ring_have_its_hole(ring, tmp_path):
    report = export(ring, "ply", tmp_path / "out", cells=24)
    assert report.items[0]["details"]["euler_number"] == 0
    assert trimesh.load_mesh(report.files[0]).euler_number == 0


def _obj_lines(path: Path) -> list[str]:
    return path.read_text().splitlines()


CORRUPTIONS = {
    "a face is missing": (lambda lines: lines[:-1], "not a closed"),
    "turned inside out": (
        lambda lines: [
            " ".join([*line.split()[:1], *line.split()[:0:-1]]) if line[0] == "f" else line for line in lines
        ],
        "inside out",
    ),
    "shifted": (
        lambda lines: [
            f"v {float(line.split()[1]) + 1} {line.split()[2]} {line.split()[3]}" if line[0] == "v" else line
            for line in lines
        ],
        "centre of mass",
    ),
    "another unit": (
        lambda lines: [
            "v " + " ".join(str(float(x) * 1000) for x in line.split()[1:]) if line[0] == "v" else line
            for line in lines
        ],
        "has a volume of",
    ),
    "not a number": (lambda lines: [lines[0], "v nan 0 0", *lines[2:]], "finite|closed|read back"),
    "cut in half": (lambda lines: lines[: len(lines) // 2], "no faces|closed|read back|no single"),
    "empty": (lambda lines: [], "no faces|closed|read back|no single"),
}


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_a_corrupted_mesh_is_refused(kind, avatar, tmp_path):
    (path, *_) = export(avatar, "obj", tmp_path / "out", unit="mm", cells=12).files
    change, message = CORRUPTIONS[kind]
    path.write_text("\n".join(change(_obj_lines(path))))
    with pytest.raises(ExportError, match=message) as caught:
        validate(tmp_path / "out", digests=False)
    assert str(path) in str(caught.value)


def test_a_sliver_is_refused(avatar, tmp_path):
    (path, *_) = export(avatar, "stl", tmp_path / "out", unit="mm", cells=12).files
    mesh = trimesh.load_mesh(path)
    vertices = np.array(mesh.vertices)
    first, second = mesh.faces[0][:2]
    vertices[first] = vertices[second] + 1e-4 * (vertices[first] - vertices[second])
    trimesh.Trimesh(vertices, mesh.faces, process=False).export(path)
    with pytest.raises(ExportError, match="thinner than"):
        validate(tmp_path / "out", digests=False)


DECK = """units si
atom_style granular
atom_modify map array sort 0 0
boundary f f f
newton off
communicate single vel yes
region domain block -1 1 -1 1 -1 1 units box
create_box 1 domain
neighbor 0.001 bin
neigh_modify delay 0
fix m1 all property/global youngsModulus peratomtype 5e6
fix m2 all property/global poissonsRatio peratomtype 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.3
fix m4 all property/global coefficientFriction peratomtypepair 1 0.5
pair_style gran model hertz tangential history
pair_coeff * *
fix body all mesh/surface file {name} type 1 scale {scale}
fix wall all wall/gran model hertz tangential history mesh n_meshes 1 meshes body
run 1
"""


def test_liggghts_takes_the_mesh_and_refuses_one_with_slivers(avatar, liggghts, tmp_path):
    out = tmp_path / "out"
    (path, *_) = export(avatar, "stl", out, unit="mm", cells=24).files

    def run(name: str) -> subprocess.CompletedProcess[str]:
        # The mesh is scaled up: LIGGGHTS compares lengths with fixed precisions.
        (out / "deck").write_text(DECK.format(name=name, scale=0.1))
        command = [liggghts, "-in", "deck", "-log", "none"]
        return subprocess.run(command, cwd=out, capture_output=True, text=True, timeout=120, check=False)

    good = run(path.name)
    assert good.returncode == 0, good.stdout[-2000:] + good.stderr
    assert "Loop time" in good.stdout
    raw = avatar.mesh(cells=48)
    raw.apply_translation(-raw.center_mass)
    (out / "raw.stl").write_text(trimesh.exchange.stl.export_stl_ascii(raw))
    assert run("raw.stl").returncode != 0
