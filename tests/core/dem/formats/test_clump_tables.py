"""Clumps for PFC, DEM-Engine, EDEM, MercuryDPM and Yade: their grammar, and what is refused."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.dem import export
from mbstudio.core.metrics import mass_properties
from tests.core.dem.corruption import assert_refused

TARGETS = ("pfc", "dem-engine", "edem", "mercury", "yade")


@pytest.fixture(scope="module")
def exported(avatar, tmp_path_factory) -> Path:
    """A folder with one export of each target."""
    folder = tmp_path_factory.mktemp("tables")
    for target in TARGETS:
        export(avatar, target, folder / target, density=2650, unit="m", spheres=6)
    return folder


@pytest.fixture(scope="module")
def mass(avatar):
    return mass_properties(avatar, 2650).to("m")


def test_pfc_gets_pebbles_volume_and_inertia_per_unit_density(exported, mass):
    text = (exported / "pfc" / "grain_1.dat").read_text()
    command = " ".join(line.removesuffix("...") for line in text.splitlines() if not line.startswith(";"))
    words = command.split()
    assert words[:7] == ["clump", "template", "create", "name", "'grain_1'", "pebbles", "6"]
    assert words[7 + 24] == "volume"
    assert float(words[7 + 25]) / mass.volume == pytest.approx(1, rel=1e-9)
    inertia = np.array(words[7 + 27 :], dtype=float)
    assert inertia[:3] * 2650 / mass.principal == pytest.approx(1, rel=1e-9)
    assert list(inertia[3:]) == [0, 0, 0]
    pebbles = np.array(words[7 : 7 + 24], dtype=float).reshape(6, 4)
    spheres = np.loadtxt(exported / "edem" / "grain_1.csv", delimiter=",", skiprows=1)
    assert pebbles[:, [1, 2, 3, 0]] == pytest.approx(spheres, abs=1e-14)


def test_dem_engine_gets_four_columns_mass_and_moments(exported, mass, monkeypatch):
    """The script is run with an engine that only writes down what it is given."""
    lines = (exported / "dem-engine" / "grain_1.csv").read_text().splitlines()
    assert lines[0] == "x,y,z,r"
    assert len(lines) == 7

    class Solver:
        def LoadClumpType(self, mass, moi, path, material):
            return mass, moi, path, material

    scope = {"__file__": str(exported / "dem-engine" / "load_clumps.py")}
    exec((exported / "dem-engine" / "load_clumps.py").read_text(), scope)
    ((name, (found, moments, path, material)),) = scope["load"](Solver(), "quartz").items()
    assert (name, material) == ("grain_1", "quartz")
    assert found / mass.mass == pytest.approx(1, rel=1e-9)
    assert np.array(moments) / mass.principal == pytest.approx(1, rel=1e-9)
    assert Path(path) == exported / "dem-engine" / "grain_1.csv"


def test_mercury_gets_a_folder_as_its_loader_reads_it(exported, mass):
    folder = exported / "mercury" / "grain_1"
    assert len(np.loadtxt(folder / "Clump" / "Clump.txt", delimiter=",")) == 6
    assert float((folder / "Inertia" / "Mass.txt").read_text()) / mass.mass == pytest.approx(1, rel=1e-9)
    tensor = np.loadtxt(folder / "Inertia" / "TOI.txt", delimiter=",")
    assert tensor.diagonal() / mass.principal == pytest.approx(1, rel=1e-9)
    assert np.array_equal(tensor, np.diag(tensor.diagonal()))
    assert np.array_equal(np.loadtxt(folder / "Inertia" / "PD.txt", delimiter=","), np.eye(3))


def test_yade_gets_five_columns_and_a_script_with_our_mass(exported, mass):
    rows = np.loadtxt(exported / "yade" / "grain_1.txt")
    assert rows.shape == (6, 5)
    assert (rows[:, 4] == 0).all()
    script = (exported / "yade" / "settle.py").read_text()
    compile(script, "settle.py", "exec")
    kinds = eval(re.search(r"^KINDS = (.*)$", script, re.MULTILINE)[1])
    ((name, found, moments),) = kinds
    assert name == "grain_1.txt"
    assert found / mass.mass == pytest.approx(1, rel=1e-9)
    assert np.array(moments) / mass.principal == pytest.approx(1, rel=1e-9)


def run_yade(yade: str, folder: Path, word: str = "SETTLING") -> np.ndarray:
    """Run the script of an export and return the numbers it printed after a word."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    command = [yade, "-n", "-x", "settle.py"]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=280, check=False, env=environment
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    rows = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith(word)]
    return np.array(rows, dtype=float)


