"""The examples of CONTRIBUTING.md work, with the files and lines that their text names and no more.

All of them are added to a copy of mbstudio. The copy is checked like mbstudio itself, and what was added is
used there by tests/core/worked_examples.py and tests/ui/worked_examples.py, which only this file runs.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

PAGE = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
EXAMPLES = dict(
    section.split("\n", 1) for section in PAGE.partition("\n## Adding things\n")[2].split("\n### ")[1:]
)
WRITTEN = {  # new files, and files that get a line or an entry
    "A reader": (1, 1),
    "A DEM target": (1, 1),
    "A shape factor": (0, 1),
    "A style preset": (1, 1),
    "A station of the window": (2, 1),
    "An undoable command": (0, 1),
}
CODE = re.compile(r"```python\n(.*?)```", re.DOTALL)
ENTRY = re.compile(r"`(\w+)` of\s+`(mbstudio/[\w/]+\.py)`")
FILE = re.compile(r"`(mbstudio/[\w/]+\.py)`:\s*\Z")
LINE = re.compile(
    r"line in `(?P<name>\w+)` of `(?P<path>mbstudio/[\w/]+\.py)` is `(?P<line>[^`]+)`"
    r"(?:, with the import\s+`(?P<above>[^`]+)` above it)?"
)
PACKAGE = re.compile(r"folder's `__init__\.py` says\s+`(\"\"\".*?\"\"\")`")


class Addition(NamedTuple):
    """A file that is new, or text that goes into one that is there."""

    path: str
    text: str
    name: str = ""  # of the list, tuple, table or function that takes an entry; empty for a new file
    above: str = ""  # an import that the entry needs


def additions(section: str) -> list[Addition]:
    """Return what an example says to write, and where."""
    (code,) = CODE.finditer(section)
    before, after = section[: code.start()], section[code.end() :]
    entry, new = ENTRY.search(before), FILE.search(before)
    found = [Addition(entry[2], code[1].rstrip() + ",\n", entry[1]) if entry else Addition(new[1], code[1])]
    found += [
        Addition(m["path"], m["line"] + "\n", m["name"], m["above"] or "") for m in LINE.finditer(after)
    ]
    package = PACKAGE.search(after)
    if package:
        found.append(Addition(Path(new[1]).with_name("__init__.py").as_posix(), package[1] + "\n"))
    return found


def end_of(source: str, name: str) -> int:
    """Return the line, from 0, of the bracket that closes what `name` is, or what the function returns."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            value = [part.value for part in node.body if isinstance(part, ast.Return)][-1]
        elif isinstance(node, ast.Assign | ast.AnnAssign) and re.match(rf"{name}\b", ast.unparse(node)):
            value = node.value
        else:
            continue
        return value.end_lineno - 1
    raise AssertionError(f"there is no {name}")


def add(root: Path, addition: Addition) -> None:
    path = root / addition.path
    if not addition.name:
        assert not path.exists(), f"{addition.path} is there already"
        path.parent.mkdir(exist_ok=True)
        path.write_text(addition.text, encoding="utf-8")
        return
    source = path.read_text(encoding="utf-8")
    lines = source.splitlines(keepends=True)
    row = end_of(source, addition.name)
    assert lines[row].strip()[0] in ")]}", f"{addition.name} is not closed in a line of its own"
    margin = lines[row][: len(lines[row]) - len(lines[row].lstrip())] + "    "
    entry = [f"{margin}{line}" if line.strip() else line for line in addition.text.splitlines(keepends=True)]
    lines[row:row] = entry
    if addition.above:
        imports = [node for node in ast.parse(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
        lines.insert(imports[-1].end_lineno, addition.above + "\n")
    path.write_text("".join(lines), encoding="utf-8")


@pytest.fixture(scope="module")
def copy(repository, tmp_path_factory):
    """A copy of mbstudio to which all examples were added."""
    root = tmp_path_factory.mktemp("mbstudio")
    for folder in ("mbstudio", "tests"):
        shutil.copytree(repository / folder, root / folder)  # with what Python and numba have compiled
    for name in ("assets", "docs"):
        (root / name).symlink_to(repository / name)
    shutil.copy(repository / "pyproject.toml", root)
    for section in EXAMPLES.values():
        for addition in additions(section):
            add(root, addition)
    return root


def run(copy: Path, *words: str) -> str:
    """Run a module of Python in the copy and return what it says."""
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    done = subprocess.run(
        [sys.executable, "-m", *words], cwd=copy, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_each_example_needs_as_little_as_it_promises():
    assert set(EXAMPLES) == set(WRITTEN)
    for heading, section in EXAMPLES.items():
        found = additions(section)
        new = {addition.path for addition in found if not addition.name}
        changed = {addition.path for addition in found if addition.name}
        assert (len(new), len(changed)) == WRITTEN[heading], heading
        lines = [addition.text for addition in found if addition.name and new]
        assert all(text.count("\n") == 1 for text in lines), heading


def test_the_examples_keep_the_rules_of_the_house(copy):
    run(copy, "pytest", "-q", "-k", "not without_qt and not cheap", "tests/test_architecture.py")


def test_the_examples_pass_the_linter(copy):
    new = [addition.path for section in EXAMPLES.values() for addition in additions(section)]
    changed = [path for path in new if path.endswith(("registry.py", "readers/__init__.py"))]
    run(copy, "ruff", "check", "-q", "--fix", "--select", "I", *changed)  # puts the imports in their order
    run(copy, "ruff", "check", "-q", *new)
    run(copy, "ruff", "format", "-q", "--check", *new)


@pytest.mark.parametrize(
    ("file", "tests"),
    [
        ("tests/core/worked_examples.py", ["a_reader", "a_target", "a_factor", "a_preset"]),
        ("tests/ui/worked_examples.py", ["a_station", "an_undoable_command", "what_was_added_is_offered"]),
    ],
)
def test_the_examples_work(copy, file, tests):
    told = run(copy, "pytest", "-rA", "-q", file)
    assert re.findall(r"^PASSED \S+::test_(\w+)", told, re.MULTILINE) == tests
