"""The rules of the house: who may import whom, and how files look.

Each test collects every breach and names its file and line. Imports count wherever they stand: in
functions and in blocks for type checkers as well.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import NamedTuple

import networkx
import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
PACKAGE = REPOSITORY / "mbstudio"
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
RENDERING = {"pyvista", "pyvistaqt", "vtk", "vtkmodules"}
UNSAFE = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve"}
VAGUE = {"utils", "util", "helpers", "helper", "misc", "common"}
LONGEST_FILE = 700
LONGEST_FUNCTION = 80
LARGEST_FOLDER = 25

# Who must not import whom (a folder stands for all in it; "mbstudio" alone for the package's own __init__).
FORBIDDEN = {
    "mbstudio.core": {"mbstudio", "mbstudio.cli", "mbstudio.scene", "mbstudio.ui", *QT, *RENDERING},
    "mbstudio.scene": {"mbstudio.cli", "mbstudio.ui", *QT},
    "mbstudio.ui": {"mbstudio.cli"},
    "mbstudio.ui.viewport": {
        "mbstudio.ui.shell",
        "mbstudio.ui.stations",
        "mbstudio.ui.studio",
        "mbstudio.ui.view",
    },
    "mbstudio.ui.widgets": {"mbstudio.ui.shell", "mbstudio.ui.stations", "mbstudio.ui.view"},
    "mbstudio.ui.view": {"mbstudio.ui.shell", "mbstudio.ui.stations"},
    "mbstudio.ui.stations": {"mbstudio.ui.shell"},
    "mbstudio.core.metaball": {"mbstudio.core.imaging"},
    "mbstudio.core.populations": {"mbstudio.core.project"},
}


class Import(NamedTuple):
    """One name that a file imports."""

    importer: str
    name: str  # a module of mbstudio, or what another library calls it
    place: str

    def __str__(self) -> str:
        return f"{self.place} imports {self.name}"


def module_name(path: Path, root: Path = PACKAGE) -> str:
    parts = path.relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def place(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix() if path.is_relative_to(REPOSITORY) else path.name


def sources_below(root: Path) -> dict[str, Path]:
    return {module_name(path, root): path for path in sorted(root.rglob("*.py"))}


def imports_of(module: str, path: Path, known: Iterable[str]) -> Iterator[Import]:
    """Yield what a file imports, wherever it stands in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
                package = package[: len(package) - node.level + 1]
                base = ".".join([*package, base] if base else package)
            deeper = [f"{base}.{alias.name}" for alias in node.names]
            names = [name if name in known else base for name in deeper]
        else:
            continue
        for name in names:
            yield Import(module, name, f"{place(path)}:{node.lineno}")


def is_within(module: str, package: str) -> bool:
    return module == package or (package != "mbstudio" and module.startswith(f"{package}."))


def circles(arrows: Iterable[tuple[str, str, Import]]) -> list[str]:
    """Return one circle of each knot of a graph, with the import behind every step."""
    graph = networkx.DiGraph()
    for start, end, found in arrows:
        if start != end and not graph.has_edge(start, end):
            graph.add_edge(start, end, found=found)
    told = []
    for knot in networkx.strongly_connected_components(graph):
        if len(knot) > 1:
            steps = networkx.find_cycle(graph.subgraph(sorted(knot)))
            lines = [f"    {graph.edges[step]['found']}" for step in steps]
            told.append("\n".join([f"{len(knot)} in a knot, for example", *lines]))
    return told


def circles_among_files(imports: Iterable[Import], known: Iterable[str]) -> list[str]:
    return circles((found.importer, found.name, found) for found in imports if found.name in known)


def circles_among_packages(imports: Iterable[Import], known: Iterable[str]) -> list[str]:
    """Return circles among what lies side by side in a package: its files, and its folders as wholes."""
    arrows = []
    for found in imports:
        if found.name not in known:
            continue
        start, end = found.importer.split("."), found.name.split(".")
        shared = next((i for i, (a, b) in enumerate(zip(start, end, strict=False)) if a != b), None)
        if shared is not None:  # else one is the other's package: a circle there is one among files
            arrows.append((".".join(start[: shared + 1]), ".".join(end[: shared + 1]), found))
    return circles(arrows)


SOURCES = sources_below(PACKAGE)
IMPORTS = [found for module, path in SOURCES.items() for found in imports_of(module, path, SOURCES)]
TREES = {
    path: ast.parse(path.read_text(encoding="utf-8"))
    for path in [*SOURCES.values(), *sources_below(REPOSITORY / "tests").values()]
}


def refuse(breaches: Iterable[object]) -> None:
    """Fail with all breaches, one a line."""
    lines = [str(breach) for breach in breaches]
    if lines:
        pytest.fail("\n".join(lines), pytrace=False)


# ------------------------------------------------------------------ who imports whom


