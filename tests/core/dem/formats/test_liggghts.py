"""LIGGGHTS templates: what the engine logs of them, how they settle, and what ours refuses."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbstudio.core.dem import export, validate
from mbstudio.core.dem.formats.liggghts.deck import prime_above
from mbstudio.core.dem.formats.liggghts.target import read_spheres
from mbstudio.core.errors import ExportError
from mbstudio.core.metrics import mass_properties
from mbstudio.core.packing.reading import read_packing
from mbstudio.core.units import METRES_PER_UNIT

NUMBER = r"([-+0-9.eE]+)"


def run_deck(liggghts: str, folder: Path, deck: str = "in.settle") -> str:
    """Run a deck in its folder and return its log."""
    # Without a screen (-screen none) this LIGGGHTS crashes as soon as it inserts particles.
    command = [liggghts, "-in", deck]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240, check=False)
    log = (folder / "log.liggghts").read_text()
    assert done.returncode == 0, log[-3000:] + done.stderr
    return log


def logged_templates(log: str) -> list[tuple[float, np.ndarray]]:
    """Return mass and principal moments (ascending) of each template, as the engine logged them."""
    masses = [float(m) for m in re.findall(rf"^   mass = {NUMBER},", log, re.MULTILINE)]
    moments = re.findall(rf"Principal moments of inertia_: {NUMBER}, {NUMBER}, {NUMBER}", log)
    return [(mass, np.sort(np.array(row, dtype=float))) for mass, row in zip(masses, moments, strict=True)]


def thermo_rows(log: str) -> np.ndarray:
    """Return the numbers that a run printed, a row for each part."""
    lines = [line.split() for line in log.splitlines() if re.fullmatch(r"(\s+[-+0-9.eE]+){8,9}\s*", line)]
    return np.array(lines, dtype=float)


@pytest.mark.parametrize("unit", ["m", "mm", "um"])
def test_ten_clumps_settle_with_our_mass_and_inertia_and_none_is_lost(unit, avatars, liggghts, tmp_path):
    out = tmp_path / "out"
    report = export(avatars, "liggghts", out, density=2650, unit=unit, spheres=12, poured=10)
    log = run_deck(liggghts, out)
    templates = logged_templates(log)
    assert len(templates) == 3
    for (mass, moments), avatar, item in zip(templates, avatars, report.items, strict=True):
        expected = mass_properties(avatar, 2650).to("m")
        assert mass / expected.mass == pytest.approx(1, rel=0.005)
        assert moments / expected.principal == pytest.approx(1, rel=0.005)
        assert item["mass"] == pytest.approx(expected.mass, rel=1e-6)
    assert "inserted 10 particle templates" in log
    rows = thermo_rows(log)
    atoms, energy = rows[:, 1].tolist(), rows[:, 2] + rows[:, 3]
    assert atoms[-1] == max(atoms) == 10 * 12
    assert len(rows) > 10
    # They fall, hit the floor, and come to rest.
    assert energy.max() > 0
    assert energy[-1] < 0.02 * energy.max()
    told = re.search(r"^SETTLED 10 grains, porosity (\S+), height \S+ m, \S+ .* overlap (\S+) m", log, re.M)
    assert 0 < float(told[1]) < 1
    assert (out / "settled.restart").stat().st_size > 0
    back = read_packing(out / "settled.dump", avatars)
    assert len(back) == 10
    assert back.poses.scales == pytest.approx(np.ones(10), rel=1e-6)
    overlap = back.overlap * back.mean_diameter * METRES_PER_UNIT[back.unit]
    assert overlap == pytest.approx(float(told[2]), rel=0.02, abs=1e-9)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        (r"^timestep (\S+)", lambda m: f"timestep {40 * float(m[1]):.6e}", "ERROR"),
        (r"particles_in_region 10", "particles_in_region 9", "grains_are_lost_or_were_not_inserted"),
    ],
)
def test_a_run_that_goes_wrong_ends_with_an_error(pattern, replacement, message, avatars, liggghts, tmp_path):
    out = tmp_path / "out"
    export(avatars, "liggghts", out, density=2650, unit="mm", spheres=12, poured=10)
    deck = out / "in.settle"
    deck.write_text(re.sub(pattern, replacement, deck.read_text(), flags=re.MULTILINE))
    done = subprocess.run(
        [liggghts, "-in", deck.name], cwd=out, capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode != 0
    assert message in done.stdout + done.stderr


def _template_line(folder: Path, name: str) -> str:
    text = (folder / f"{name}.template").read_text()
    return " ".join(line.removesuffix("&") for line in text.splitlines() if not line.startswith("#"))


LONE_TEMPLATE = """units si
atom_style granular
atom_modify map array
boundary f f f
newton off
communicate single vel yes
region domain block -1 1 -1 1 -1 1 units box
create_box 1 domain
{command}
"""


def test_a_turned_clump_pins_the_order_of_the_tensor(avatar, liggghts, tmp_path):
    """Row order gives back our moments; the order of other engines would not, and is told apart."""
    out = tmp_path / "out"
    (item,) = export(avatar, "liggghts", out, density=2650, unit="mm", spheres=12).items
    rotation = Rotation.from_rotvec([0.5, -0.8, 0.3]).as_matrix()
    tensor = rotation @ np.diag(item["moments"]) @ rotation.T
    rows = read_spheres(out / "grain_1.multisphere")
    rows[:, :3] = rows[:, :3] @ rotation.T
    np.savetxt(out / "turned.multisphere", rows, fmt="%.9e")
    stated = _template_line(out, "grain_1").replace("grain_1.multisphere", "turned.multisphere")
    head, tail = re.split(r"inertia_tensor (?:\S+ ){6}", stated)

    def moments_for(entries: list[float]) -> np.ndarray:
        command = head + "inertia_tensor " + " ".join(f"{entry:.9e}" for entry in entries) + " " + tail
        (out / "lone").write_text(LONE_TEMPLATE.format(command=command))
        return logged_templates(run_deck(liggghts, out, "lone"))[0][1] / item["moments"]

    xx, xy, xz, yy, yz, zz = (tensor[i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    assert moments_for([xx, xy, xz, yy, yz, zz]) == pytest.approx(1, rel=1e-4)
    assert moments_for([xx, yy, zz, xy, xz, yz]) != pytest.approx(1, rel=0.05)


def test_without_our_numbers_the_engine_weighs_the_union_of_spheres(avatar, liggghts, tmp_path):
    """Five spheres fit badly: what the engine finds by itself is off, what the template states is not."""
    out = tmp_path / "out"
    (item,) = export(avatar, "liggghts", out, density=2650, unit="mm", spheres=5).items
    bare = re.sub(r"mass \S+ inertia_tensor (?:\S+ ){6}use_volume ", "", _template_line(out, "grain_1"))
    assert "inertia_tensor" not in bare
    (out / "bare").write_text(LONE_TEMPLATE.format(command=bare))
    ((mass, moments),) = logged_templates(run_deck(liggghts, out, "bare"))
    # The clump has the avatar's volume, so the mass nearly agrees; the shape, hence inertia, does not quite.
    assert mass == pytest.approx(item["mass"], rel=0.02)
    assert np.abs(moments / np.array(item["moments"]) - 1).max() > 0.005
    assert moments / item["moments"] == pytest.approx(1, rel=0.15)


def test_the_template_is_written_as_the_engine_wants_it(avatar, tmp_path):
    out = tmp_path / "out"
    report = export(avatar, "liggghts", out, density=2650, unit="mm", spheres=7, ntry=5000)
    words = _template_line(out, "grain_1").split()
    assert words[:2] == ["fix", "template1"]
    assert words[words.index("nspheres") + 1] == "7"
    assert words[words.index("ntry") + 1] == "5000"
    assert float(words[words.index("scale") + 1]) == 1e-3
    tensor = [float(word) for word in words[words.index("inertia_tensor") + 1 :][:6]]
    expected = mass_properties(avatar, 2650).to("m").principal
    assert tensor == pytest.approx([expected[0], 0, 0, expected[1], 0, expected[2]], rel=1e-6, abs=1e-20)
    assert "use_volume" in words
    rows = read_spheres(out / "grain_1.multisphere")
    assert len(rows) == 7 == report.items[0]["details"]["spheres"]
    assert 0.9 < report.items[0]["details"]["iou"] <= 1
    assert report.items[0]["details"]["volume_ratio"] == pytest.approx(1, abs=0.01)


def _swap_numbers(text: str) -> str:
    """Order the tensor as LAMMPS documents it: Ixx Iyy Izz Ixy Ixz Iyz."""
    match = re.search(r"inertia_tensor (\S+) (\S+) (\S+) (\S+) (\S+) (\S+)", text)
    assert match
    xx, xy, xz, yy, yz, zz = match.groups()
    return text.replace(match[0], f"inertia_tensor {xx} {yy} {zz} {xy} {xz} {yz}")


CORRUPTIONS = {
    "negative radius": ("multisphere", lambda t: re.sub(r"(\S+)$", r"-\1", t.rstrip()), "not positive"),
    "text for a number": ("multisphere", lambda t: t.rstrip()[:-5] + "abc", "not four numbers"),
    "not finite": ("multisphere", lambda t: re.sub(r"\S+$", "nan", t.rstrip()), "not finite"),
    "a sphere lost": ("multisphere", lambda t: t.rstrip().rsplit("\n", 1)[0], "manifest says 6"),
    "one sphere left": ("multisphere", lambda t: t.splitlines()[0], "at least 2"),
    "a column lost": ("multisphere", lambda t: t.rstrip().rsplit(" ", 1)[0], "not four numbers"),
    "a comment, which crashes the engine": ("multisphere", lambda t: "# x y z r\n" + t, "not four numbers"),
    "an empty line": ("multisphere", lambda t: "\n" + t, "not four numbers"),
    "another unit": ("multisphere", lambda t: t.replace("e-0", "e-1"), "size differs"),
    "nspheres": ("template", lambda t: t.replace("nspheres 6", "nspheres 5"), "'nspheres' 5"),
    "mass missing": ("template", lambda t: re.sub(r"mass \S+ ", "", t), "lacks 'mass'"),
    "mass of another grain": ("template", lambda t: re.sub(r"mass \S+", "mass 1e-5", t), "'mass' 1e-5"),
    "mass as text": ("template", lambda t: re.sub(r"mass \S+", "mass heavy", t), "'mass' heavy"),
    "inertia missing": (
        "template",
        lambda t: re.sub(r"inertia_tensor (\S+ ){6}", "", t),
        "lacks 'inertia_tensor'",
    ),
    "inertia in another order": ("template", _swap_numbers, "'inertia_tensor'"),
    "five entries": (
        "template",
        lambda t: re.sub(r"(inertia_tensor) \S+", r"\1", t),
        "manifest says|keyword",
    ),
    "use_volume missing": ("template", lambda t: t.replace("use_volume ", ""), "lacks 'use_volume'"),
    "scale missing": ("template", lambda t: re.sub(r"scale \S+", "", t), "lacks 'scale'"),
    "scale of another unit": ("template", lambda t: t.replace("scale 0.001", "scale 1"), "'scale' 1"),
    "another file": ("template", lambda t: t.replace(".multisphere", ".spheres"), "'file'"),
    "type out of order": ("template", lambda t: t.replace(" type 1", " type 2"), "'type' 2"),
    "misspelt": ("template", lambda t: t.replace("use_volume", "use_volumes"), "where a keyword"),
    "another command": ("template", lambda t: t.replace("fix template1", "unfix template1"), "is no 'fix"),
    "ntry": ("template", lambda t: t.replace("ntry 200000", "ntry 10"), "ntry"),
    "empty": ("template", lambda t: "", "is no 'fix"),
}


@pytest.fixture(scope="module")
def exported(avatar, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("liggghts") / "out"
    export(avatar, "liggghts", folder, density=2650, unit="mm", spheres=6)
    return folder


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_a_corrupted_file_is_refused(kind, exported):
    suffix, change, message = CORRUPTIONS[kind]
    path = exported / f"grain_1.{suffix}"
    text = path.read_text()
    changed = change(text)
    assert changed != text, "the corruption must change the file"
    try:
        path.write_text(changed)
        with pytest.raises(ExportError, match=message) as caught:
            validate(exported, digests=False)
        assert str(path) in str(caught.value)
    finally:
        path.write_text(text)
    validate(exported)


def test_a_deck_without_its_templates_is_refused(exported):
    deck = exported / "in.settle"
    text = deck.read_text()
    try:
        deck.write_text(text.replace("include grain_1.template", ""))
        with pytest.raises(ExportError, match="does not include"):
            validate(exported, digests=False)
    finally:
        deck.write_text(text)


def test_seeds_are_primes():
    assert prime_above(10000) == 10007
    assert prime_above(10007) == 10009
    assert prime_above(13) == 17
