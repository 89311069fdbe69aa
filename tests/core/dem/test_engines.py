"""Finding DEM engines: on the path, beside the interpreter that a variable names, and as its modules."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from mbstudio.core.dem import engines
from mbstudio.core.errors import ExportError
from tests.core.dem.conftest import EXPECTED, engine_or_skip


def program(folder: Path, name: str, text: str = "#!/bin/sh\n") -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.fixture
def nowhere(tmp_path, monkeypatch) -> Path:
    """A machine with an empty path and no engines' interpreter."""
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv(engines.VARIABLE, str(tmp_path / "engines" / "python"))
    return tmp_path


def test_programs_are_found_on_the_path_before_those_beside_the_interpreter(nowhere):
    assert engines.find_engine("LAMMPS") is None
    beside = program(nowhere / "engines", "lmp")
    assert engines.find_engine("LAMMPS") == [str(beside)]
    on_path = program(nowhere / "bin", "lmp")
    assert engines.find_engine("LAMMPS") == [str(on_path)]


def test_modules_are_asked_of_the_interpreter_that_the_variable_names(nowhere):
    assert engines.find_engine("peclet-dem") is None
    python = program(
        nowhere / "engines",
        "python",
        f'#!/bin/sh\nPYTHONPATH={nowhere / "site"} exec {sys.executable} -S "$@"\n',
    )
    engines.has_module.cache_clear()
    (nowhere / "site" / "peclet" / "dem").mkdir(parents=True)
    for folder in ("peclet", "peclet/dem"):
        (nowhere / "site" / folder / "__init__.py").touch()
    try:
        assert engines.find_engine("peclet-dem") == [str(python)]
        assert engines.find_engine("Kratos") is None
    finally:
        engines.has_module.cache_clear()


def test_an_engine_that_was_not_set_up_is_skipped_by_name(nowhere, monkeypatch):
    monkeypatch.setenv(EXPECTED, "LAMMPS,peclet-dem")
    with pytest.raises(pytest.skip.Exception, match="LIGGGHTS is not installed"):
        engine_or_skip("LIGGGHTS")


@pytest.mark.parametrize("name", ["LAMMPS", "peclet-dem"])
def test_an_engine_that_was_set_up_is_never_skipped(name, nowhere, monkeypatch):
    monkeypatch.setenv(EXPECTED, "LAMMPS,peclet-dem")
    with pytest.raises(pytest.fail.Exception, match=f"{name} was set up"):
        engine_or_skip(name)


def test_an_unknown_engine_is_named(nowhere):
    with pytest.raises(ExportError, match="'Rocky' is not an engine"):
        engines.find_engine("Rocky")
    assert engines.engine_names() == ("LIGGGHTS", "LAMMPS", "Yade", "Kratos", "peclet-dem", "Chrono")
