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


def test_factors_of_the_axes_by_hand():
    assert factors.krumbein_sphericity(1, 2, 4) == pytest.approx((2 / 16) ** (1 / 3))
    assert factors.sneed_folk_sphericity(1, 2, 4) == pytest.approx((1 / 8) ** (1 / 3))
    assert factors.potticary_elongation(1, 2, 4) == pytest.approx(2 / 7)
    assert factors.potticary_flatness(1, 2, 4) == pytest.approx(2 / 7)
    assert factors.angelidakis_elongation(1, 2, 4) == pytest.approx(4 / 8 - 1 / 5)
    assert factors.angelidakis_flatness(1, 2, 4) == pytest.approx(4 / 8 - 1 / 5)


def test_a_needle_is_all_elongation_and_a_disc_all_flatness():
    needle, disc = (1e-9, 1e-9, 1), (1e-9, 1, 1)
    for elongation, flatness in (
        (factors.potticary_elongation, factors.potticary_flatness),
        (factors.angelidakis_elongation, factors.angelidakis_flatness),
    ):
        assert (elongation(*needle), flatness(*needle)) == pytest.approx((1, 0))
        assert (elongation(*disc), flatness(*disc)) == pytest.approx((0, 1))
    assert factors.angelidakis_elongation(1, 1, 1) == factors.angelidakis_flatness(1, 1, 1) == 0
