"""Benchmarks: each can be imported, and what it uses of mbstudio and of other benchmarks exists.

They run for minutes to hours, so that no test runs them: without this one a rename would break them unseen.
"""

from __future__ import annotations

import ast
import importlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).resolve().parent.parent / "benchmarks"
FILES = sorted(FOLDER.glob("*.py"))
OURS = ("mbstudio", *(path.stem for path in FILES))


@pytest.fixture(autouse=True)
def _benchmarks_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(FOLDER)
    # A benchmark sets threads and the kind of view for itself when it is imported.
    environment = dict(os.environ)
    yield
    for name in os.environ.keys() - environment.keys():
        del os.environ[name]
    os.environ.update(environment)
    for path in FILES:
        sys.modules.pop(path.stem, None)


def _is_ours(name: str) -> bool:
    return name.partition(".")[0] in OURS


def _find(module: str, name: str) -> object:
    """Return what a module holds under a name, which may be a module below it."""
    try:
        return getattr(importlib.import_module(module), name)
    except AttributeError:
        return importlib.import_module(f"{module}.{name}")


def _missing(source: str) -> Iterator[str]:
    """Yield what a benchmark imports from mbstudio or another benchmark although it is not there."""
    tree = ast.parse(source)
    modules: dict[str, ModuleType] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and _is_ours(node.module):
            for alias in node.names:
                try:
                    found = _find(node.module, alias.name)
                except ImportError:
                    yield f"line {node.lineno}: {node.module}.{alias.name}"
                    continue
                if isinstance(found, ModuleType):
                    modules[alias.asname or alias.name] = found
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if not _is_ours(alias.name):
                    continue
                whole = importlib.import_module(alias.name)
                top = importlib.import_module(alias.name.partition(".")[0])
                modules[alias.asname or top.__name__] = whole if alias.asname else top
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = modules.get(node.value.id)
            if module is not None and not hasattr(module, node.attr):
                yield f"line {node.lineno}: {module.__name__}.{node.attr}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_what_a_benchmark_uses_exists(path: Path) -> None:
    importlib.import_module(path.stem)
    assert not list(_missing(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("line", "missing"),
    [
        ("from mbstudio.core.imaging.fast import nowhere", "mbstudio.core.imaging.fast.nowhere"),
        (
            "from mbstudio.core.imaging.fast import fast\nfast._NOWHERE = 3",
            "mbstudio.core.imaging.fast.fast._NOWHERE",
        ),
        ("import mbstudio as mb\nmb.nowhere()", "mbstudio.nowhere"),
        ("from mbstudio.core.imaging import fit\nimport numpy as np\nnp.nowhere, fit.nowhere", ""),
    ],
)
def test_what_is_missing_is_found(line: str, missing: str) -> None:
    assert [found.partition(": ")[2] for found in _missing(line)] == ([missing] if missing else [])
