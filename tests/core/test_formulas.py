"""Formulas of size and shape, by hand."""

from __future__ import annotations

import math

import pytest

from mbstudio.core import formulas


def test_a_sphere_of_radius_two():
    volume, area = 4 / 3 * math.pi * 8, 4 * math.pi * 4
    assert formulas.nominal_diameter(volume) == pytest.approx(4)
    assert formulas.sphericity(volume, area) == pytest.approx(1)
    assert formulas.projected_diameter(math.pi * 4) == pytest.approx(4)
    assert formulas.circularity(math.pi * 4, 2 * math.pi * 2) == pytest.approx(1)
    assert formulas.corey_shape_factor(4, 4, 4) == 1


def test_a_cube_has_the_sphericity_of_the_textbook():
    assert formulas.sphericity(1, 6) == pytest.approx((math.pi / 6) ** (1 / 3))


def test_corey_uses_the_shortest_over_the_mean_of_the_others():
    assert formulas.corey_shape_factor(1, 4, 9) == pytest.approx(1 / 6)


def test_factors_of_the_axes_by_hand():
    assert formulas.krumbein_sphericity(1, 2, 4) == pytest.approx((2 / 16) ** (1 / 3))
    assert formulas.sneed_folk_sphericity(1, 2, 4) == pytest.approx((1 / 8) ** (1 / 3))
    assert formulas.potticary_elongation(1, 2, 4) == pytest.approx(2 / 7)
    assert formulas.potticary_flatness(1, 2, 4) == pytest.approx(2 / 7)
    assert formulas.angelidakis_elongation(1, 2, 4) == pytest.approx(4 / 8 - 1 / 5)
    assert formulas.angelidakis_flatness(1, 2, 4) == pytest.approx(4 / 8 - 1 / 5)


def test_a_needle_is_all_elongation_and_a_disc_all_flatness():
    needle, disc = (1e-9, 1e-9, 1), (1e-9, 1, 1)
    for elongation, flatness in (
        (formulas.potticary_elongation, formulas.potticary_flatness),
        (formulas.angelidakis_elongation, formulas.angelidakis_flatness),
    ):
        assert (elongation(*needle), flatness(*needle)) == pytest.approx((1, 0))
        assert (elongation(*disc), flatness(*disc)) == pytest.approx((0, 1))
    assert formulas.angelidakis_elongation(1, 1, 1) == formulas.angelidakis_flatness(1, 1, 1) == 0
