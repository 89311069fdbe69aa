"""A body of known volume."""

from __future__ import annotations

import pytest
import trimesh


@pytest.fixture
def ball():
    """A ball of 1280 triangles, radius 1, in no special place."""
    body = trimesh.creation.icosphere(subdivisions=3)
    body.apply_translation((0.3, -0.2, 0.1))
    return body
