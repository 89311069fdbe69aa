"""LAMMPS molecules: what the engine finds of them, how they fall and settle, and what ours refuses."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbstudio.core.dem import export
from mbstudio.core.dem.shapes.point_masses import balanced_masses
from mbstudio.core.errors import ExportError
from mbstudio.core.metrics import mass_properties
from mbstudio.core.packing.reading import read_packing
from tests.core.dem.corruption import assert_refused


def run_deck(lammps: str, folder: Path, deck: str = "in.settle") -> str:
    """Run a deck in its folder and return its log."""
    command = [lammps, "-in", deck, "-log", "log.lammps"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=240, check=False, env=environment
    )
    log = (folder / "log.lammps").read_text()
    assert done.returncode == 0, log[-3000:] + done.stdout[-2000:] + done.stderr
    return log


def thermo_rows(log: str) -> np.ndarray:
    """Return the numbers that a run printed."""
    lines = [line.split() for line in log.splitlines() if re.fullmatch(r"(\s+[-+0-9.eE]+)+\s*", line)]
    width = max(len(line) for line in lines)
    return np.array([line for line in lines if len(line) == width], dtype=float)


def table_of(path: Path) -> np.ndarray:
    """Return the rows of a dump of local values."""
    lines = path.read_text().split("ENTRIES")[-1].splitlines()[1:]
    return np.array([line.split() for line in lines], dtype=float)


FREE_FALL = """units si
atom_style sphere
atom_modify map array
boundary f f f
newton off
comm_modify vel yes cutoff 0.02
region domain block -0.02 0.02 -0.02 0.02 -0.2 0.1 units box
create_box 1 domain
fix mol all property/atom mol ghost yes
neigh_modify exclude molecule/intra all
pair_style gran/hooke/history 1 1 1 1 0.5 1
pair_coeff * *
timestep 1e-4
molecule one {molecule}
fix gravity all gravity 9.81 vector 0 0 -1 {gravity}
fix bodies all rigid/small molecule mol one reinit no {applied}
region above block -0.019 0.019 -0.019 0.019 0.03 0.09 units box
fix pour all pour 1 0 4711 region above mol one rigid bodies vel 0 0 0 0 0
thermo_style custom step atoms
run 1
unfix pour
compute local all rigid/local bodies mol mass inertiax inertiay inertiaz omegax omegay omegaz vz
dump local all local 1000 bodies.* c_local[*]
dump_modify local first yes format float %.12g
run 1000
"""


def fall(lammps: str, folder: Path, molecule: str, *, whole_bodies: bool) -> tuple[np.ndarray, np.ndarray]:
    """Let one molecule fall; return its mass, moments, spin and velocity in the first and the last step."""
    gravity, applied = ("disable", "gravity gravity") if whole_bodies else ("", "")
    (folder / "in.fall").write_text(FREE_FALL.format(molecule=molecule, gravity=gravity, applied=applied))
    run_deck(lammps, folder, "in.fall")
    dumps = sorted(folder.glob("bodies.*"), key=lambda path: int(path.suffix[1:]))
    first, last = table_of(dumps[0])[0], table_of(dumps[-1])[0]
    for dump in dumps:
        dump.unlink()
    return first, last


@pytest.fixture(scope="module")
def exported(avatar, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("lammps") / "out"
    export(avatar, "lammps", folder, density=2650, spheres=6)
    return folder


@pytest.mark.parametrize("whole_bodies", [True, False])
def test_mass_and_moments_are_ours_and_a_falling_clump_does_not_turn(
    whole_bodies, avatar, lammps, exported, tmp_path
):
    (tmp_path / "grain_1.mol").write_text((exported / "grain_1.mol").read_text())
    first, last = fall(lammps, tmp_path, "grain_1.mol", whole_bodies=whole_bodies)
    expected = mass_properties(avatar, 2650).to("m")
    assert first[1] == pytest.approx(expected.mass, rel=1e-5)
    assert np.sort(first[2:5]) / expected.principal == pytest.approx(1, rel=1e-5)
    assert last[8] - first[8] == pytest.approx(-9.81 * 999e-4, rel=1e-3)
    assert np.abs(last[5:8]).max() < 1e-9


def test_equal_masses_would_make_it_turn(lammps, exported, tmp_path):
    """What the balanced masses are for: with M / n for each sphere the engine's gravity turns the clump."""
    (tmp_path / "equal.mol").write_text(_equal_masses((exported / "grain_1.mol").read_text()))
    _, last = fall(lammps, tmp_path, "equal.mol", whole_bodies=False)
    assert np.abs(last[5:8]).max() > 1e-3


