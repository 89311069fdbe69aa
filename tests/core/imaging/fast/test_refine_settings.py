"""The bound of the field's steepness by the number of control points, as the search uses it."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings
from mbstudio.core.imaging.preprocess import prepare


@pytest.mark.parametrize(("n", "roof"), [(1, 6), (10, 6), (24, 6), (32, 8), (40, 10), (120, 10)])
def test_the_roof_rises_with_the_number_of_control_points(n, roof):
    assert RefineSettings().steepness_roof_for(n) == roof


def test_a_lower_roof_for_few_is_not_above_the_roof_itself():
    assert RefineSettings(steepness_roof=4.0).steepness_roof_for(10) == 4


@pytest.mark.parametrize("n", [8, 48])
def test_distances_to_a_steep_surface_are_bounded_by_the_roof(n):
    z, y, x = np.ogrid[:40, :40, :40]
    ball = (x - 20) ** 2 + (y - 20) ** 2 + (z - 20) ** 2 <= 15**2
    prepared = prepare(Grain.from_mask(ball, "1 um"))
    # Control points of small weight just inside the surface: f is as steep there as 2 / distance.
    directions = np.random.default_rng(1).normal(size=(3, n))
    places = 0.9 * prepared.hull.max() * directions / np.linalg.norm(directions, axis=0)
    search = Refinement(prepared, np.vstack([places, np.full(n, 0.01)]))
    points, residuals, _ = search.surface_rows_at(search.control)
    away = points.astype(float)[:, :, None] - search.control[:3, None, :]
    squared = (away**2).sum(axis=0)
    field = (search.control[3] / squared).sum(axis=1)
    gradient = -2 * (away * (search.control[3] / squared**2)).sum(axis=2)
    g = np.linalg.norm(gradient, axis=0) / field
    roof = RefineSettings().steepness_roof_for(n)
    assert (g > roof).sum() > 20
    expected = 2 * (1 - field**-0.5) / np.clip(g, 0.7, roof)
    np.testing.assert_allclose(residuals, search.surface.row_weight * expected, rtol=1e-3, atol=1e-6)
