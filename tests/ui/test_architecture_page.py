"""docs/architecture.md: its tree and its names are there, and its three ways are those of the code.

Each way is gone while a profiler notes which functions of mbstudio are called. The steps that the page names
must be among them, called for the first time in the order of the page.
"""

from __future__ import annotations

import ast
import re
import sys
import threading
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt

import mbstudio as mb
from mbstudio.core.project.file import SCHEMA
from mbstudio.core.scan.field_of_view import FieldOfView

ROOT = Path(mb.__file__).parent
REPOSITORY = ROOT.parent
PAGE = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
_NAMED = re.compile(r"`([\w/]+\.py): ([\w.]+)`")
_FILES = re.compile(r"`((?:core|scene|ui|cli|tests|docs)/[\w/]*(?:\.py)?|run\.py)`")


def section(heading: str) -> str:
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def file_of(path: str) -> Path:
    return (REPOSITORY if path.startswith("tests/") else ROOT) / path


@cache
def definitions(path: str) -> dict[str, ast.AST]:
    """Return functions and classes of a file, and the methods of the classes, by their names."""
    found: dict[str, ast.AST] = {}
    for node in ast.parse(file_of(path).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node
        if isinstance(node, ast.ClassDef):
            for part in node.body:
                if isinstance(part, ast.FunctionDef):
                    found[f"{node.name}.{part.name}"] = part
    return found


def steps(heading: str) -> list[str]:
    """Return the functions that the numbered steps of a way name, in their order."""
    numbered = "\n".join(re.findall(r"^(?:\d+\.|   ) ?.*$", section(heading), re.MULTILINE))
    return [
        f"{path}: {name}"
        for path, name in _NAMED.findall(numbered)
        if isinstance(definitions(path)[name], ast.FunctionDef)
    ]


@pytest.fixture
def called():
    """The functions of mbstudio in the order in which they are first called, in whichever thread."""
    seen: dict[str, None] = {}
    start = len(str(ROOT)) + 1

    def note(frame, event, _argument):
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(str(ROOT)):
            # A function within a function stands for both.
            for name in (code.co_qualname, code.co_qualname.partition(".<locals>")[0]):
                seen.setdefault(f"{Path(code.co_filename[start:]).as_posix()}: {name}")

    before = sys.getprofile()
    threading.setprofile(note)
    sys.setprofile(note)
    yield seen
    sys.setprofile(before)
    threading.setprofile(None)


def follow(heading: str, called: dict[str, None]) -> None:
    """Fail unless the steps of a way were called in their order."""
    order, named = list(called), steps(heading)
    assert len(named) > 10
    missing = [step for step in named if step not in called]
    assert not missing, f"{heading}: not called: {missing}"
    assert named == sorted(named, key=order.index), f"{heading}: called in another order"


# ------------------------------------------------------------------ names


def test_the_tree_is_that_of_the_repository():
    (tree,) = re.findall(r"```\n(.*?)```", section("The tree"), re.DOTALL)
    folders, above = set(), ""
    for line in tree.splitlines():
        name = line.split()[0]
        above = name if line[0] != " " else above
        folders.add(name if line[0] != " " else f"{above}{name}")
        for deeper in re.findall(r"\b(\w+/)", line.partition(name)[2]):
            inside = ROOT / above / (name if line[0] == " " else "")
            assert (inside / deeper).is_dir(), line
    there = {f"{path.parent.relative_to(ROOT).as_posix()}/" for path in ROOT.rglob("__init__.py")}
    assert folders == {folder for folder in there if folder != "./" and folder.count("/") <= 2}


def test_what_the_page_names_is_there():
    for path, name in _NAMED.findall(PAGE):
        assert file_of(path).is_file(), path
        assert name in definitions(path), f"{path}: {name}"
    for path in _FILES.findall(PAGE):
        assert any((folder / path).exists() for folder in (ROOT, REPOSITORY)), path


def test_each_rule_names_the_tests_that_hold_it():
    rows = re.findall(r"^\| (?!Rule|-)(.*) \|$", section("Rules of the house"), re.MULTILINE)
    assert len(rows) > 15
    for row in rows:
        tests = _NAMED.findall(row)
        assert tests, row
        assert all(path.startswith("tests/") and name.startswith("test_") for path, name in tests), row


def test_the_limits_are_those_that_are_checked():
    from tests.test_architecture import LARGEST_FOLDER, LONGEST_FILE, LONGEST_FUNCTION

    limits = (
        f"{LONGEST_FILE} lines a file, {LONGEST_FUNCTION} a function, {LARGEST_FOLDER} Python files a folder"
    )
    assert limits in section("Rules of the house")


# ------------------------------------------------------------------ ways


def test_the_way_of_a_grain(called, scan_path, tmp_path):
    scan = mb.open_scan(scan_path, "14 um")
    grains = mb.segment(scan)
    label = grains.interior_labels[0]
    found = mb.fit(grains.grain(label), 8, seed=0)
    mb.measure(found.avatar)
    project = mb.Project.new()
    project.use_scan(scan)
    project.change("Find grains", grains=grains)
    project.add_fits({label: found}, "Fit grain")
    project.save(tmp_path / "sand.mbs")
    follow("The way of a grain", called)


def test_the_way_of_a_slider_move(called, shaping, rest):
    slider = shaping.stations.latent.panel.meanings["elongation"].slider
    rest()
    called.clear()
    slider.setSliderDown(True)
    slider.setValue(slider.value() + (slider.maximum() - slider.minimum()) // 10)
    rest()
    slider.setSliderDown(False)
    rest()
    follow("The way of a slider move", called)


def test_the_way_of_a_click(called, segmented, idle, qtbot):
    view, canvas = segmented.view, segmented.viewport.canvas
    places = [QPoint(x, y) for x in range(9, canvas.width(), 20) for y in range(9, canvas.height(), 20)]
    on_grain = (p for p in places if view.scene.label_at(*segmented.viewport.pixel(QPointF(p))) is not None)
    place = next(on_grain)
    idle()
    called.clear()
    qtbot.mouseClick(canvas, Qt.MouseButton.LeftButton, pos=place)
    idle()
    assert segmented.workspace.selected is not None
    follow("The way of a click", called)


# ------------------------------------------------------------------ the project file


def test_the_groups_of_the_project_file(tmp_path, two_grains):
    import h5py

    view = FieldOfView(0, np.ones(two_grains.labels.shape[1:], np.bool_), two_grains.labels.shape)
    corrected = replace(two_grains.excluded([2]), view=view)
    project = mb.Project.new()
    project.change("Load labels", grains=corrected)
    project.add_fits({1: mb.fit(two_grains.grain(1), 6, seed=0)}, "Fit grain")
    project.save(tmp_path / "sand.mbs")
    text = section("The project file")
    with h5py.File(tmp_path / "sand.mbs") as file:
        assert "format" in file.attrs
        written = {f"/{name}" for name in file}
        for name in re.findall(r"`/(fits/\w+|grains/\w+)`", text):
            assert name in file
        assert "centers_offsets" in file["fits"]
    named = {f"/{name.split('/')[0]}" for name in re.findall(r"`/([\w/]+)`", text)}
    assert written <= named
    assert named - written <= {
        "/scan", "/segmentation", "/style", "/clones", "/surfaces", "/surface_clones", "/kept", "/strokes",
        "/classifier", "/packing", "/twin",
    }  # fmt: skip
    assert f"The format is number {SCHEMA}." in " ".join(text.split())
