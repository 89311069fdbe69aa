"""The rules of the house: who may import whom, and how files look."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "mbstudio"
SOURCES = sorted(PACKAGE.rglob("*.py"))
QT = {
    "PySide6",
    "PyQt6",
    "PyQt5",
    "PySide2",
    "shiboken6",
    "qtpy",
    "superqt",
    "pyvistaqt",
    "pyqtgraph",
    "qtawesome",
}
RENDERING = {"pyvista", "pyvistaqt"}
VAGUE = {"utils", "util", "helpers", "helper", "misc", "common"}
LONGEST_FILE = 700


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in SOURCES}


def is_type_checking(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def imported(path: Path, *, top_level_only: bool) -> set[str]:
    """Return the dotted names that a file imports; blocks for type checkers do not count."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = module_name(path).split(".")
                package = package if path.name == "__init__.py" else package[:-1]
                package = package[: len(package) - node.level + 1]
                base = ".".join([*package, base] if base else package)
            for alias in node.names:
                deeper = f"{base}.{alias.name}"
                found.add(deeper if deeper in MODULES else base)
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.If) and is_type_checking(child):
                continue
            if top_level_only and isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                continue
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


def layer(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


@pytest.mark.parametrize("module", MODULES)
def test_nothing_imports_upwards(module):
    names = imported(MODULES[module], top_level_only=False)
    roots = {name.split(".")[0] for name in names}
    layers = {layer(name) for name in names if name.split(".")[0] == "mbstudio"}
    if layer(module) == "core":
        assert not roots & QT, "core imports Qt"
        assert not roots & RENDERING, "core draws"
        assert not layers & {"scene", "ui", "cli"}, "core imports upwards"
    if layer(module) == "scene":
        assert not roots & QT, "scene imports Qt"
        assert not layers & {"ui", "cli"}, "scene imports upwards"
    if layer(module) == "ui":
        assert "cli" not in layers, "ui imports the command line"


def test_no_import_cycle():
    graph = {
        module: {name for name in imported(path, top_level_only=True) if name in MODULES and name != module}
        for module, path in MODULES.items()
    }
    # A package's __init__ that gathers names from its own modules is no cycle, as long as
    # those modules do not import the package back.
    done: set[str] = set()

    def walk(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, "import cycle: " + " > ".join([*trail[trail.index(module) :], module])
        if module in done:
            return
        for name in sorted(graph[module]):
            walk(name, (*trail, module))
        done.add(module)

    for module in graph:
        walk(module, ())


@pytest.mark.parametrize("module", MODULES)
def test_a_module_is_a_noun(module):
    assert not VAGUE & set(module.split("."))


@pytest.mark.parametrize("module", MODULES)
def test_files_stay_short(module):
    assert len(MODULES[module].read_text(encoding="utf-8").splitlines()) <= LONGEST_FILE


@pytest.mark.parametrize("module", MODULES)
def test_files_are_read_without_running_what_they_hold(module):
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    roots = {name.split(".")[0] for name in imported(MODULES[module], top_level_only=False)}
    assert not roots & {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve"}
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = ast.unparse(call.func)
        keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
        if name == "torch.load":
            assert keywords.get("weights_only") == "True", f"line {call.lineno}"
        if name in {"np.load", "numpy.load"}:
            assert keywords.get("allow_pickle", "False") == "False", f"line {call.lineno}"
        assert name not in {"eval", "exec", "yaml.load"}, f"line {call.lineno}"


def test_core_works_without_qt():
    core = [module for module in MODULES if module.startswith("mbstudio.core")]
    script = f"""
import sys
import tomllib
from importlib.metadata import packages_distributions
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {QT | RENDERING!r}:
            raise ImportError(name + " is blocked")
sys.meta_path.insert(0, Blocked())
import importlib
for name in {core!r}:
    importlib.import_module(name)
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_importing_mbstudio_is_cheap():
    script = "import sys, mbstudio; print(*sorted(sys.modules))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not set(run.stdout.split()) & (QT | {"numpy", "torch", "vtk", "pyvista", "scipy", "numba"})


def test_every_library_is_declared():
    """A library that only happens to be installed breaks a bare machine."""
    declared = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {re.split(r"[^\w.-]", line)[0].lower().replace("_", "-") for line in declared["dependencies"]}
    providers = packages_distributions()
    wanted = {
        name.split(".")[0] for path in SOURCES for name in imported(path, top_level_only=False) if name
    } - {"mbstudio", *sys.stdlib_module_names}
    undeclared = {
        module
        for module in wanted
        if not {name.lower().replace("_", "-") for name in providers.get(module, [module])} & names
    }
    assert undeclared == set()