def test_a_turned_molecule_pins_the_order_of_the_tensor(lammps, exported, tmp_path):
    """The engine reads Ixx Iyy Izz Iyz Ixz Ixy; the order that its documentation gives is not ours either."""
    text = (exported / "grain_1.mol").read_text()
    moments = [float(word) for word in re.search(r"(\S+ \S+ \S+) 0 0 0 inertia", text)[1].split()]
    rotation = Rotation.from_rotvec([0.5, -0.8, 0.3]).as_matrix()
    tensor = rotation @ np.diag(moments) @ rotation.T
    coords = re.search(r"Coords\n\n(.*?)\n\n", text, re.DOTALL)[1]
    rows = np.array([line.split() for line in coords.splitlines()], dtype=float)
    rows[:, 1:] = rows[:, 1:] @ rotation.T
    turned = "\n".join(f"{int(i)} {x:.17g} {y:.17g} {z:.17g}" for i, x, y, z in rows)

    def moments_for(entries: str) -> np.ndarray:
        xx, yy, zz = tensor.diagonal()
        off = {"xy": tensor[0, 1], "xz": tensor[0, 2], "yz": tensor[1, 2]}
        line = " ".join(f"{value:.17g}" for value in [xx, yy, zz, *(off[e] for e in entries.split())])
        changed = re.sub(r"\S+ \S+ \S+ 0 0 0 inertia", line + " inertia", text).replace(coords, turned)
        (tmp_path / "turned.mol").write_text(changed)
        return np.sort(fall(lammps, tmp_path, "turned.mol", whole_bodies=True)[0][2:5]) / moments

    assert moments_for("yz xz xy") == pytest.approx(1, rel=1e-5)
    assert moments_for("xy xz yz") != pytest.approx(1, rel=1e-3)


def test_ten_molecules_settle_and_none_is_lost(avatars, lammps, tmp_path):
    out = tmp_path / "out"
    export(avatars, "lammps", out, density=2650, spheres=8, poured=10)
    log = run_deck(lammps, out)
    rows = thermo_rows(log)
    atoms, energy, highest = rows[:, 1], rows[:, 2] + rows[:, 3], rows[:, 4]
    assert atoms[-1] == atoms.max() == 10 * 8
    assert energy[-1] < 0.02 * energy.max()
    assert highest[-1] < 0.35 * highest.max()
    told = re.search(r"^SETTLED 10 grains, porosity (\S+), height \S+ m, \S+ .* overlap (\S+) m", log, re.M)
    assert 0 < float(told[1]) < 1
    assert {"settled.data", "settled.restart", "settled.moving.lammpstrj"} <= {f.name for f in out.iterdir()}
    back = read_packing(out / "settled.lammpstrj", avatars)
    assert len(back) == 10
    assert back.poses.scales == pytest.approx(np.ones(10))
    # What the deck calls the overlap of grains is the force over the stiffness, which damping adds to.
    assert back.unit == "m"
    assert back.overlap * back.mean_diameter == pytest.approx(float(told[2]), rel=0.3)


