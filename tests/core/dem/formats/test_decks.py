"""Example decks for engines that are not at hand: what they name, their numbers, stand-ins that run them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbstudio.core.dem import export
from mbstudio.core.metrics import mass_properties
from tests.core.dem.corruption import assert_refused
from tests.core.dem.engine_stubs import MECHSYS, MERCURY, EngineStub

OPTIONS = {
    "pfc": {"spheres": 5, "unit": "mm"},
    "dem-engine": {"spheres": 5},
    "mercury": {"spheres": 5},
    "edem": {"spheres": 5, "unit": "mm"},
    "mechsys": {"unit": "mm"},
}
DECKS = {
    "pfc": "settle.dat",
    "dem-engine": "settle.py",
    "mercury": "Settle.cpp",
    "edem": "settle.txt",
    "mechsys": "settle.cpp",
}


@pytest.fixture(scope="module")
def exported(avatars, tmp_path_factory) -> Path:
    """Three grains for each of the engines, seven of which are poured."""
    folder = tmp_path_factory.mktemp("decks")
    for target, options in OPTIONS.items():
        export(avatars, target, folder / target, density=2650, poured=7, **options)
    return folder


@pytest.fixture(scope="module")
def masses(avatars) -> list:
    return [mass_properties(avatar, 2650).to("m") for avatar in avatars]


def deck_of(exported: Path, target: str) -> str:
    return (exported / target / DECKS[target]).read_text()


def stated(text: str, name: str) -> float:
    (number,) = re.findall(rf"(?i)\b{name} = ([-+.\de]+)", text)
    return float(number)


def table(text: str, name: str) -> np.ndarray:
    body = re.search(rf"{name}\[\]\[\d\] = \{{\n(.*?)\n\}};", text, re.DOTALL)[1]
    return np.array([row.split(",") for row in re.findall(r"\{(.*?)\}", body)], dtype=float)


@pytest.mark.parametrize("target", DECKS)
def test_a_deck_says_that_it_was_not_run(target, exported):
    assert "mbstudio has not been able to run it" in deck_of(exported, target)


@pytest.mark.parametrize("target", DECKS)
def test_density_and_gravity_are_in_the_units_of_the_files(target, exported):
    text = deck_of(exported, target)
    metres = 1e-3 if OPTIONS[target].get("unit") == "mm" else 1.0
    assert stated(text, "DENSITY") == pytest.approx(2650 * metres**3)
    assert stated(text, "GRAVITY") == pytest.approx(9.81 / metres)


@pytest.mark.parametrize("target", [name for name in DECKS if name != "pfc"])
def test_the_step_is_a_30th_of_the_shortest_contact(target, exported, masses):
    """Two of the lightest grains on a spring: half a period is pi sqrt(m / 2 k). PFC finds its own step."""
    text = deck_of(exported, target)
    lightest = min(mass.mass for mass in masses)
    contact = np.pi * np.sqrt(lightest / (2 * stated(text, "STIFFNESS")))
    assert contact / stated(text, "STEP") == pytest.approx(30, rel=0.01)


def test_pfc_replicates_the_kinds_in_turn_apart_from_each_other(exported):
    text = deck_of(exported, "pfc")
    assert text.index("program call 'templates.dat'") < text.index("clump replicate")
    pattern = (
        r"^clump replicate name '(\S+)' density \[density\] position \((.*?)\) axis \((.*?)\) angle (\S+)$"
    )
    rows = re.findall(pattern, text, re.MULTILINE)
    assert [row[0] for row in rows] == ["grain_1", "grain_2", "grain_3"] * 2 + ["grain_1"]
    places = np.array([row[1].split(",") for row in rows], dtype=float)
    half, top = (float(word) for word in re.search(r"wall generate box \S+ (\S+) .* 0 (\S+)", text).groups())
    files = [(exported / "pfc" / f"grain_{n}.dat").read_text() for n in (1, 2, 3)]
    number = r"[-\d.e+]+"
    pebbles = [
        np.array(
            [p.split() for p in re.findall(rf"^ {{4}}({number} {number} {number} {number}) \.", f, re.M)]
        )
        for f in files
    ]
    reach = max(
        (np.linalg.norm(p.astype(float)[:, 1:], axis=1) + p.astype(float)[:, 0]).max() for p in pebbles
    )
    assert np.abs(places[:, :2]).max() + reach < half
    assert places[:, 2].min() > reach
    assert places[:, 2].max() + reach < top
    gaps = np.linalg.norm(places[:, None] - places[None], axis=2) + np.eye(7) * 1e9
    assert gaps.min() > 2 * reach


def test_without_a_density_a_deck_takes_that_of_quartz(avatar, tmp_path):
    export(avatar, "pfc", tmp_path / "pfc", spheres=5)
    assert stated((tmp_path / "pfc" / "settle.dat").read_text(), "density") == 2650


def test_dem_engine_gets_every_grain_by_a_stand_in(exported, masses, monkeypatch):
    """The script is run with an engine that only writes down what it is given."""
    folder = exported / "dem-engine"
    monkeypatch.syspath_prepend(str(folder))
    engine = EngineStub()
    monkeypatch.setitem(sys.modules, "DEME", engine)
    monkeypatch.delitem(sys.modules, "load_clumps", raising=False)
    scope = {"__name__": "settle"}
    exec(deck_of(exported, "dem-engine"), scope)
    scope["main"]()
    sys.modules.pop("load_clumps")
    assert [template[0] for template in engine.templates] == pytest.approx([mass.mass for mass in masses])
    assert [Path(template[2]).name for template in engine.templates] == [f"grain_{n}.csv" for n in (1, 2, 3)]
    kinds, places = engine.added
    assert kinds == [engine.templates[i % 3] for i in range(7)]
    assert np.array(places).shape == (7, 3)
    assert np.linalg.norm(engine.turns, axis=1) == pytest.approx(np.ones(7))
    assert engine.gravity == [0, 0, -9.81]
    assert engine.box[0] == (-engine.box[0][1], engine.box[0][1])
    assert np.abs(np.array(places)[:, :2]).max() < engine.box[0][1]
    assert engine.ran == pytest.approx(scope["SECONDS"])
    assert engine.step == scope["STEP"]
    # Hertz: dF/dd = 2 E* sqrt(R d) at a tenth of the smallest radius, R half of it for two equal spheres.
    radius = min(
        np.loadtxt(folder / f"grain_{n}.csv", delimiter=",", skiprows=1)[:, 3].min() for n in (1, 2, 3)
    )
    effective = engine.material["E"] / (2 * (1 - engine.material["nu"] ** 2))
    stiffness = 2 * effective * np.sqrt(radius / 2 * radius / 10)
    assert stiffness == pytest.approx(scope["STIFFNESS"], rel=1e-4)


def compiler_or_skip() -> str:
    found = shutil.which("g++")
    if found is None:
        pytest.skip("the compiler g++ is not installed")
    return found


def build_and_run(folder: Path, deck: str, stubs: dict[str, str], *words: str) -> list[list[float]]:
    """Compile a deck against stand-ins for the engine's headers, run it, return the numbers it printed."""
    for name, text in stubs.items():
        path = folder / "include" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    place = folder / "Drivers" / "Here"
    place.mkdir(parents=True)
    (place / "deck.cpp").write_text(deck)
    command = [compiler_or_skip(), "-std=c++14", "-Wall", "-Werror", "-O0", "-I", str(folder / "include")]
    built = subprocess.run(
        [*command, "-o", str(place / "deck"), str(place / "deck.cpp")],
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr[-3000:]
    ran = subprocess.run(
        [str(place / "deck"), *words], cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr[-2000:]
    return [line.split() for line in ran.stdout.splitlines()]


def test_the_driver_of_mercury_builds_and_reads_the_folders(exported, masses, tmp_path):
    """Stand-ins print what the driver gives them; the real headers have the same names and arguments."""
    text = deck_of(exported, "mercury")
    rows = build_and_run(tmp_path, text, MERCURY, str(exported / "mercury"))
    grains = [np.array(row[1:], dtype=float) for row in rows if row[0] == "GRAIN"]
    assert len(grains) == 7
    for number, grain in enumerate(grains):
        mass = masses[number % 3]
        spheres, found, inertia, place, axes = np.split(grain, [1, 2, 8, 11])
        assert spheres[0] == 5
        assert found[0] == pytest.approx(mass.mass, rel=1e-9)
        assert inertia[[0, 3, 5]] == pytest.approx(mass.principal, rel=1e-9)
        assert inertia[[1, 2, 4]] == pytest.approx(0)
        assert place == pytest.approx(table(text, "PLACES")[number])
        w, x, y, z = table(text, "QUATERNIONS")[number]
        assert pytest.approx(Rotation.from_quat([x, y, z, w]).as_matrix(), abs=1e-7) == axes.reshape(3, 3)
    assert len([row for row in rows if row[0] == "WALL"]) == 5
    ((_, step, end),) = [row for row in rows if row[0] == "SOLVE"]
    assert float(step) == pytest.approx(stated(text, "STEP"))
    assert float(end) == pytest.approx(stated(text, "SECONDS"))


def test_the_program_of_mechsys_builds_and_loads_the_files(exported, tmp_path):
    text = deck_of(exported, "mechsys")
    rows = build_and_run(tmp_path, text, MECHSYS)
    loaded = [row for row in rows if row[0] == "LOAD"]
    assert not {row[1] for row in loaded} & {row[1] for row in rows if row[0] == "WALL"}
    assert [row[2] for row in loaded] == [f"grain_{i % 3 + 1}.json" for i in range(7)]
    for row in loaded:
        assert (exported / "mechsys" / row[2]).is_file()
        assert float(row[4]) == pytest.approx(2.65e-6)
    grains = [np.array(row[1:], dtype=float) for row in rows if row[0] == "GRAIN"]
    places, turns = table(text, "PLACES"), table(text, "QUATERNIONS")
    for grain, place, (w, x, y, z) in zip(grains[:7], places, turns, strict=True):
        turn, axes, found, force = grain[:4], grain[4:8], grain[8:11], grain[11:14]
        wanted = Rotation.from_quat([x, y, z, w])
        applied = Rotation.from_quat(np.roll(turn, -1))
        assert (applied * wanted.inv()).magnitude() == pytest.approx(0, abs=1e-6)
        # The stand-in's grains have their axes a quarter turn about z from their vertices.
        begun = Rotation.from_rotvec([0, 0, np.pi / 2])
        together = Rotation.from_quat(np.roll(axes, -1))
        assert (together * (wanted * begun).inv()).magnitude() == pytest.approx(0, abs=1e-6)
        assert found == pytest.approx(place)
        assert force == pytest.approx([0, 0, -9810])  # of a stand-in's unit mass
    assert len([row for row in rows if row[0] == "WALL"]) == 5
    (solve,) = [row for row in rows if row[0] == "SOLVE"]
    assert [float(word) for word in solve[1:3]] == pytest.approx(
        [stated(text, "SECONDS"), stated(text, "STEP")]
    )


def test_edem_is_told_the_properties_of_each_particle(exported, masses):
    text = deck_of(exported, "edem")
    lines = text.partition("file volume mass Ixx Iyy Izz\n")[2].splitlines()[:3]
    for number, (line, mass) in enumerate(zip(lines, masses, strict=True), start=1):
        file, *words = line.split()
        assert file == f"grain_{number}.csv"
        assert (exported / "edem" / file).is_file()
        wanted = [mass.volume, mass.mass, *mass.principal]
        assert [float(word) for word in words] == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(("target", "options"), [("stl", {"binary": True}), ("metaball", {})])
def test_the_script_beside_shapes_runs_and_finds_what_is_wrong(target, options, avatars, tmp_path):
    given = {"cells": 12, **options} if target == "stl" else options
    report = export(avatars[:2], target, tmp_path / "out", **given)

    def run() -> subprocess.CompletedProcess[str]:
        command = [sys.executable, str(tmp_path / "out" / "check_shapes.py")]
        return subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)

    good = run()
    assert good.returncode == 0, good.stdout + good.stderr
    head, *rows = [line.split() for line in good.stdout.splitlines()]
    assert head[0] == "SHAPE"
    for row, item in zip(rows, report.items, strict=True):
        assert row[0] == item["name"]
        assert float(row[2]) == pytest.approx(item["volume"], rel=0.02)
    manifest = json.loads(report.files[-1].read_text())
    manifest["items"][0]["volume"] *= 1.1
    report.files[-1].write_text(json.dumps(manifest))
    assert run().returncode == 1


def once(pattern: str, replacement: str) -> Callable[[str], str]:
    return lambda text: re.sub(pattern, replacement, text, count=1, flags=re.IGNORECASE)


NUMBERS = {
    "another density": (once(r"DENSITY = ", "DENSITY = 1"), "DENSITY"),
    "no gravity": (once(r"GRAVITY = [-+.\de]+", "GRAVITY = 0"), "GRAVITY"),
    "stiffness lost": (once(r"STIFFNESS = ", "STIFFNESS == "), "STIFFNESS"),
    "negative stiffness": (once(r"STIFFNESS = ", "STIFFNESS = -"), "not positive"),
}
STEPS = {
    "a step too long": (once(r"STEP = (\d)", r"STEP = 9\1"), "time step"),
    "a step of nothing": (once(r"STEP = [-+.\de]+", "STEP = 0"), "time step"),
}
OTHERS = {
    ("pfc", "templates not called"): (once("program call 'templates.dat'", ""), "does not call"),
    ("pfc", "another template"): (once("replicate name 'grain_1'", "replicate name 'b'"), "does not load"),
    ("pfc", "a clump lost"): (once(r"clump replicate name.*\n", ""), "6 particles"),
    ("pfc", "an axis that is none"): (once(r"axis \(\S+", "axis (2,"), "length 1"),
    ("pfc", "a place as text"): (once(r"position \(\S+", "position (x,"), "not numbers"),
    ("dem-engine", "a place lost"): (once(r"POSITIONS = \[\[.*?\], ", "POSITIONS = ["), "6 particles"),
    ("dem-engine", "a turn that is none"): (
        once(r"QUATERNIONS = \[\[\S+,", "QUATERNIONS = [[3,"),
        "length 1",
    ),
    ("mercury", "another folder"): (once('"grain_2"', '"b"'), "does not load"),
    ("mercury", "a bracket lost"): (once(r"\}\n", "\n"), "brackets"),
    ("mercury", "another body"): (once(r"toi\[4\]", "toi[3]"), "not the driver"),
    ("mechsys", "another file"): (once(r'"grain_2\.json"', '"b.json"'), "does not load"),
    ("mechsys", "a place lost"): (once(r"(PLACES.*\n) .*\n", r"\1"), "6 particles"),
    ("mechsys", "no rounding"): (once(r" R = [\d.]+", " R = 0"), "rounds"),
    ("edem", "a mass of another grain"): (once(r"(grain_1\.csv \S+) \S+", r"\1 1.0"), "volume and mass"),
    ("edem", "moments reordered"): (once(r"(grain_1.*) (\S+) (\S+)\n", r"\1 \3 \2\n"), "moments"),
    ("edem", "a particle lost"): (once(r"grain_2\.csv.*\n", ""), "does not load"),
}


@pytest.mark.parametrize("target", DECKS)
def test_numbers_of_a_deck_that_cannot_be_are_refused(target, exported):
    for change, message in [*NUMBERS.values(), *(STEPS.values() if target != "pfc" else ())]:
        assert_refused(exported / target, DECKS[target], change, message)


@pytest.mark.parametrize("case", OTHERS)
def test_a_corrupted_deck_is_refused(case, exported):
    assert_refused(exported / case[0], DECKS[case[0]], *OTHERS[case])
