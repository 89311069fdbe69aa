"""Files of every format that there ever was open with the contents that they were written with.

`formats/NAME.mbs.gz` was written by the mbstudio of its time, `formats/NAME.json` tells what that mbstudio
had in memory, by :mod:`tests.core.project.contents`.
"""

from __future__ import annotations

import gzip
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.errors import ProjectWarning
from mbstudio.core.project import Project
from mbstudio.core.project.file import SCHEMA
from mbstudio.core.sealing import HEADER_BYTES, read_seal
from tests.core.project.contents import describe, differences

FOLDER = Path(__file__).with_name("formats")
NAMES = sorted(path.name.removesuffix(".mbs.gz") for path in FOLDER.glob("*.mbs.gz"))


def contents_of(path: Path) -> dict[str, object]:
    with Project.open(path) as project:
        return {**describe(project.state), "voxels": describe(np.asarray(project.scan.voxels))}


@pytest.mark.parametrize("name", NAMES)
def test_every_format_opens_with_what_was_written(tmp_path, name):
    path = tmp_path / f"{name}.mbs"
    path.write_bytes(gzip.decompress((FOLDER / f"{name}.mbs.gz").read_bytes()))
    before = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert differences(before, json.loads(json.dumps(contents_of(path)))) == []
    sealed = read_seal(path.read_bytes()[:HEADER_BYTES]) is not None
    assert [one.category for one in told] == ([] if sealed else [ProjectWarning])


@pytest.mark.parametrize("name", NAMES)
def test_saving_an_old_file_keeps_its_contents(tmp_path, name):
    path = tmp_path / f"{name}.mbs"
    path.write_bytes(gzip.decompress((FOLDER / f"{name}.mbs.gz").read_bytes()))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ProjectWarning)
        project = Project.open(path)
    project.save(tmp_path / "again.mbs")
    before = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert differences(before, json.loads(json.dumps(contents_of(tmp_path / "again.mbs")))) == []


def test_there_is_a_file_of_every_format():
    assert sorted({int(name.split("-")[1]) for name in NAMES}) == list(range(1, SCHEMA + 1))