WRONG = {
    "too long a step": (r"^timestep (\S+)", lambda m: f"timestep {60 * float(m[1]):.6e}"),
    "too soft": (
        r"hooke/history (\S+) (\S+)",
        lambda m: f"hooke/history {float(m[1]) / 300:.6e} {float(m[2]) / 300:.6e}",
    ),
    "grains lost": (r"^(run \d+)$", r"run 4000\ndelete_atoms random 0.2 yes all NULL 4\n\1"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_run_that_goes_wrong_ends_with_an_error(kind, avatars, lammps, tmp_path):
    out = tmp_path / "out"
    export(avatars, "lammps", out, density=2650, spheres=8, poured=10)
    deck = out / "in.settle"
    deck.write_text(re.sub(WRONG[kind][0], WRONG[kind][1], deck.read_text(), flags=re.MULTILINE))
    done = subprocess.run(
        [lammps, "-in", deck.name], cwd=out, capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode != 0
    assert "ERROR" in done.stdout


def test_the_deck_takes_no_more_steps_than_its_packing_needs(avatars, tmp_path):
    """Stiff for the mean grain: for the heaviest on the smallest sphere it took ten times as many."""
    report = export(avatars, "lammps", tmp_path / "out", density=2650, spheres=20, poured=192)
    text = (tmp_path / "out" / "in.settle").read_text()
    steps = int(re.search(r"^run (\d+)", text, re.MULTILINE)[1])
    assert steps < 60_000
    assert f"# It takes {steps:,} steps of " in text
    assert report.runs["in.settle"]["steps"] == steps
    assert report.runs["in.settle"]["hours"] == pytest.approx(steps * 192 * 20 * 1.5e-7 / 3600)


def test_a_deck_that_would_run_for_weeks_is_refused_unless_asked_for(avatars, tmp_path):
    """Sizes over a hundred: the smallest grain sets the step, the largest the stiffness."""
    mixed = [avatars[0], avatars[1].scaled(100.0)]
    with pytest.raises(ExportError, match=r"in\.settle would take [\d,]+ steps .* as the smallest"):
        export(mixed, "lammps", tmp_path / "out", density=2650, spheres=20, poured=2000)
    assert not (tmp_path / "out").exists()
    report = export(mixed, "lammps", tmp_path / "out", density=2650, spheres=20, poured=2000, hours=1e6)
    assert report.runs["in.settle"]["hours"] > 24


def test_the_molecule_is_written_as_the_engine_wants_it(avatar, tmp_path):
    out = tmp_path / "out"
    report = export(avatar, "lammps", out, density=2650, spheres=7)
    text = (out / "grain_1.mol").read_text()
    lines = text.splitlines()
    expected = mass_properties(avatar, 2650).to("m")
    assert lines[2] == "7 atoms"
    assert float(lines[3].removesuffix(" mass")) == pytest.approx(expected.mass, rel=1e-9)
    assert lines[4] == "0 0 0 com"
    found = np.array(lines[5].split()[:3], dtype=float)
    assert found / expected.principal == pytest.approx(1, rel=1e-9)
    for keyword in ("Coords", "Types", "Diameters", "Masses"):
        place = lines.index(keyword)
        assert lines[place - 1] == lines[place + 1] == ""
        assert lines[place + 2].startswith("1 ")
    assert report.items[0]["details"]["balanced_masses"] is True


def _equal_masses(text: str) -> str:
    head, masses = text.split("Masses\n\n")
    rows = [line.split() for line in masses.splitlines()]
    mean = np.mean([float(row[1]) for row in rows])
    return head + "Masses\n\n" + "\n".join(f"{row[0]} {mean:.17g}" for row in rows) + "\n"


CORRUPTIONS = {
    "negative moment": (lambda t: re.sub(r"(\S+)( \S+ \S+ 0 0 0 inertia)", r"-\1\2", t), "'inertia'"),
    "moments reordered": (lambda t: re.sub(r"(\S+) (\S+) (\S+ 0 0 0 inertia)", r"\2 \1 \3", t), "'inertia'"),
    "not principal": (lambda t: t.replace("0 0 0 inertia", "1e-12 0 0 inertia"), "'inertia'"),
    "no inertia": (lambda t: re.sub(r".* inertia\n", "", t), "lacks 'inertia'"),
    "no mass": (lambda t: re.sub(r"\S+ mass\n", "", t), "lacks 'mass'"),
    "mass of another grain": (lambda t: re.sub(r"\S+ mass", "1e-3 mass", t), "'mass' 1e-3"),
    "centre of mass": (lambda t: t.replace("0 0 0 com", "0 0 1e-3 com"), "'com'"),
    "count": (lambda t: t.replace("6 atoms", "5 atoms"), "'atoms' 5"),
    "blank line missing": (lambda t: t.replace("Coords\n\n", "Coords\n"), "no empty line after 'Coords'"),
    "blank line amid": (lambda t: t.replace("\n2 1\n", "\n\n2 1\n"), "where a section"),
    "section missing": (lambda t: t.partition("\nMasses")[0], "lacks the section 'Masses'"),
    "section misspelt": (lambda t: t.replace("Diameters", "Diameter"), "where a"),
    "text for a number": (
        lambda t: re.sub(r"Diameters\n\n1 \S+", "Diameters\n\n1 big", t),
        "not two numbers",
    ),
    "negative diameter": (lambda t: re.sub(r"Diameters\n\n1 ", "Diameters\n\n1 -", t), "not positive"),
    "not finite": (lambda t: re.sub(r"Coords\n\n1 \S+", "Coords\n\n1 nan", t), "not finite"),
    "atoms out of order": (lambda t: t.replace("\n2 1\n", "\n3 1\n"), "does not number its Types"),
    "another type": (lambda t: t.replace("\n2 1\n", "\n2 2\n"), "types other than 1"),
    "radii as diameters": (
        lambda t: re.sub(
            r"(?s)(Diameters\n\n)(.*?)(\n\nMasses)",
            lambda m: m[1] + re.sub(r" (\S+)", lambda d: f" {float(d[1]) / 2}", m[2]) + m[3],
            t,
        ),
        "size differs",
    ),
    "masses unbalanced": (_equal_masses, "begins to turn"),
    "masses of another body": (lambda t: re.sub(r"(Masses\n\n1) \S+", r"\1 1e-3", t), "do not sum up"),
    "empty": (lambda t: "", "lacks 'atoms'"),
}


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_a_corrupted_molecule_is_refused(kind, exported):
    assert_refused(exported, "grain_1.mol", *CORRUPTIONS[kind])


def test_a_deck_without_its_molecules_is_refused(exported):
    assert_refused(exported, "in.settle", lambda t: t.replace("grain_1.mol", ""), "does not load")


def test_balanced_masses_by_hand():
    """Two points at -1 and 2: only the masses 2/3 and 1/3 have their centre at the origin."""
    masses, balanced = balanced_masses(np.array([[-1.0, 0, 0], [2, 0, 0]]), np.ones(2), 3.0)
    assert balanced
    assert masses == pytest.approx([2, 1], rel=1e-12)
    # A regular tetrahedron is balanced by equal masses alone, whatever was asked for.
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    masses, balanced = balanced_masses(corners, np.array([1.0, 5, 2, 3]), 8.0)
    assert balanced
    assert masses == pytest.approx([2, 2, 2, 2], rel=1e-12)


def test_masses_that_cannot_balance_are_said_to():
    masses, balanced = balanced_masses(np.array([[1.0, 0, 0], [2, 0, 0]]), np.array([1.0, 3]), 4.0)
    assert not balanced
    assert masses == pytest.approx([1, 3])


def test_a_unit_that_the_files_cannot_have_is_refused(avatar, tmp_path):
    from mbstudio.core.errors import ExportError

    with pytest.raises(ExportError, match="always in m"):
        export(avatar, "lammps", tmp_path / "out", density=2650, unit="mm")
