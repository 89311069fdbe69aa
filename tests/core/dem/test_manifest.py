"""The manifest refuses numbers that cannot be, and files that are not its own."""

from __future__ import annotations

import json

import pytest

from mbstudio.core.dem import export, validate
from mbstudio.core.dem.manifest import check_moments
from mbstudio.core.errors import ExportError


@pytest.fixture
def folder(avatar, tmp_path):
    export(avatar, "metaball", tmp_path / "out", density=2650, unit="mm")
    return tmp_path / "out"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("format",), "other", "not a manifest"),
        (("version",), 99, "version 99"),
        (("unit",), "yard", "unknown unit"),
        (("unit",), "um", "not density times volume"),
        (("density",), -1, "density of -1"),
        (("target",), "rocky", "not a DEM target"),
        (("items", 0, "volume"), -1.0, "volume of -1"),
        (("items", 0, "mass"), 1.0, "not density times volume"),
        (("items", 0, "mass"), None, r"manifest\.json: 'grain_1' has a mass"),
        (("items", 0, "moments"), [1.0, 1.0, -1.0], "not a positive number"),
        (("items", 0, "moments"), [1.0, 1.0, 9.0], "no solid body"),
        (("items", 0, "pose", "quaternion"), [1.0, 1.0, 0.0, 0.0], "not of length 1"),
        (("items", 0, "pose", "position"), [0.0, 0.0, float("inf")], "not finite"),
        (("items", 0, "pose"), {}, "missing or invalid"),
        (("files",), {"../escape": "sha256:"}, "outside"),
    ],
)
def test_every_corruption_is_named(path, value, message, folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    place = manifest
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ExportError, match=message):
        validate(folder)


def test_a_missing_or_cut_manifest_is_named(folder):
    text = (folder / "manifest.json").read_text()
    (folder / "manifest.json").write_text(text[: len(text) // 2])
    with pytest.raises(ExportError, match="cannot be read"):
        validate(folder)
    (folder / "manifest.json").unlink()
    with pytest.raises(ExportError, match="missing"):
        validate(folder)


def test_a_changed_or_lost_file_is_named(folder):
    record = folder / "grain_1.json"
    record.write_text(record.read_text() + "\n")
    with pytest.raises(ExportError, match=r"grain_1\.json was changed"):
        validate(folder)
    validate(folder, digests=False)
    record.unlink()
    with pytest.raises(ExportError, match=r"grain_1\.json is missing"):
        validate(folder, digests=False)


def test_moments_of_a_flat_plate_are_the_limit():
    check_moments("plate", 1.0, [1.0, 1.0, 2.0])
    with pytest.raises(ExportError, match="no solid body"):
        check_moments("plate", 1.0, [1.0, 1.0, 2.01])
