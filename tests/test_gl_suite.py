"""Runs the tests marked ``gl`` in a pytest of their own under Xvfb."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

NO_TESTS_COLLECTED = 5


def _files_with_such_tests(repository: Path) -> list[str]:
    """Return the files that name the mark: to collect all the others takes longer than these take to run."""
    files = sorted((repository / "tests").rglob("test_*.py"))
    found = [path for path in files if "pytest.mark.gl" in path.read_text(encoding="utf-8")]
    return [str(path) for path in found if path != Path(__file__).resolve()]


@pytest.mark.skipif(bool(os.environ.get("MBSTUDIO_GL_TESTS")), reason="this is the run under Xvfb")
@pytest.mark.timeout(600)
def test_the_real_viewport_under_xvfb(repository):
    if shutil.which("xvfb-run") is None:
        pytest.skip("xvfb-run is not installed (Debian package xvfb, and xauth)")
    # Someone may draw in software by a setting of their own.
    environment = {name: value for name, value in os.environ.items() if name != "MBSTUDIO_VIEWPORT"}
    run = subprocess.run(
        [
            "xvfb-run",
            "-a",
            "-s",
            "-screen 0 1280x1024x24",
            sys.executable,
            "-m",
            "pytest",
            "-m",
            "gl",
            "-q",
            *_files_with_such_tests(repository),
        ],
        cwd=repository,
        env={**environment, "MBSTUDIO_GL_TESTS": "1"},
        capture_output=True,
        text=True,
    )
    if run.returncode == NO_TESTS_COLLECTED:
        pytest.skip("no test is marked gl")
    assert run.returncode == 0, run.stdout + run.stderr