@pytest.mark.parametrize(
    ("target", "options", "state", "allowed"),
    [("yade", {"spheres": 40}, "state", 0.003), ("yade-level-set", {"shell": 8}, "body.state", 0.01)],
)
def test_what_yade_finds_by_itself_is_close_to_what_the_script_sets(
    target, options, state, allowed, avatars, yade, tmp_path
):
    """The engine weighs clumps on a grid and level sets by their own: near ours, or the shape is not ours."""
    out = tmp_path / "out"
    export(avatars, target, out, density=2650, poured=3, **options)
    script = (out / "settle.py").read_text().partition("O.engines")[0]
    tell = f'    print("OWN", {state}.mass / mass, *sorted({state}.inertia), *moments)\n'
    told = re.sub(rf"(?m)^    {re.escape(state)}\.mass, .*$", lambda m: tell + m[0], script)
    assert told != script
    (out / "settle.py").write_text(told)
    rows = run_yade(yade, out, "OWN")
    assert len(rows) == 3
    assert rows[:, 0] == pytest.approx(1, rel=allowed)
    assert rows[:, 1:4] / rows[:, 4:] == pytest.approx(1, rel=2 * allowed)


@pytest.mark.parametrize(
    ("target", "options"),
    [
        ("yade", {"spheres": 8}),
        pytest.param("yade-level-set", {"cells": 16, "shell": 8}, marks=pytest.mark.full),
    ],
)
def test_ten_grains_settle_in_yade(target, options, avatars, yade, tmp_path):
    out = tmp_path / "out"
    export(avatars, target, out, density=2650, poured=10, **options)
    rows = run_yade(yade, out)
    assert len(rows) == 20
    assert (rows[:, 0] == 10).all()
    assert rows[-1, 1] < 0.05 * rows[:, 1].max()


def first_row(change):
    """Change the first row after the header."""

    def edit(text: str) -> str:
        head, row, *rest = text.split("\n")
        return "\n".join([head, change(row), *rest])

    return edit


TABLES = {
    "a column lost": (first_row(lambda row: row.rpartition(",")[0]), "not four numbers"),
    "a column more": (first_row(lambda row: row + ",1"), "not four numbers"),
    "text": (first_row(lambda row: "x" + row), "not four numbers"),
    "not finite": (first_row(lambda row: row.rpartition(",")[0] + ",nan"), "not finite"),
    "a negative radius": (first_row(lambda row: re.sub(r",([^,]+)$", r",-\1", row)), "not positive"),
    "a sphere lost": (first_row(lambda row: ""), "not four numbers|has 5"),
    "another unit": (lambda t: t.replace("e-04", "e-01"), "size differs"),
}
HEADED = {
    "no header": (lambda t: t.partition("\n")[2], "instead of"),
    "no r in the header": (lambda t: re.sub(r",r\w*\n", "\n", t, count=1), "instead of"),
    "empty": (lambda t: "", "instead of"),
}


@pytest.mark.parametrize("kind", [*TABLES, *HEADED])
@pytest.mark.parametrize("target", ["dem-engine", "edem"])
def test_a_corrupted_table_is_refused(target, kind, exported):
    assert_refused(exported / target, "grain_1.csv", *{**TABLES, **HEADED}[kind])


@pytest.mark.parametrize("kind", TABLES)
def test_a_corrupted_clump_of_mercury_is_refused(kind, exported):
    assert_refused(exported / "mercury", "grain_1/Clump/Clump.txt", *TABLES[kind])


MERCURY = {
    "a header": ("Clump/Clump.txt", lambda t: "x,y,z,r\n" + t, "not four numbers"),
    "mass of another grain": ("Inertia/Mass.txt", lambda t: "1e-3\n", "the mass"),
    "mass as text": ("Inertia/Mass.txt", lambda t: "heavy\n", "the mass"),
    "two masses": ("Inertia/Mass.txt", lambda t: t + t, "the mass"),
    "negative moment": ("Inertia/TOI.txt", lambda t: "-" + t, "the tensor"),
    "a product of inertia": ("Inertia/TOI.txt", lambda t: t.replace(",0.0", ",1.0", 1), "the tensor"),
    "two rows": ("Inertia/TOI.txt", lambda t: t.partition("\n")[2], "2 rows"),
    "turned axes": ("Inertia/PD.txt", lambda t: "\n".join(reversed(t.strip().split("\n"))), "the directions"),
}


