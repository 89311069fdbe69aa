"""Runs the tests marked ``gl`` in a pytest of their own under Xvfb."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

NO_TESTS_COLLECTED = 5


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
            "tests",
        ],
        cwd=repository,
        env={**environment, "MBSTUDIO_GL_TESTS": "1"},
        capture_output=True,
        text=True,
    )
    if run.returncode == NO_TESTS_COLLECTED:
        pytest.skip("no test is marked gl")
    assert run.returncode == 0, run.stdout + run.stderr
