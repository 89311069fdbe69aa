"""Export as a whole: all or nothing, names, poses, what stays and what goes."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import mbstudio
from mbstudio.core.dem import export, targets, validate
from mbstudio.core.errors import AvatarError, ExportError, MbstudioError, UnitError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import mass_properties

FAST = {
    "stl": {"cells": 12},
    "obj": {"cells": 12},
    "ply": {"cells": 12},
    "metaball": {},
    "liggghts": {"spheres": 5},
    "lammps": {"spheres": 5},
    "kratos": {"spheres": 5},
    "peclet": {"cells": 14, "shell": 8},
    "yade": {"spheres": 5},
    "yade-level-set": {"cells": 14, "shell": 8},
    "pfc": {"spheres": 5},
    "dem-engine": {"spheres": 5},
    "comflusom": {},
    "mercury": {"spheres": 5},
    "edem": {"spheres": 5},
    "mechsys": {},
}
FREE_OF_DENSITY = {"stl", "obj", "ply", "metaball", "pfc", "comflusom", "edem", "mechsys"}


def everything_in(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_the_registry_names_every_target():
    assert list(targets()) == list(FAST)
    assert {name for name, target in targets().items() if not target.needs_density} == FREE_OF_DENSITY
    for name, target in targets().items():
        assert target.name == name
        assert target.title
        assert all(option.meaning for option in target.options.values())


@pytest.mark.parametrize("target", FAST)
def test_every_target_writes_what_it_reports_and_reads_it_back(target, avatars, tmp_path):
    seen = []
    report = export(
        avatars,
        target,
        tmp_path / "out",
        density=2650,
        progress=lambda f, m: seen.append((f, m)),
        **FAST[target],
    )
    assert sorted(report.files) == sorted(p for p in (tmp_path / "out").rglob("*") if p.is_file())
    assert report.files[-1].name == "manifest.json"
    assert json.loads(report.files[-1].read_text()) == report.manifest == validate(tmp_path / "out")
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
    assert [item["name"] for item in report.items] == ["grain_1", "grain_2", "grain_3"]


def test_the_manifest_holds_mass_moments_and_pose_of_each_avatar(avatars, tmp_path):
    report = export(avatars, "metaball", tmp_path / "out", density=2650, unit="um")
    assert report.manifest["version"] == 1
    assert report.manifest["mbstudio"] == mbstudio.__version__
    assert (report.manifest["unit"], report.manifest["density"]) == ("um", 2650)
    for avatar, item in zip(avatars, report.items, strict=True):
        mass = mass_properties(avatar, 2650)
        assert item["source"] == {"name": avatar.name, "label": avatar.label, "control_points": avatar.n}
        assert item["volume"] == pytest.approx(mass.volume * 1e9)
        assert item["mass"] == pytest.approx(mass.mass)
        assert item["moments"] / mass.to("m").principal == pytest.approx(1, rel=1e-6)
        assert item["pose"]["position"] == pytest.approx(mass.com * 1000)
        table = np.loadtxt(tmp_path / "out" / item["files"][0], delimiter=",", skiprows=1)
        w, *xyz = item["pose"]["quaternion"]
        back = table[:, :3] @ Rotation.from_quat([*xyz, w]).as_matrix().T + item["pose"]["position"]
        assert back == pytest.approx(avatar.centers * 1000)
        assert table[:, 3] == pytest.approx(avatar.weights * 1e6)


def test_without_a_density_no_mass_is_stated(avatar, tmp_path):
    (item,) = export(avatar, "metaball", tmp_path / "out").items
    assert item["mass"] is None
    assert item["moments"] is None
    with pytest.raises(ExportError, match="density"):
        export(avatar, "liggghts", tmp_path / "other")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"density": 0}, "density of 0"),
        ({"density": float("nan")}, "density of nan"),
        ({"target": "rocky"}, "not a DEM target"),
        ({"names": ["a b"]}, "'a b' cannot be the name"),
        ({"names": ["../a"]}, "cannot be the name"),
        ({"names": ["con"]}, "cannot be the name"),
        ({"names": ["manifest"]}, "cannot be the name"),
        ({"names": ["settle"], "target": "pfc"}, "cannot be the name"),
        ({"names": ["a", "b"]}, "2 names were given for 1"),
        ({"cells": 3}, "from 8 to 200"),
        ({"cells": "many"}, "cannot be 'many'"),
        ({"cells": 20.5}, "whole number"),
        ({"cells": float("inf")}, "whole number"),
        ({"binary": "perhaps"}, "yes or no"),
        ({"spheres": 3}, "no option 'spheres'"),
    ],
)
def test_what_cannot_be_is_named_and_nothing_is_written(change, message, avatar, tmp_path):
    arguments = {"target": "stl", "density": 2650, **change}
    with pytest.raises(ExportError, match=message):
        export(avatar, arguments.pop("target"), tmp_path / "out", **arguments)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("weights", [[float("nan"), 1.0], [float("inf"), 1.0], [-1.0, 1.0]])
def test_an_avatar_with_an_impossible_k_cannot_even_be_made(weights, tmp_path):
    with pytest.raises(AvatarError, match="'odd'"):
        export(Avatar([[0, 0, 0], [0.5, 0, 0]], weights, "mm", name="odd"), "stl", tmp_path / "out")
    assert not any(tmp_path.iterdir())


def test_options_may_come_as_text_from_a_command_line(avatar, tmp_path):
    report = export(avatar, "stl", tmp_path / "out", cells="12", error="0", binary="no")
    assert report.manifest["options"] == {"cells": 12, "error": 0.0, "binary": False}
    assert (tmp_path / "out" / "grain_1.stl").read_text().startswith("solid")


def test_an_unknown_unit_and_an_empty_selection_are_refused(avatar, tmp_path):
    with pytest.raises(UnitError, match="furlong"):
        export(avatar, "stl", tmp_path / "out", unit="furlong")
    with pytest.raises(ExportError, match="no avatar"):
        export([], "stl", tmp_path / "out")


def test_names_given_twice_are_refused_and_made_ones_are_told_apart(avatar, tmp_path):
    with pytest.raises(ExportError, match="twice"):
        export([avatar, avatar], "metaball", tmp_path / "out", names=["a", "A"])
    odd = [
        Avatar(avatar.centers, avatar.weights, "mm", name=name)
        for name in ("my grain/1", "my grain/1", "é", "con")
    ]
    report = export(odd, "metaball", tmp_path / "out")
    assert [item["name"] for item in report.items] == ["my_grain_1", "my_grain_1_2", "avatar", "con_2"]


def test_an_avatar_in_pieces_names_itself_and_leaves_nothing(avatar, tmp_path):
    pieces = Avatar([[-5, 0, 0], [5, 0, 0]], [1.0, 1.0], "mm", name="broken")
    with pytest.raises(ExportError, match=r"'broken' cannot be exported.*2 pieces"):
        export([avatar, pieces], "stl", tmp_path / "out", cells=12)
    assert not any(tmp_path.iterdir())


def test_a_hollow_avatar_is_refused(tmp_path):
    shell = trimesh.creation.icosphere(2, radius=3.0).vertices
    hollow = Avatar(shell, np.full(len(shell), 0.05), "mm", name="egg")
    assert hollow.field(np.zeros((1, 3)))[0] < 1 < hollow.field(shell[:1] * 1.01)[0]
    with pytest.raises(ExportError, match=r"'egg' cannot be exported: it encloses 1 void"):
        export(hollow, "stl", tmp_path / "out", cells=12)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("target", FAST)
def test_one_control_point_goes_to_every_target(target, tmp_path):
    ball = Avatar([[4, 5, 6]], [0.25], "mm", name="ball")
    unit = "m" if targets()[target].units == ("m",) else "mm"
    report = export(ball, target, tmp_path / "out", density=2650, unit=unit, **FAST[target])
    mm = {"mm": 1, "m": 1000}[unit]
    assert report.items[0]["volume"] * mm**3 == pytest.approx(4 / 3 * np.pi * 0.5**3, rel=1e-4)
    assert np.array(report.items[0]["pose"]["position"]) * mm == pytest.approx([4, 5, 6])


def test_a_later_export_replaces_the_earlier_and_keeps_other_files(avatars, tmp_path):
    out = tmp_path / "out"
    export(avatars, "metaball", out)
    (out / "notes.txt").write_text("mine")
    (out / "runs").mkdir()
    (out / "runs" / "log").write_text("mine too")
    export(avatars[:1], "stl", out, names=["one"], cells=12)
    assert sorted(p.name for p in out.iterdir()) == [
        "check_shapes.py",
        "manifest.json",
        "notes.txt",
        "one.stl",
        "runs",
    ]
    assert (out / "notes.txt").read_text() == "mine"
    assert (out / "runs" / "log").read_text() == "mine too"


def test_folders_of_an_earlier_export_go_and_other_files_in_them_stay(avatars, tmp_path):
    out = tmp_path / "out"
    export(avatars, "mercury", out, density=2650, spheres=4)
    assert (out / "grain_1" / "Inertia" / "TOI.txt").is_file()
    (out / "grain_2" / "Clump" / "notes.txt").write_text("mine")
    export(avatars, "mercury", out, density=2650, spheres=5)
    assert len((out / "grain_3" / "Clump" / "Clump.txt").read_text().splitlines()) == 5
    export(avatars[:1], "metaball", out)
    assert sorted(p.name for p in out.iterdir()) == [
        "check_shapes.py",
        "grain_1.csv",
        "grain_1.json",
        "grain_2",
        "manifest.json",
    ]
    assert sorted(everything_in(out / "grain_2")) == ["Clump/notes.txt"]


def test_a_swap_of_folders_that_fails_half_way_is_undone(avatars, tmp_path):
    out = tmp_path / "out"
    export(avatars, "metaball", out)
    (out / "grain_2").write_text("a file where a folder must go")
    before = everything_in(out)
    with pytest.raises(ExportError, match=f"{out} cannot be written"):
        export(avatars, "mercury", out, density=2650, spheres=4)
    assert everything_in(out) == before
    assert [p for p in out.iterdir() if p.is_dir()] == []


def test_a_folder_with_other_files_is_refused_unless_allowed(avatar, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    (tmp_path / "a.csv").write_text("in the way")
    before = everything_in(tmp_path)
    with pytest.raises(ExportError, match="contains other files"):
        export(avatar, "metaball", tmp_path, names=["a"])
    assert everything_in(tmp_path) == before
    export(avatar, "metaball", tmp_path, names=["a"], overwrite=True)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"
    assert (tmp_path / "a.csv").read_text().startswith("x,y,z,k")


def test_a_file_that_came_later_is_not_lost_to_a_new_export(avatar, tmp_path):
    out = tmp_path / "out"
    export(avatar, "metaball", out, names=["a"])
    (out / "b.csv").write_text("measured by hand")
    before = everything_in(out)
    with pytest.raises(ExportError, match=r"b\.csv is not from an earlier export"):
        export(avatar, "metaball", out, names=["b"])
    assert everything_in(out) == before


def test_a_file_in_place_of_the_folder_is_kept(avatar, tmp_path):
    place = tmp_path / "out"
    place.write_text("a file")
    with pytest.raises(ExportError, match=f"{place} is a file"):
        export(avatar, "stl", place)
    with pytest.raises(ExportError, match="cannot be written"):
        export(avatar, "stl", place / "below", cells=12)
    assert place.read_text() == "a file"
    assert list(tmp_path.iterdir()) == [place]


class Stop(MbstudioError):
    """What a cancelling caller raises."""


@pytest.mark.parametrize("moment", [0.0, 0.45, 0.9])
def test_a_cancelled_export_changes_nothing(moment, avatars, tmp_path):
    def cancel(fraction: float, message: str) -> None:
        if fraction >= moment:
            raise Stop

    with pytest.raises(Stop):
        export(avatars, "obj", tmp_path / "deep" / "new", cells=12, progress=cancel)
    assert not any(tmp_path.iterdir())
    export(avatars, "metaball", tmp_path / "out")
    before = everything_in(tmp_path)
    with pytest.raises(Stop):
        export(avatars, "obj", tmp_path / "out", cells=12, progress=cancel)
    assert everything_in(tmp_path) == before


@pytest.mark.parametrize("there_before", [False, True])
def test_a_full_disk_changes_nothing(there_before, avatars, tmp_path, monkeypatch):
    out = tmp_path / "out"
    if there_before:
        export(avatars, "metaball", out)
    before = everything_in(tmp_path)
    written = Path.write_text
    calls = []

    def write_until_full(path: Path, *args: object, **kwargs: object) -> int:
        calls.append(path)
        if len(calls) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return written(path, *args, **kwargs)

    monkeypatch.setattr(Path, "write_text", write_until_full)
    with pytest.raises(ExportError, match=f"{out} cannot be written.*No space left"):
        export(avatars, "obj", out, cells=12)
    assert len(calls) == 3
    assert everything_in(tmp_path) == before
    assert list(tmp_path.rglob(".mbstudio*")) == []


def test_a_swap_that_fails_half_way_is_undone(avatars, tmp_path, monkeypatch):
    out = tmp_path / "out"
    export(avatars, "metaball", out)
    before = everything_in(out)
    rename = Path.rename

    def rename_but_one(path: Path, target: Path) -> Path:
        if path.name == "grain_2.obj":
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", rename_but_one)
    with pytest.raises(ExportError, match=f"{out} cannot be written"):
        export(avatars, "obj", out, cells=12)
    assert everything_in(out) == before


def test_a_folder_without_rights_is_named(avatar, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    if os.access(locked, os.W_OK):
        pytest.skip("this user may write everywhere, so a folder without rights cannot be made")
    with pytest.raises(ExportError, match=f"{locked / 'out'} cannot be written"):
        export(avatar, "metaball", locked / "out")


def test_a_place_where_not_even_root_may_write_is_named(avatar, read_only_folder):
    place = read_only_folder / "mbstudio-export"
    with pytest.raises(ExportError, match=f"{place} cannot be written"):
        export(avatar, "metaball", place)
    assert not place.exists()


def test_a_disk_that_is_really_full(avatars, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=96k", "tmpfs", str(disk)]
    if (
        shutil.which("mount") is None
        or subprocess.run(mount, capture_output=True, check=False).returncode != 0
    ):
        pytest.skip("this user may not mount a small disk to fill")
    try:
        export(avatars, "metaball", disk / "out")
        before = everything_in(disk)
        with pytest.raises(ExportError, match=r"out cannot be written \(No space left"):
            export(avatars, "obj", disk / "out", cells=32)
        assert everything_in(disk) == before
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_the_folder_may_be_the_working_folder_and_stays_the_same_one(avatar, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inode = tmp_path.stat().st_ino
    export(avatar, "metaball", ".")
    export(avatar, "metaball", ".")
    assert tmp_path.stat().st_ino == inode
    assert (Path.cwd() / "manifest.json").is_file()


def test_two_exports_of_the_same_avatars_are_the_same_bytes(avatars, tmp_path):
    for name in ("first", "second"):
        export(avatars, "liggghts", tmp_path / name, density=2650, spheres=6)
    assert everything_in(tmp_path / "first") == everything_in(tmp_path / "second")
