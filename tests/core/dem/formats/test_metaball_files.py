"""Metaball files hold the avatar to the last digit, and corrupted ones are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.dem import export, read_metaball, validate
from mbstudio.core.errors import ExportError


@pytest.fixture
def folder(avatar, tmp_path) -> Path:
    export(avatar, "metaball", tmp_path / "out")
    return tmp_path / "out"


@pytest.mark.parametrize("suffix", [".json", ".csv"])
def test_the_avatar_comes_back_where_it_was(suffix, avatar, folder):
    back = read_metaball(folder / f"grain_1{suffix}")
    assert back.centers == pytest.approx(avatar.centers, rel=1e-12)
    assert back.weights == pytest.approx(avatar.weights, rel=1e-14)
    assert (back.unit, back.label, back.name) == (avatar.unit, avatar.label, avatar.name)
    points = np.random.default_rng(0).uniform(*avatar.bounds(), (100, 3))
    assert back.field(points) == pytest.approx(avatar.field(points), rel=1e-9)


def test_the_files_say_unit_pose_scale_and_version(avatar, tmp_path):
    export(avatar, "metaball", tmp_path / "out", unit="um")
    record = json.loads((tmp_path / "out" / "grain_1.json").read_text())
    assert (record["format"], record["version"], record["unit"]) == ("mbstudio-metaball", 1, "um")
    assert record["scale"]["metres_per_unit"] == 1e-6
    table = np.loadtxt(tmp_path / "out" / "grain_1.csv", delimiter=",", skiprows=1)
    assert table[:, 3] == pytest.approx(avatar.weights * 1e6)
    assert (tmp_path / "out" / "grain_1.csv").read_text().splitlines()[0] == "x,y,z,k"
    local = read_metaball(tmp_path / "out" / "grain_1.csv", frame="principal")
    assert local.centers == pytest.approx(table[:, :3])


CSV = {
    "no header": (lambda text: text.split("\n", 1)[1], "has the header"),
    "negative weight": (lambda text: _with_cell(text, 2, 3, "-0.1"), "k > 0"),
    "text for a number": (lambda text: _with_cell(text, 2, 0, "abc"), "no table of control points"),
    "not finite": (lambda text: _with_cell(text, 2, 1, "inf"), "finite"),
    "a column lost": (lambda text: "\n".join(line.rsplit(",", 1)[0] for line in text.splitlines()), "header"),
    "a row lost": (lambda text: text.rsplit("\n", 2)[0], "same control points"),
    "one number changed": (lambda text: _with_cell(text, 2, 0, "0.123"), "same control points"),
    "empty": (lambda text: "", "header"),
}


def _with_cell(text: str, row: int, column: int, value: str) -> str:
    rows = [line.split(",") for line in text.splitlines()]
    rows[row][column] = value
    return "\n".join(",".join(cells) for cells in rows)


@pytest.mark.parametrize("kind", CSV)
def test_a_corrupted_table_is_refused(kind, folder):
    change, message = CSV[kind]
    path = folder / "grain_1.csv"
    path.write_text(change(path.read_text()))
    with pytest.raises(ExportError, match=message) as caught:
        validate(folder, digests=False)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("format", "x", "not a metaball file"),
        ("version", 2, "version 2"),
        ("unit", "um", "is in um"),
        ("weights", [1.0], "does not contain a metaball"),
        ("centers", "none", "missing or invalid"),
        ("pose", {"position": [0, 0, 0], "quaternion": [2, 0, 0, 0]}, "not a rotation"),
    ],
)
def test_a_corrupted_record_is_refused(key, value, message, folder):
    path = folder / "grain_1.json"
    record = json.loads(path.read_text())
    record[key] = value
    path.write_text(json.dumps(record))
    with pytest.raises(ExportError, match=message):
        validate(folder, digests=False)


def test_both_files_shifted_together_are_refused(folder):
    path = folder / "grain_1.json"
    record = json.loads(path.read_text())
    moved = np.array(record["centers"]) + np.array([0.1, 0, 0])
    record["centers"] = moved.tolist()
    path.write_text(json.dumps(record))
    rows = np.column_stack([moved, record["weights"]])
    np.savetxt(folder / "grain_1.csv", rows, fmt="%.17g", delimiter=",", header="x,y,z,k", comments="")
    with pytest.raises(ExportError, match="not the avatar that the manifest describes"):
        validate(folder, digests=False)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ExportError, match=r"nothing\.json cannot be read"):
        read_metaball(tmp_path / "nothing.json")
