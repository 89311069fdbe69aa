"""Results come back: tables of poses and dumps give the packing that was written, or are refused."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.dem import SpecimenPlan, export
from mbstudio.core.dem.specimen.placing import rotations_of
from mbstudio.core.errors import PackingError
from mbstudio.core.packing.dumps import Frame, find_poses, read_last_frame
from mbstudio.core.packing.grain_kinds import prepare_kinds
from mbstudio.core.packing.poses import COLUMNS, read_poses, write_poses
from mbstudio.core.packing.reading import read_packing
from tests.core.dem.conftest import engine_or_skip


def test_a_table_of_poses_comes_back(settled, grains, tmp_path):
    path = tmp_path / "poses.csv"
    write_poses(path, settled.poses, settled.kinds.names)
    back = read_packing(path, grains, width=2 * settled.mould.half, spheres=6)
    assert back.poses.positions == pytest.approx(settled.poses.positions, abs=1e-9)
    assert back.measures(0.4).porosity == pytest.approx(settled.measures(0.4).porosity, abs=1e-6)
    assert back.measures(0.4).coordination == pytest.approx(settled.measures(0.4).coordination, abs=0.15)


def test_without_a_width_the_mould_is_where_the_grains_reach(settled, grains, tmp_path):
    path = tmp_path / "poses.csv"
    write_poses(path, settled.poses, settled.kinds.names)
    assert read_packing(path, grains, spheres=6).mould.half == pytest.approx(settled.mould.half, rel=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lines: [*lines[:-1], lines[-1][: len(lines[-1]) // 3]], "cut off or damaged: row 20"),
        (
            lambda lines: [lines[0], lines[1].replace("grain_", "stone_"), *lines[2:]],
            "other grains: .*stone_",
        ),
        (lambda lines: [lines[0].replace("qw", "angle"), *lines[1:]], "no column 'qw'"),
        (
            lambda lines: [lines[0], ",".join([*lines[1].split(",")[:5], "1,1,0,0"])],
            "no rotation: .* grain 1",
        ),
        (lambda lines: [lines[0], "grain_1,nan,0,0,0,1,0,0,0"], "not finite"),
        (lambda lines: lines[:1], "has no grains"),
        (lambda _lines: [], "no column 'avatar'"),
    ],
)
def test_damaged_tables_are_refused(settled, tmp_path, change, words):
    path = tmp_path / "poses.csv"
    write_poses(path, settled.poses, settled.kinds.names)
    path.write_text("\n".join(change(path.read_text().splitlines())), encoding="utf-8")
    with pytest.raises(PackingError, match=words):
        read_poses(path, settled.kinds.names)


def dump_of(folder: Path) -> tuple[Path, np.ndarray]:
    """Write a dump in which each grain of a specimen was turned and shifted, with its places."""
    rng = np.random.default_rng(2)
    specimen = read_poses(folder / "specimen.csv", NAMES)
    turns = rng.normal(size=(len(specimen), 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    places = specimen.positions + rng.normal(size=(len(specimen), 3))
    lines = []
    for kind, scale, place, turn in zip(
        specimen.kinds, specimen.scales, places, rotations_of(turns), strict=True
    ):
        spheres = np.array(
            [
                row.split()[1:]
                for row in (folder / f"{NAMES[kind]}.mol").read_text().split("\n\n")[3].splitlines()
            ],
            dtype=float,
        )
        lines += [" ".join(f"{x:.12g}" for x in row) for row in scale * spheres @ turn.T + place]
    rows = [f"{number} 1 {line}" for number, line in enumerate(lines, start=1)]
    rng.shuffle(rows)
    head = [
        "ITEM: TIMESTEP", "500", "ITEM: NUMBER OF ATOMS", str(len(rows)), "ITEM: BOX BOUNDS ff ff ff",
        "-1 1", "-1 1", "0 1", "ITEM: ATOMS id type x y z",
    ]  # fmt: skip
    path = folder / "dump.lammpstrj"
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="ascii")
    return path, places


NAMES = ("grain_1", "grain_2", "grain_3")


@pytest.fixture(scope="module")
def written(grains, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export") / "lammps"
    plan = SpecimenPlan(9, seed=1)
    export(grains, "lammps", folder, density=2650.0, names=NAMES, spheres=6, specimen=plan)
    return folder


@pytest.fixture
def exported(written, tmp_path):
    return Path(shutil.copytree(written, tmp_path / "lammps"))


def test_dumped_spheres_give_the_poses_of_their_grains(exported, grains):
    path, places = dump_of(exported)
    back = read_packing(path, grains, specimen=exported / "specimen.csv", names=NAMES)
    assert back.poses.positions == pytest.approx(places, abs=1e-9)
    assert back.history["steps"] == 500
    # The spheres of the packing are those of the dump.
    rows = sorted(
        (int(words[0]), [float(word) for word in words[2:]])
        for line in path.read_text().splitlines()[9:]
        if (words := line.split())
    )
    spheres = [
        scale * back.kinds.clumps[kind].centers @ turn.T + place
        for kind, scale, place, turn in zip(
            back.poses.kinds, back.poses.scales, back.poses.positions, back.poses.rotations, strict=True
        )
    ]
    assert np.concatenate(spheres) == pytest.approx(np.array([row[1] for row in rows]), abs=1e-9)


def test_what_lammps_has_written_comes_back(exported, grains):
    """A short run of the deck: grains fall freely and do not turn."""
    lammps, deck = engine_or_skip("LAMMPS")[0], exported / "in.specimen"
    last = "write_dump all custom last.lammpstrj id x y z modify sort id format float %.12g"
    deck.write_text(re.sub(r"(?m)^run \d+$", f"run 100\n{last}", deck.read_text()))
    subprocess.run([lammps, "-in", deck.name], cwd=exported, check=True, capture_output=True)
    step = float(re.search(r"(?m)^timestep (\S+)$", deck.read_text()).group(1))
    start = read_poses(exported / "specimen.csv", NAMES)
    back = read_packing(exported / "last.lammpstrj", grains, specimen=exported / "specimen.csv", names=NAMES)
    assert back.history["steps"] == 100
    fallen = start.positions - back.poses.positions
    assert fallen[:, 2] == pytest.approx(9.81 * (100 * step) ** 2 / 2, rel=0.02)
    assert np.abs(fallen[:, :2]).max() < 1e-9
    assert back.poses.rotations == pytest.approx(start.rotations, abs=1e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text[: len(text) // 2], "cut off or damaged"),
        (lambda text: text.replace("id type x y z", "id type vx vy vz"), "no column"),
        (lambda text: re.sub(r"\n5 1 \S+", "\n5 1 0.7", text), "of other grains"),
        (lambda text: "\n".join(text.replace("AMS\n54", "AMS\n54").splitlines()[:-1]), "cut off"),
    ],
)
def test_damaged_dumps_are_refused(exported, grains, change, words):
    path, _ = dump_of(exported)
    path.write_text(change(path.read_text()), encoding="ascii")
    with pytest.raises(PackingError, match=words):
        read_packing(path, grains, specimen=exported / "specimen.csv", names=NAMES)


def test_a_dump_of_fewer_grains_is_refused(exported, grains):
    path, _ = dump_of(exported)
    lines = path.read_text().splitlines()
    lines[3] = "48"
    path.write_text("\n".join(lines[:-6]) + "\n", encoding="ascii")
    with pytest.raises(
        PackingError, match="cut off, or grains were lost: it has 48 spheres, the specimen 54"
    ):
        read_packing(path, grains, specimen=exported / "specimen.csv", names=NAMES)


def test_a_dump_needs_its_specimen(exported, grains):
    path, _ = dump_of(exported)
    with pytest.raises(PackingError, match=r"name the specimen\.csv"):
        read_packing(path, grains)
    with pytest.raises(PackingError, match="has 3 avatars, here are 2"):
        read_packing(path, grains[:2], specimen=exported / "specimen.csv")


def test_grains_across_a_periodic_side_are_joined(grains):
    clump = prepare_kinds(grains[:1], spheres=6, processes=1).clumps[0].centers
    placed = clump + np.array([1.95, 0, 1])
    wrapped = placed.copy()
    wrapped[:, 0] = (wrapped[:, 0] + 2) % 4 - 2  # as an engine writes what left at one side
    frame = Frame(0, np.arange(6), wrapped, np.array([4.0, 4.0, np.inf]))
    place, turn = find_poses(frame, [clump], np.array([0]), np.ones(1), 1e-6, "dump")
    away = (place[0] - [1.95, 0, 1]) / 4
    assert away == pytest.approx(np.round(away), abs=1e-9)
    assert turn[0] == pytest.approx(np.eye(3), abs=1e-9)


def test_the_columns_of_a_table_are_those_of_a_specimen(exported):
    header = (exported / "specimen.csv").read_text().splitlines()[0].split(",")
    assert set(COLUMNS) <= set(header)


def test_numbers_beyond_all_bounds_in_a_table_of_poses(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("avatar,scale,x,y,z,qw,qx,qy,qz\nball,1,0,0,0,1e200,0,0,0\n")
    with pytest.raises(PackingError, match=r"poses\.csv has a pose that is no rotation"):
        read_poses(path, ["ball"])


def test_a_row_of_a_table_of_poses_without_its_avatar(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("scale,x,y,z,qw,qx,qy,qz,avatar\n1,0,0,0,1,0,0,0\n")
    with pytest.raises(PackingError, match="no avatar ''"):
        read_poses(path, ["ball"])


def test_a_number_of_an_atom_beyond_64_bits(tmp_path):
    path = tmp_path / "dump.lammpstrj"
    head = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS ff ff ff\n-1 1\n-1 1\n-1 1\n"
    path.write_text(f"{head}ITEM: ATOMS id x y z\n{2**70} 0 0 0\n")
    with pytest.raises(PackingError, match="damaged in its last frame"):
        read_last_frame(path)
