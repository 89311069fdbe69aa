"""Formulas of the shape factors, by hand."""

from __future__ import annotations

import math

import pytest

from mbstudio.core.metrics import factors


def test_a_sphere_of_radius_two():
    volume, area = 4 / 3 * math.pi * 8, 4 * math.pi * 4
    assert factors.nominal_diameter(volume) == pytest.approx(4)
    assert factors.sphericity(volume, area) == pytest.approx(1)
    assert factors.projected_diameter(math.pi * 4) == pytest.approx(4)
    assert factors.circularity(math.pi * 4, 2 * math.pi * 2) == pytest.approx(1)
    assert factors.corey_shape_factor(4, 4, 4) == 1


def test_a_cube_has_the_sphericity_of_the_textbook():
    assert factors.sphericity(1, 6) == pytest.approx((math.pi / 6) ** (1 / 3))


def test_corey_uses_the_shortest_over_the_mean_of_the_others():
    assert factors.corey_shape_factor(1, 4, 9) == pytest.approx(1 / 6)
