"""Published cases of files and shapes that people have, each a script that prints RIGHT or WRONG."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
CASES = REPOSITORY.parent / "shared" / "cases"


def _scripts() -> list[object]:
    scripts = sorted(CASES.glob("case_*.py")) if CASES.is_dir() else []
    if not scripts:
        return [pytest.param(None, marks=pytest.mark.skip(reason=f"{CASES} is not there"), id="absent")]
    return [pytest.param(script, id=script.stem) for script in scripts]


@pytest.mark.parametrize("script", _scripts())
def test_a_published_case_is_right(script: Path) -> None:
    ran = subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert ran.stdout.startswith("RIGHT"), ran.stdout + ran.stderr
    assert ran.returncode == 0
