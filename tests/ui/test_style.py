"""Styles in the window: learned, kept, and grains generated in them."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.vae.training import learn
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def learner():
    """The principal components of twelve boxes."""
    return learn(boxes(12, np.random.default_rng(1)), "pca")


def test_the_style_is_the_projects_and_undo_takes_it_back(window, learner):
    told = []
    window.workspace.style_changed.connect(lambda: told.append(window.workspace.style))
    window.workspace.use_style(learner)
    assert window.workspace.style is learner
    assert window.workspace.is_modified
    window.undo()
    assert window.workspace.style is None
    window.workspace.redo()
    window.files.new_project()
    assert told == [learner, None, learner, None]
