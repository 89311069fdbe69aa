from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple

import pytest

from mbstudio.cli import main


class Ran(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def mbstudio(capsys, monkeypatch) -> Callable[..., Ran]:
    """Run the command line as a person does; return exit code and what it printed."""

    def run(*arguments: object) -> Ran:
        monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # restored afterwards
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main([str(argument) for argument in arguments])
        printed = capsys.readouterr()
        return Ran(left.value.code or 0, printed.out, printed.err)

    return run


@pytest.fixture(scope="session")
def fitted_project(small_scan_file, tmp_path_factory):
    """The three whole grains of the small scan, each with its avatar."""
    path = tmp_path_factory.mktemp("project") / "fitted.mbs"
    with pytest.raises(SystemExit) as left:
        main(
            [
                "fit",
                str(small_scan_file),
                "--voxel-size",
                "14 um",
                "-n",
                "12",
                "-o",
                str(path),
                "--workers",
                "0",
            ]
        )
    assert not left.value.code
    return path
