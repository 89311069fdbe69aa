"""A surface cut by a plane."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metaball import Avatar
from mbstudio.scene.section_lines import section_lines
from mbstudio.scene.surfaces import Surface, avatar_surface


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("place", [-0.4, 0.0, 0.55])
def test_a_ball_is_cut_in_a_circle(axis, place):
    ball = avatar_surface(Avatar(np.zeros((1, 3)), np.ones(1), "um"), 64)
    radius = float(np.linalg.norm(ball.points, axis=1).mean())
    lines = section_lines(ball, axis, place * radius)
    assert np.allclose(lines[..., axis], place * radius)
    across = np.delete(lines, axis, axis=2)
    assert np.allclose(np.linalg.norm(across, axis=2), radius * np.sqrt(1 - place**2), rtol=0.02)
    length = np.linalg.norm(across[:, 1] - across[:, 0], axis=1).sum()
    assert length == pytest.approx(2 * np.pi * radius * np.sqrt(1 - place**2), rel=0.02)


def test_lines_close_where_corners_lie_in_the_plane():
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)
    faces = np.array([[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)], np.int64)
    lines = section_lines(Surface(corners, faces, corners), 2, 0.0)
    ends = np.round(lines.reshape(-1, 3), 6)
    _, counts = np.unique(ends, axis=0, return_counts=True)
    assert (counts == 2).all(), "each end is shared by two lines"


def test_a_plane_beside_a_surface_cuts_nothing():
    ball = avatar_surface(Avatar(np.zeros((1, 3)), np.ones(1), "um"), 24)
    assert section_lines(ball, 1, 99.0).shape == (0, 2, 3)