@pytest.mark.parametrize("kind", MERCURY)
def test_a_corrupted_folder_of_mercury_is_refused(kind, exported):
    name, change, message = MERCURY[kind]
    assert_refused(exported / "mercury", f"grain_1/{name}", change, message)


PFC = {
    "another name": (lambda t: t.replace("'grain_1'", "'b'"), "does not begin"),
    "count": (lambda t: t.replace("pebbles 6", "pebbles 5"), "does not begin"),
    "no continuation": (lambda t: t.replace(" ...\n    volume", "\n    volume"), "not a single command"),
    "continued at its end": (lambda t: t.rstrip() + " ...\n", "not a single command"),
    "a pebble lost": (lambda t: re.sub(r"\n {4}\S+ \S+ \S+ \S+ \.\.\.", "", t, count=1), "6 pebbles"),
    "radius at the end": (
        lambda t: re.sub(r"\n {4}(\S+) (\S+ \S+ \S+) \.", r"\n    \2 \1 .", t),
        "positive|size",
    ),
    "volume of another grain": (lambda t: re.sub(r"volume \S+", "volume 1", t), "'volume' 1"),
    "no inertia": (lambda t: t.partition(" ...\n    inertia")[0], "6 pebbles"),
    "negative moment": (
        lambda t: t.replace("inertia ", "inertia -").replace("-per", "per"),
        "'inertia'|single",
    ),
    "times the density": (
        lambda t: re.sub(r"(\n {4}inertia) (\S+)", lambda m: f"{m[1]} {float(m[2]) * 2650}", t),
        "'inertia'",
    ),
    "empty": (lambda t: "", "not a single command"),
}


@pytest.mark.parametrize("kind", PFC)
def test_a_corrupted_template_of_pfc_is_refused(kind, exported):
    assert_refused(exported / "pfc", "grain_1.dat", *PFC[kind])


def edited(change):
    """Change the record of the clump in a JSON file."""

    def edit(text: str) -> str:
        record = json.loads(text)
        change(record)
        return json.dumps(record)

    return edit


CLUMPS = {
    "mass": (edited(lambda r: r["grain_1"].update(mass=1.0)), "'mass'"),
    "moments reordered": (edited(lambda r: r["grain_1"]["moi"].reverse()), "'moi'"),
    "negative moment": (edited(lambda r: r["grain_1"].update(moi=[-1, 1, 1])), "'moi'"),
    "file": (edited(lambda r: r["grain_1"].update(file="b.csv")), "'file'"),
    "name": (edited(lambda r: r.update(b=r.pop("grain_1"))), "does not name"),
    "no moments": (edited(lambda r: r["grain_1"].pop("moi")), "cannot be read"),
    "cut": (lambda t: t[: len(t) // 2], "cannot be read"),
}


@pytest.mark.parametrize("kind", CLUMPS)
def test_corrupted_masses_of_dem_engine_are_refused(kind, exported):
    assert_refused(exported / "dem-engine", "clumps.json", *CLUMPS[kind])


YADE = {
    "four columns": ("grain_1.txt", lambda t: t.replace(" 0\n", "\n", 1), "not five numbers"),
    "a blank line": ("grain_1.txt", lambda t: t + "\n", "not five numbers"),
    "two clumps": ("grain_1.txt", lambda t: t.replace(" 0\n", " 1\n", 1), "one clump"),
    "negative radius": (
        "grain_1.txt",
        lambda t: re.sub(r" (\S+) 0\n", r" -\1 0\n", t, count=1),
        "not positive",
    ),
    "another mass": (
        "settle.py",
        lambda t: re.sub(r"(grain_1.txt', )\S+,", r"\g<1>1.0,", t),
        r"or moments in .* differ",
    ),
    "another file": ("settle.py", lambda t: t.replace("grain_1.txt", "b.txt"), "does not load"),
    "kinds broken": ("settle.py", lambda t: t.replace("KINDS = [(", "KINDS = [["), "cannot be read"),
    "no kinds": ("settle.py", lambda t: t.replace("KINDS = ", "SORTS = "), "does not load"),
}


@pytest.mark.parametrize("kind", YADE)
def test_a_corrupted_file_of_yade_is_refused(kind, exported):
    name, change, message = YADE[kind]
    assert_refused(exported / "yade", name, change, message)


def test_lists_of_templates_are_checked(exported):
    assert_refused(exported / "pfc", "templates.dat", lambda t: t + t, "does not call")
