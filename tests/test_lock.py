"""The lock with hashes agrees with the pins, and the page of licences with what is installed."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

from packaging.utils import canonicalize_name


def tool(repository: Path, name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, repository / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pins(text: str) -> dict[str, str]:
    lines = [line.split()[0] for line in text.splitlines() if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in (line.split("==") for line in lines)}


def test_every_pin_has_a_hash_in_the_lock(repository: Path) -> None:
    (lock,) = repository.glob("requirements-*.lock")
    text = lock.read_text(encoding="utf-8")
    assert pins(text) == pins((repository / "constraints.txt").read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+ --hash=sha256:[0-9a-f]{64}", line) for line in lines)
    assert "://" not in text  # where they come from is for pip's settings to say


def test_the_lock_is_what_its_command_makes(repository: Path) -> None:
    report = {
        "environment": {"sys_platform": "linux", "platform_machine": "x86_64", "python_version": "3.11"},
        "install": [
            {
                "metadata": {"name": "torch", "version": "2.13.0+cpu"},
                "download_info": {"archive_info": {"hashes": {"sha256": "ab" * 32}}},
            }
        ],
    }
    name, text = tool(repository, "write_lock").lock_of(report)
    assert (repository / name).is_file()
    assert text.splitlines()[-1] == f"torch==2.13.0 --hash=sha256:{'ab' * 32}"
    head = [line for line in (repository / name).read_text(encoding="utf-8").splitlines() if line[0] == "#"]
    assert text.splitlines()[:-1] == head


def test_the_page_of_licences_states_what_is_installed(repository: Path) -> None:
    licences = tool(repository, "write_licences")
    packages = licences.installed()
    page = (repository / "docs" / "licences.md").read_text(encoding="utf-8")
    rows = [row for row in licences.table_of(packages).splitlines()[2:] if row not in page]
    assert rows == [], "run python .ci/write_licences.py"
    assert len(packages) > 60
    prose = page.partition("**Under the LGPL**")[2].partition("\n\n")[0].replace("\n", " ")
    for package in packages:
        if "LGPL" in licences.licence_of(package):
            name = package.metadata["Name"].removesuffix("_Essentials")
            assert name in prose, name
