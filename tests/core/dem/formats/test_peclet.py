"""peclet-dem level sets: what the engine makes of them, how they settle, and what ours refuses."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.dem import export, validate
from mbstudio.core.errors import ExportError
from mbstudio.core.metrics import mass_properties
from mbstudio.core.packing.reading import read_packing
from tests.core.dem.corruption import assert_arrays_refused, assert_refused

FAST = {"cells": 16, "shell": 10}

PROBE = """
import json
import numpy as np
import settle

sim, kinds = settle.make()
masses, inertias = sim.get_masses(), sim.get_inv_inertia()
before = sim.get_velocities()[:, 2].copy()
sim.step(10)
print("FOUND" + json.dumps({
    "kinds": kinds.tolist(), "masses": masses.tolist(), "inverse": inertias.tolist(),
    "fall": (sim.get_velocities()[:, 2] - before).tolist(), "time": 10 * settle.STEP,
    "gravity": settle.GRAVITY, "spin": float(np.abs(sim.get_angular_velocities()).max()),
}))
"""


def run(peclet: str, folder: Path, script: str) -> str:
    """Run a script in a folder and return what it prints."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    command = [peclet, script]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=240, check=False, env=environment
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def three(avatars, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("peclet") / "out"
    export(avatars, "peclet", folder, density=2650, unit="mm", poured=10, **FAST)
    return folder


def test_mass_and_moments_are_ours_and_nothing_turns_while_it_falls(avatars, peclet, three):
    (three / "probe.py").write_text(PROBE)
    found = json.loads(run(peclet, three, "probe.py").split("FOUND")[1])
    assert found["kinds"] == [0, 1, 2, 0, 1, 2, 0, 1, 2, 0]
    for kind, mass, inverse in zip(found["kinds"], found["masses"], found["inverse"], strict=True):
        expected = mass_properties(avatars[kind], 2650).to("mm")
        assert mass / expected.mass == pytest.approx(1, rel=1e-5)
        assert 1 / np.array(inverse) / expected.principal == pytest.approx(1, rel=1e-5)
    assert found["gravity"] == pytest.approx(9810)
    assert np.array(found["fall"]) / (-9810 * found["time"]) == pytest.approx(1, rel=1e-3)
    assert found["spin"] < 1e-9


def test_ten_grains_settle_and_none_is_lost(avatars, peclet, three):
    printed = run(peclet, three, "settle.py")
    rows = np.array([line.split()[1:] for line in printed.splitlines() if line.startswith("SETTLING")], float)
    assert len(rows) == 20
    assert (rows[:, 0] == 10).all()
    assert rows[-1, 1] < 0.05 * rows[:, 1].max()
    assert rows[-1, 2] < 0.5 * rows[0, 2]
    assert printed.splitlines()[-1].startswith("SETTLED 10 grains, porosity 0.")
    back = read_packing(three / "settled.csv", avatars)
    assert back.poses.positions[:, 2].mean() < 0.5 * rows[0, 2]
    assert back.poses.positions[:, 2].max() == pytest.approx(rows[-1, 2], rel=1e-5)


def test_a_run_that_goes_wrong_ends_with_an_error(peclet, three, tmp_path):
    """Grains that begin within each other lie deeper than a cell of their grids."""
    text = (three / "settle.py").read_text()
    begin, end = text.index("POSITIONS = "), text.index("QUATERNIONS = ")
    places = "POSITIONS = np.tile([0.0, 0.0, 3.0], (10, 1)) + 0.1 * np.arange(10)[:, None]\n"
    wrong = text[:begin] + places + text[end:]
    folder = Path(shutil.copytree(three, tmp_path / "out"))
    (folder / "settle.py").write_text(re.sub(r"STEPS = (\S+), \d+", r"STEPS = \1, 20", wrong))
    done = subprocess.run(
        [peclet, "settle.py"], cwd=folder, capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode != 0
    assert re.search("are lost|overlap by|more energy", done.stderr)


@pytest.fixture(scope="module")
def exported(avatar, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("peclet") / "one"
    export(avatar, "peclet", folder, density=2650, **FAST)
    return folder


def crop(arrays: dict) -> None:
    """Cut the first three planes off, as a tight box would."""
    arrays["grid"] = arrays["grid"][3:]
    arrays["origin"][0] += 3 * arrays["spacing"]


def lose(name: str):
    def change(arrays: dict) -> None:
        del arrays[name]

    return change


def scale(name: str, factor: float):
    def change(arrays: dict) -> None:
        arrays[name] = arrays[name] * factor

    return change


def spoil(arrays: dict) -> None:
    arrays["grid"][2, 2, 2] = np.nan


def lift(arrays: dict) -> None:
    """Put one contact point outside the grain."""
    arrays["shell"][0] *= 1.3


def fewer(arrays: dict) -> None:
    arrays["shell"] = arrays["shell"][:-1]


def turn(arrays: dict) -> None:
    arrays["moments"] = arrays["moments"][::-1]


CORRUPTIONS = {
    "cropped": (crop, "number of nodes|cropped"),
    "no grid": (lose("grid"), "lacks 'grid'"),
    "no moments": (lose("moments"), "lacks 'moments'"),
    "sign turned": (scale("grid", -1), "cropped"),
    "another unit": (scale("grid", 1000), "not hold distances"),
    "spacing": (scale("spacing", 2), "volume|cropped"),
    "not finite": (spoil, "not finite"),
    "mass of another grain": (scale("mass", 2), r"or moments in .* differ"),
    "volume of another grain": (scale("volume", 2), r"Mass, volume or moments in .* differ"),
    "negative moments": (scale("moments", -1), r"Mass, volume or moments in .* differ"),
    "moments out of order": (turn, r"Mass, volume or moments in .* differ"),
    "a contact point off the surface": (lift, "do not lie on the surface"),
    "a contact point lost": (fewer, "number of contact points"),
    "a small bounding sphere": (scale("radius", 0.5), "does not hold the grain"),
}


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_a_corrupted_grid_is_refused(kind, exported):
    assert_arrays_refused(exported, "grain_1.npz", *CORRUPTIONS[kind])


def test_a_grid_cropped_together_with_its_manifest_is_refused(exported, tmp_path):
    """The count of nodes alone does not tell: the border does."""
    path, manifest = exported / "grain_1.npz", exported / "manifest.json"
    kept = path.read_bytes(), manifest.read_bytes()
    with np.load(path) as stored:
        arrays = {name: stored[name].copy() for name in stored.files}
    crop(arrays)
    said = json.loads(kept[1])
    said["items"][0]["details"]["nodes"][0] -= 3
    try:
        np.savez(path, **arrays)
        manifest.write_text(json.dumps(said))
        with pytest.raises(ExportError, match="is cropped"):
            validate(exported, digests=False)
    finally:
        path.write_bytes(kept[0])
        manifest.write_bytes(kept[1])


def test_a_file_that_is_no_archive_is_refused(exported):
    assert_refused(exported, "grain_1.npz", lambda t: t[: len(t) // 2], "cannot be read")
    assert_refused(exported, "settle.py", lambda t: t.replace("grain_1.npz", "other.npz"), "does not load")
