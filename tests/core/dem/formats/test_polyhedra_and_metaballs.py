"""MechSys polyhedra, ComFluSoM metaballs and Yade's level sets: their grammar, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.dem import export
from mbstudio.core.dem.formats.comflusom import search_scale, search_succeeds
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import mass_properties
from tests.core.dem.corruption import assert_arrays_refused, assert_refused


@pytest.fixture(scope="module")
def exported(avatar, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("others")
    export(avatar, "mechsys", folder / "mechsys")
    export(avatar, "comflusom", folder / "comflusom")
    export(avatar, "yade-level-set", folder / "yade-level-set", density=2650, cells=14, shell=8)
    return folder


def test_mechsys_gets_a_closed_polyhedron_of_the_avatars_volume(avatar, exported):
    record = json.loads((exported / "mechsys" / "grain_1.json").read_text())
    vertices = np.array([entry["c"] for entry in record["verts"]])
    faces = np.array([entry["verts"] for entry in record["faces"]])
    assert len(vertices) - len(record["edges"]) + len(faces) == 2
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume / mass_properties(avatar, 1.0).volume == pytest.approx(1, rel=0.01)


def edited(change):
    def edit(text: str) -> str:
        record = json.loads(text)
        change(record)
        return json.dumps(record)

    return edit


MECHSYS = {
    "a face lost": (edited(lambda r: r["faces"].pop()), "not a closed"),
    "a face turned": (edited(lambda r: r["faces"][0]["verts"].reverse()), "not a closed"),
    "inside out": (edited(lambda r: [face["verts"].reverse() for face in r["faces"]]), "inside out"),
    "an edge lost": (edited(lambda r: r["edges"].pop()), "every edge"),
    "an edge twice": (edited(lambda r: r["edges"].append(r["edges"][0])), "every edge"),
    "a vertex that is not there": (
        edited(lambda r: r["faces"][0].update(verts=[0, 1, 99999])),
        "missing vertices",
    ),
    "not finite": (lambda t: re.sub(r'"c": \[[^,]+', '"c": [NaN', t, count=1), "not finite"),
    "another unit": (
        edited(lambda r: [v.update(c=[10 * x for x in v["c"]]) for v in r["verts"]]),
        "a volume",
    ),
    "moved": (edited(lambda r: [v.update(c=[x + 1 for x in v["c"]]) for v in r["verts"]]), "centre of mass"),
    "no edges": (edited(lambda r: r.pop("edges")), "not contain a polyhedron"),
    "cut": (lambda t: t[: len(t) // 2], "not contain a polyhedron"),
}


@pytest.mark.parametrize("kind", MECHSYS)
def test_a_corrupted_polyhedron_is_refused(kind, exported):
    assert_refused(exported / "mechsys", "grain_1.json", *MECHSYS[kind])


def test_comflusom_gets_our_k_and_a_call_for_each_avatar(avatar, exported):
    rows = np.loadtxt(exported / "comflusom" / "grain_1.csv", delimiter=",", skiprows=1)
    manifest = json.loads((exported / "comflusom" / "manifest.json").read_text())
    scale = manifest["items"][0]["details"]["scale"]
    assert rows[:, 3] / avatar.weights == pytest.approx(scale**2, rel=1e-12)
    text = (exported / "comflusom" / "add_metaballs.h").read_text()
    assert "d->AddMetaball(-1, rs, P, K, rho);" in text
    points = re.findall(r"\{(\S+), (\S+), (\S+)\}", text)
    assert np.array(points, dtype=float) == pytest.approx(rows[:, :3], rel=1e-15)
    weights = re.search(r"K << (.*);", text)[1].split(", ")
    assert np.array(weights, dtype=float) == pytest.approx(rows[:, 3], rel=1e-15)


@pytest.mark.parametrize(("radius", "well"), [(0.5, False), (0.57, False), (0.58, True), (3, True)])
def test_the_search_of_comflusom_by_hand(radius, well):
    """One control point, f = R**2 / r**2: from r = 1 outside, the one step ends at 1.5 - 1 / (2 R**2).

    That is below zero for R**2 < 1/3. From inside Newton's method ends on the surface.
    """
    assert search_succeeds(Avatar([[1.0, 2, 3]], [radius**2], "mm")).all() == well


def test_avatars_are_scaled_to_where_the_search_succeeds(avatars, tmp_path):
    small = [avatar.scaled(0.1) for avatar in avatars]
    assert not all(search_succeeds(avatar).all() for avatar in small)
    factor = search_scale(small, 0.12)
    assert all(search_succeeds(avatar.scaled(factor)).all() for avatar in small)
    report = export(small, "comflusom", tmp_path / "scaled")
    assert report.warnings == ()
    report = export(small, "comflusom", tmp_path / "kept", scaled=False)
    assert len(report.warnings) == 3
    assert "'grain_1': ComFluSoM's search" in report.warnings[0]


COMFLUSOM = {
    "header": ("grain_1.csv", lambda t: t.replace("x,y,z,k", "x,y,z,r"), "has the header"),
    "negative k": ("grain_1.csv", lambda t: re.sub(r",([^,\n]+)\n$", r",-\1\n", t), "k > 0"),
    "a row lost": ("grain_1.csv", lambda t: t.rstrip().rpartition("\n")[0], "number of control points"),
    "other points": ("grain_1.csv", lambda t: re.sub(r"\n[^,]+", "\n0.5", t), "not the avatar"),
    "calls of others": (
        "add_metaballs.h",
        lambda t: t.replace("K << ", "K << 1"),
        "does not add the control",
    ),
    "a call twice": (
        "add_metaballs.h",
        lambda t: t + "d->AddMetaball(-1, rs, P, K, rho);",
        "does not add every avatar once",
    ),
}


@pytest.mark.parametrize("kind", COMFLUSOM)
def test_a_corrupted_metaball_is_refused(kind, exported):
    name, change, message = COMFLUSOM[kind]
    assert_refused(exported / "comflusom", name, change, message)


def test_yades_level_set_is_a_padded_grid_and_a_script(avatar, exported):
    folder = exported / "yade-level-set"
    with np.load(folder / "grain_1.npz") as stored:
        grid, mass = stored["grid"], float(stored["mass"])
    assert grid[0].min() > 0
    assert grid[:, :, -1].min() > 0
    assert mass / mass_properties(avatar, 2650).mass == pytest.approx(1, rel=1e-9)
    script = (folder / "settle.py").read_text()
    compile(script, "settle.py", "exec")
    assert "levelSetBody(" in script
    assert "nSurfNodes=402" in script
    assert_arrays_refused(folder, "grain_1.npz", lambda a: a.update(grid=a["grid"][2:]), "nodes|cropped")
    assert_refused(folder, "settle.py", lambda t: t.replace("grain_1.npz", "b.npz"), "does not load")
