"""Every file of every target is read back: none can be emptied, cut or lost without being refused."""

from __future__ import annotations

import pytest

from mbstudio.core.dem import export, targets, validate
from mbstudio.core.errors import ExportError

FAST = {"clump": {"spheres": 5}, "mesh": {"cells": 12}, "grid": {"cells": 14, "shell": 8}, "metaball": {}}
EXAMPLES = {
    **dict.fromkeys(("stl", "obj", "ply", "metaball"), "check_shapes.py"),
    **dict.fromkeys(("yade", "yade-level-set", "peclet", "kratos", "dem-engine"), "settle.py"),
    "liggghts": "in.settle",
    "lammps": "in.settle",
    "pfc": "settle.dat",
    "comflusom": "add_metaballs.h",
    "mercury": "Settle.cpp",
    "edem": "settle.txt",
    "mechsys": "settle.cpp",
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_no_file_can_be_emptied_or_cut_unseen(name, avatar, tmp_path):
    """A file that no validator reads would be swallowed as it is, whatever became of it."""
    report = export(avatar, name, tmp_path / "out", density=2650, **FAST[targets()[name].geometry])
    for path in report.files[:-1]:
        content = path.read_bytes()
        for changed in (b"", content[: len(content) // 2]):
            path.write_bytes(changed)
            with pytest.raises(ExportError) as caught:
                validate(tmp_path / "out", digests=False)
            assert path.name in str(caught.value)
        path.unlink()
        with pytest.raises(ExportError, match="missing"):
            validate(tmp_path / "out", digests=False)
        path.write_bytes(content)
    validate(tmp_path / "out")


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_target_has_an_example_beside_its_shapes(name, avatar, tmp_path):
    report = export(avatar, name, tmp_path / "out", density=2650, **FAST[targets()[name].geometry])
    assert EXAMPLES[name] in report.manifest["shared_files"]


def test_no_target_is_left_out():
    assert set(EXAMPLES) == set(targets())
