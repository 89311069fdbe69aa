"""Kratos clusters: what the engine makes of them, how they settle, and what ours refuses."""

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
from mbstudio.core.packing.reading import read_packing
from tests.core.dem.corruption import assert_refused

# Reads the case as Kratos does and tells what it made of every cluster; one falls freely for a while.
PROBE = """
import json
import os
import KratosMultiphysics as K
import KratosMultiphysics.DEMApplication as D
from KratosMultiphysics.DEMApplication.DEM_analysis_stage import DEMAnalysisStage

K.Logger.GetDefaultOutput().SetSeverity(K.Logger.Severity.WARNING)
with open("ProjectParametersDEM.json") as stream:
    parameters = K.Parameters(stream.read())
parameters["FinalTime"].SetDouble(100 * parameters["MaxTimeStep"].GetDouble())
stage = DEMAnalysisStage(K.Model(), parameters)
stage.Initialize()
found = []
for element in stage.cluster_model_part.Elements:
    node = element.GetNodes()[0]
    found.append({
        "kind": element.Properties.Id,
        "mass": node.GetSolutionStepValue(K.NODAL_MASS),
        "moments": list(node.GetSolutionStepValue(D.PRINCIPAL_MOMENTS_OF_INERTIA)),
    })
stage.RunSolutionLoop()
for entry, element in zip(found, stage.cluster_model_part.Elements):
    node = element.GetNodes()[0]
    entry["spin"] = list(node.GetSolutionStepValue(K.ANGULAR_VELOCITY))
    entry["speed"] = list(node.GetSolutionStepValue(K.VELOCITY))
    entry["time"] = stage.time
stage.Finalize()
print("FOUND" + json.dumps(found), flush=True)
os._exit(0)  # taking a global stage down crashes this Kratos
"""


