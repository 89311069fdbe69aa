"""The minimum-volume box."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.axes import convex_hull, minimum_bounding_box


def test_a_regular_tetrahedron_fits_a_cube():
    """Its smallest box is the cube of the face diagonals (O'Rourke 1985), not a box on a face."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    box = minimum_bounding_box(convex_hull(corners @ Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix().T))
    assert box.lengths == pytest.approx([2, 2, 2], rel=2e-3)
    assert np.linalg.det(box.directions) == pytest.approx(1)


def test_no_rotation_of_many_gives_a_smaller_box():
    points = np.random.default_rng(3).normal(size=(60, 3)) * [1, 1.4, 2]
    box = minimum_bounding_box(convex_hull(points))
    frames = Rotation.random(30000, rng=np.random.default_rng(4)).as_matrix()
    brute = np.ptp(frames @ points.T, axis=2).prod(axis=1).min()
    assert box.lengths.prod() <= brute * (1 + 1e-4)
    assert np.ptp(box.directions @ points.T, axis=1) == pytest.approx(box.lengths)


def test_flat_points_have_no_box():
    with pytest.raises(MeasureError, match="flat"):
        convex_hull(np.random.default_rng(0).normal(size=(20, 3)) * [1, 1, 0])