@pytest.mark.parametrize("importer", FORBIDDEN)
def test_nothing_imports_what_is_forbidden_to_it(importer):
    def is_forbidden(name: str) -> bool:
        root = name.split(".")[0]
        return (
            root in FORBIDDEN[importer]
            if root != "mbstudio"
            else any(is_within(name, package) for package in FORBIDDEN[importer])
        )

    assert importer in SOURCES, "the package has moved"
    refuse(found for found in IMPORTS if is_within(found.importer, importer) and is_forbidden(found.name))


def test_no_circle_among_files():
    refuse(circles_among_files(IMPORTS, SOURCES))


def test_no_circle_among_packages():
    refuse(circles_among_packages(IMPORTS, SOURCES))


@pytest.fixture
def tree(tmp_path) -> Callable[..., tuple[list[Import], dict[str, Path]]]:
    """Writes files of a made-up package and returns what they import."""

    def write(**files: str) -> tuple[list[Import], dict[str, Path]]:
        for name, text in files.items():
            path = tmp_path / "mbstudio" / f"{name.replace('__', '/')}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        sources = sources_below(tmp_path / "mbstudio")
        return [
            found for module, path in sources.items() for found in imports_of(module, path, sources)
        ], sources

    return write


@pytest.mark.parametrize(
    "hidden",
    [
        "from mbstudio import a",
        "import mbstudio.a",
        "from . import a",
        "from mbstudio.a import name",
        "def f():\n    from mbstudio.a import name",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from mbstudio.a import name",
        "try:\n    import mbstudio.a\nexcept ImportError:\n    pass",
    ],
)
def test_a_circle_cannot_hide(tree, hidden):
    imports, sources = tree(a="import mbstudio.b", b=hidden)
    assert len(circles_among_files(imports, sources)) == 1
    imports, sources = tree(a="import mbstudio.b", b="import json")
    assert circles_among_files(imports, sources) == []


def test_folders_in_a_circle_are_found_where_no_files_are(tree):
    imports, sources = tree(
        scan__a="import mbstudio.grains.a", grains__b="import mbstudio.scan.b", scan__b="", grains__a=""
    )
    assert circles_among_files(imports, sources) == []
    assert len(circles_among_packages(imports, sources)) == 1


def test_core_works_without_qt():
    core = [module for module in SOURCES if module.startswith("mbstudio.core")]
    script = f"""
import sys
import tomllib
from importlib.metadata import packages_distributions
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {QT | {"pyvista", "pyvistaqt"}!r}:
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
    declared = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {re.split(r"[^\w.-]", line)[0].lower().replace("_", "-") for line in declared["dependencies"]}
    providers = packages_distributions()
    wanted = {found.name.split(".")[0] for found in IMPORTS} - {"mbstudio", *sys.stdlib_module_names}
    undeclared = {
        module
        for module in wanted
        if not {name.lower().replace("_", "-") for name in providers.get(module, [module])} & names
    }
    assert undeclared == set()


# ------------------------------------------------------------------ how files look


def test_a_module_is_a_noun():
    refuse(module for module in SOURCES if VAGUE & set(module.split(".")))


def test_files_stay_short():
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in TREES}
    long = [f"{place(path)}: {lines} lines" for path, lines in lengths.items() if lines > LONGEST_FILE]
    refuse(long)


def test_functions_stay_short():
    long = []
    for path, module in TREES.items():
        for node in ast.walk(module):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = node.end_lineno - node.lineno + 1
                if lines > LONGEST_FUNCTION:
                    long.append(f"{place(path)}:{node.lineno} {node.name}: {lines} lines")
    refuse(long)


def test_folders_stay_small():
    folders = [path.parent for path in TREES]
    large = {
        f"{place(folder)}: {folders.count(folder)} Python files"
        for folder in folders
        if folders.count(folder) > LARGEST_FOLDER
    }
    refuse(sorted(large))


def test_every_package_says_what_lives_there():
    """And where to begin, except in the folder of a station: one begins at its station.py."""
    silent = []
    for folder in sorted({path.parent for path in SOURCES.values()} - {PACKAGE}):
        tree = TREES.get(folder / "__init__.py")
        text = (ast.get_docstring(tree) if tree is not None else "") or ""
        is_station = folder.parent.name == "stations" and (folder / "station.py").exists()
        if not text or not (is_station or "egin" in text):
            silent.append(place(folder))
    refuse(silent)


def test_the_package_is_marked_as_typed():
    assert (PACKAGE / "py.typed").read_text() == ""


def test_files_are_read_without_running_what_they_hold():
    breaches = [str(found) for found in IMPORTS if found.name.split(".")[0] in UNSAFE]
    for path in SOURCES.values():
        for call in (node for node in ast.walk(TREES[path]) if isinstance(node, ast.Call)):
            name = ast.unparse(call.func)
            keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
            if (
                (name == "torch.load" and keywords.get("weights_only") != "True")
                or (name in {"np.load", "numpy.load"} and keywords.get("allow_pickle", "False") != "False")
                or name in {"eval", "exec", "yaml.load"}
            ):
                breaches.append(f"{place(path)}:{call.lineno} calls {name}")
    refuse(breaches)
