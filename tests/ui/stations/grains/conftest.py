"""The window at station Grains with a few grains of known shape."""

from __future__ import annotations

import pytest

from mbstudio.core.project import Project
from tests.core.grains.editing.placed_grains import placed_grains, scan_of
from tests.core.project.conftest import make_fit


@pytest.fixture
def grains():
    return placed_grains()


@pytest.fixture
def at_grains(window, idle, grains, rng, qtbot):
    """The window at station Grains, with four grains and an avatar each."""
    scan = scan_of(grains.labels)
    project = Project.new(scan, embed_scan=True)
    project.change("Find grains", grains=grains)
    project.add_fits({label: make_fit(label, 4, rng) for label in (1, 2, 3, 4)})
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    window.studio.enter("grains")
    window.resize(1500, 900)
    idle()
    return window
