"""Stored machine code follows every change of what was compiled into it."""

import importlib
import os
import sys
import time

import pytest

from mbstudio.core import compiled as compiling

INNER = """
from mbstudio.core.compiled import compiled
from kernels.constants import LENGTH, POINT

@compiled()
def inner(x):
    return {factor} * x + LENGTH + POINT[1]
"""
OUTER = """
from mbstudio.core.compiled import compiled
from kernels.inner import inner

@compiled(error_model="numpy")
def outer(x):
    return inner(x) + 1.0
"""


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """Return a function that writes the package anew and gives its outer function, as a new process would."""
    folder = tmp_path / "kernels"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(compiling, "_PACKAGE", "kernels")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def load(factor=2.0, length=10.0, point=(0.0, 0.5)):
        (folder / "constants.py").write_text(f"LENGTH = {length}\nPOINT = {point}\n")
        (folder / "inner.py").write_text(INNER.format(factor=factor))
        (folder / "outer.py").write_text(OUTER)
        forget()
        return importlib.import_module("kernels.outer").outer

    def forget():
        for name in [name for name in sys.modules if name.partition(".")[0] == "kernels"]:
            del sys.modules[name]
        importlib.invalidate_caches()
        compiling._digest.cache_clear()
        compiling._remove_outdated.cache_clear()

    yield load
    forget()


def test_what_did_not_change_is_not_compiled_again(kernels):
    assert kernels()(3.0) == 17.5
    again = kernels()
    assert again(3.0) == 17.5
    assert sum(again.stats.cache_hits.values()) == 1


@pytest.mark.parametrize(
    ("change", "result"),
    [({"factor": 4.0}, 23.5), ({"length": 20.0}, 27.5), ({"point": (0.0, 1.5)}, 18.5)],
    ids=["a called function", "a constant of another file", "an item of a tuple"],
)
def test_a_change_in_another_file_is_compiled_in(kernels, change, result):
    assert kernels()(3.0) == 17.5
    changed = kernels(**change)
    assert changed(3.0) == result
    assert not changed.stats.cache_hits
    assert kernels()(3.0) == 17.5  # what was stored before still holds


def test_what_is_outdated_goes_after_a_month(kernels, tmp_path):
    kernels()(3.0)
    stored = set(tmp_path.rglob("*.nb[ic]"))
    kernels(factor=4.0)(3.0)
    assert stored <= set(tmp_path.rglob("*.nb[ic]"))
    month = time.time() - 40 * 86400
    for path in stored:
        os.utime(path, (month, month))
    kernels(factor=4.0)(3.0)
    assert stored
    assert not stored & set(tmp_path.rglob("*.nb[ic]"))