def run(kratos: str, folder: Path, script: str) -> str:
    """Run a script in a folder and return what it prints."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        [kratos, script],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_mass_and_moments_are_ours_and_nothing_turns_while_it_falls(avatars, kratos, tmp_path):
    out = tmp_path / "out"
    export(avatars, "kratos", out, density=2650, spheres=6, poured=4)
    (out / "probe.py").write_text(PROBE)
    found = json.loads(run(kratos, out, "probe.py").split("FOUND")[1])
    assert [entry["kind"] for entry in found] == [1, 2, 3, 1]
    for entry in found:
        expected = mass_properties(avatars[entry["kind"] - 1], 2650).to("m")
        assert entry["mass"] / expected.mass == pytest.approx(1, rel=1e-5)
        assert np.sort(entry["moments"]) / expected.principal == pytest.approx(1, rel=1e-5)
        assert entry["speed"][2] / (-9.81 * entry["time"]) == pytest.approx(1, rel=0.02)
        assert np.abs(entry["spin"]).max() < 1e-9


def test_ten_clusters_settle_and_none_is_lost(avatars, kratos, tmp_path):
    out = tmp_path / "out"
    export(avatars, "kratos", out, density=2650, spheres=6, poured=10)
    printed = run(kratos, out, "settle.py")
    rows = np.array([line.split()[1:] for line in printed.splitlines() if line.startswith("SETTLING")], float)
    assert (rows[:, 1] == 10).all()
    assert len(rows) > 10
    assert rows[-1, 2] < 0.02 * rows[:, 2].max()
    settled = np.genfromtxt(out / "settled.csv", delimiter=",", names=True)
    assert list(settled["number"]) == list(range(1, 11))
    names = np.genfromtxt(out / "settled.csv", delimiter=",", names=True, dtype=None, encoding="ascii")
    assert list(names["avatar"]) == [f"grain_{1 + number % 3}" for number in range(10)]
    turns = np.stack([settled[name] for name in ("qw", "qx", "qy", "qz")], axis=1)
    assert np.linalg.norm(turns, axis=1) == pytest.approx(1, abs=1e-6)
    assert settled["z_m"].min() > 0
    summary = printed.splitlines()[-1]
    assert summary.startswith("SETTLED 10 grains, porosity 0.")
    back = read_packing(out / "settled.csv", avatars, spheres=6)
    assert back.poses.positions[:, 2] == pytest.approx(settled["z_m"] * 1000)
    told = float(re.search(r"overlap (\S+) m", summary)[1])
    assert back.overlap * back.mean_diameter == pytest.approx(told * 1000, rel=0.05)


def test_a_run_that_goes_wrong_says_so_and_fails(avatars, kratos, tmp_path):
    """With too long a time step the clusters are thrown about."""
    out = tmp_path / "out"
    export(avatars, "kratos", out, density=2650, spheres=6, poured=10)
    parameters = json.loads((out / "ProjectParametersDEM.json").read_text())
    parameters["MaxTimeStep"] *= 25
    parameters["NeighbourSearchFrequency"] = 20
    (out / "ProjectParametersDEM.json").write_text(json.dumps(parameters))
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        [kratos, "settle.py"],
        cwd=out,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        env=environment,
    )
    assert done.returncode != 0
    assert re.search("are lost|more energy|overlap by", done.stderr)
    assert "SETTLED" not in done.stdout


@pytest.fixture(scope="module")
def exported(avatar, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("kratos") / "out"
    export(avatar, "kratos", folder, density=2650, spheres=6)
    return folder


def test_the_cluster_is_written_as_the_engine_wants_it(avatar, exported):
    lines = (exported / "grain_1.clu").read_text().splitlines()
    expected = mass_properties(avatar, 2650).to("m")
    assert lines[:2] == ["Name", "grain_1"]
    assert lines.index("End centers_and_radii") - lines.index("Begin centers_and_radii") == 7
    assert float(lines[lines.index("Volume") + 1]) / expected.volume == pytest.approx(1, rel=1e-9)
    inertia = np.array(lines[lines.index("Inertia per unit mass") + 1 :][:3], dtype=float)
    assert inertia / (expected.principal / expected.mass) == pytest.approx(1, rel=1e-9)


CORRUPTIONS = {
    "a name with spaces": (lambda t: t.replace("grain_1", "grain 1"), "has the name"),
    "a blank line after a keyword": (lambda t: t.replace("Volume\n", "Volume\n\n"), "empty or missing line"),
    "volume of another grain": (lambda t: re.sub(r"(Volume\n)\S+", r"\g<1>1e-8", t), "'Volume' 1e-8"),
    "volume missing": (lambda t: re.sub(r"Volume\n\S+\n", "", t), "lacks 'Volume'"),
    "negative inertia": (lambda t: re.sub(r"(unit mass\n)", r"\1-", t), "Inertia per unit mass"),
    "inertia reordered": (lambda t: re.sub(r"(mass\n)(\S+)\n(\S+)", r"\1\3\n\2", t), "Inertia per unit mass"),
    "inertia cut": (lambda t: t.rstrip().rsplit("\n", 1)[0], "empty or missing"),
    "another centre": (lambda t: re.sub(r"diameter\n0", "diameter\n1e-3", t), "another centre or size"),
    "another size": (lambda t: re.sub(r"(Size\n)\S+", r"\g<1>1", t), "another centre or size"),
    "negative radius": (lambda t: re.sub(r"(radii\n\S+ \S+ \S+ )", r"\1-", t), "not positive"),
    "text for a number": (lambda t: re.sub(r"(radii\n)\S+", r"\1x", t), "not four numbers"),
    "not finite": (lambda t: re.sub(r"(radii\n)\S+", r"\1nan", t), "not finite"),
    "a sphere lost": (lambda t: re.sub(r"(radii\n).*\n", r"\1", t, count=1), "has 5 spheres"),
    "no end of the spheres": (lambda t: t.replace("End centers_and_radii", ""), "does not end"),
    "misspelt": (lambda t: t.replace("Size", "size"), "where a keyword"),
    "empty": (lambda t: "", "lacks 'Name'"),
}


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_a_corrupted_cluster_is_refused(kind, exported):
    assert_refused(exported, "grain_1.clu", *CORRUPTIONS[kind])


CASE = {
    "another density": (
        "MaterialsDEM.json",
        lambda t: re.sub(r'("PARTICLE_DENSITY": )\S+', r"\g<1>1.0,", t, count=1),
        "'PARTICLE_DENSITY'",
    ),
    "gravity upwards": (
        "ProjectParametersDEM.json",
        lambda t: t.replace('"GravityZ": -', '"GravityZ": '),
        "'GravityZ'",
    ),
    "no time step": (
        "ProjectParametersDEM.json",
        lambda t: re.sub(r'("MaxTimeStep": )[^,]+', r"\g<1>0", t),
        "a time step of 0",
    ),
    "a kind that is not there": (
        "settleDEM_Clusters.mdpa",
        lambda t: re.sub(r"(Elements Cluster3D\n1) \d+", r"\g<1> 9", t),
        "kinds differ",
    ),
    "a turn that is none": (
        "settleDEM_Clusters.mdpa",
        lambda t: re.sub(r"\[4\] \( [^,]+", "[4] ( 3.0", t, count=1),
        "length 1",
    ),
    "a cluster lost": (
        "settleDEM_Clusters.mdpa",
        lambda t: re.sub(r"(Begin Nodes\n).*\n", r"\1", t),
        "particles",
    ),
    "a wall lost": (
        "settleDEM_FEM_boundary.mdpa",
        lambda t: re.sub(r"(RigidFace3D3N\n).*\n", r"\1", t),
        "not a box",
    ),
    "another script": ("settle.py", lambda t: t.replace("% 250", "% 25"), "not the script"),
    "other names in the script": ("settle.py", lambda t: t.replace("'grain_1'", "'b'"), "does not name"),
    "neighbours looked for too seldom": (
        "ProjectParametersDEM.json",
        lambda t: t.replace('"NeighbourSearchFrequency": 10', '"NeighbourSearchFrequency": 20'),
        "through each other",
    ),
}


@pytest.mark.parametrize("kind", CASE)
def test_a_corrupted_case_is_refused(kind, exported):
    name, change, message = CASE[kind]
    assert_refused(exported, name, change, message)


def test_a_material_without_its_cluster_is_refused(exported):
    assert_refused(
        exported, "MaterialsDEM.json", lambda t: t.replace("grain_1.clu", "other.clu"), "does not name"
    )
