"""Strokes and a classifier in a project: kept in its file, undone, merged, forgotten with the scan."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

from mbstudio.core.errors import ProjectError
from mbstudio.core.grains.classifying import Stroke, VoxelClassifier
from mbstudio.core.project import Project
from mbstudio.core.project.file import read_project
from mbstudio.core.project.merging import merge_states
from tests.core.grains.editing.placed_grains import placed_grains, scan_of

STROKES = (
    Stroke("grain", tuple(map(tuple, np.argwhere(placed_grains().labels == 1)[::40].tolist())), 0.5, None),
    Stroke("void", ((1.0, 1.0, 1.0), (1.0, 1.0, 60.0)), 1.5, 0),
)


@pytest.fixture(scope="module")
def classifier():
    return VoxelClassifier.learned(scan_of(placed_grains().labels), STROKES, trees=3)


@pytest.fixture
def project(classifier):
    project = Project.new(scan_of(placed_grains().labels), embed_scan=True)
    project.change("Paint", strokes=STROKES)
    project.change("Learn", classifier=classifier)
    return project


def test_a_file_keeps_strokes_and_classifier(project, classifier, tmp_path):
    project.save(tmp_path / "sand.mbs")
    again = read_project(tmp_path / "sand.mbs")
    assert again.strokes == STROKES
    assert again.classifier.entries == classifier.entries
    for name, array in classifier.arrays.items():
        assert np.array_equal(again.classifier.arrays[name], array)
    with h5py.File(tmp_path / "sand.mbs") as file:
        assert file.attrs["schema"] == 7


def test_strokes_are_undone(project):
    project.undo()
    assert project.state.classifier is None
    project.undo()
    assert project.state.strokes == ()
    project.redo()
    assert project.state.strokes == STROKES


def test_another_scan_forgets_the_strokes_and_keeps_the_classifier(project, classifier):
    project.use_scan(scan_of(placed_grains().labels[:20]))
    assert project.state.strokes == ()
    assert project.state.classifier is classifier


def test_who_changed_the_strokes_keeps_them(project):
    base = project.state
    ours = replace(base, strokes=STROKES[:1])
    theirs = replace(base, classifier=None)
    merged = merge_states(base, ours, theirs).state
    assert merged.strokes == STROKES[:1]
    assert merged.classifier is None


@pytest.mark.parametrize("name", ["left", "entries"])
def test_a_classifier_that_is_none_makes_the_file_damaged(project, tmp_path, name, monkeypatch):
    arrays = type(project.state.classifier).arrays.fget(project.state.classifier)
    entries = type(project.state.classifier).entries.fget(project.state.classifier)
    if name == "left":
        changed = arrays["left"].copy()
        changed[0] = 10**6
        monkeypatch.setattr(VoxelClassifier, "arrays", property(lambda _self: {**arrays, "left": changed}))
    else:
        monkeypatch.setattr(VoxelClassifier, "entries", property(lambda _self: {**entries, "features": 9}))
    project.save(tmp_path / "sand.mbs")
    monkeypatch.undo()
    with pytest.raises(ProjectError, match=r"sand\.mbs"):
        read_project(tmp_path / "sand.mbs")
