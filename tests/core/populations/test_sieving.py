"""Sieve curves of bodies whose answer is computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.errors import MeasureError, UnitError
from mbstudio.core.populations import SizeDistribution, size_distribution, standard_sieves
from tests.core.populations.made import population, spheres


def test_spheres_of_three_sizes_by_mass():
    # Diameters 1, 2, 4: 64, 8 and 1 of them have equal mass.
    curve = size_distribution(spheres(1, 2, 4, counts=[64, 8, 1]))
    np.testing.assert_allclose(curve.sizes, [1, 2, 4])
    np.testing.assert_allclose(curve.finer, [100 / 3, 200 / 3, 100])
    # Half way between a third and two thirds, half way between log 1 and log 2.
    assert curve.d50 == pytest.approx(np.sqrt(2))
    assert curve.d60 == pytest.approx(2 ** ((60 - 100 / 3) / (100 / 3)))
    # The smallest spheres are a third of the mass: 10 % and 30 % lie within them.
    assert curve.d10 == curve.d30 == 1.0
    assert curve.cu == pytest.approx(curve.d60)
    assert curve.cc == pytest.approx(1 / curve.d60)


def test_coefficients_of_a_straight_line():
    # Straight over two decades in the logarithm: D_x = 0.1 * 10**(x / 50).
    curve = SizeDistribution(np.array([0.1, 1.0, 10.0]), np.array([0.0, 50.0, 100.0]), "mm", "sieves")
    assert curve.d10 == pytest.approx(0.1 * 10**0.2)
    assert curve.d50 == pytest.approx(1.0)
    assert curve.cu == pytest.approx(10.0)  # 10**((60 - 10) / 50)
    assert curve.cc == pytest.approx(10 ** ((2 * 30 - 10 - 60) / 50))


def test_on_iso_sieves():
    # Between 1 and 1.4 mm a quarter, between 2 and 2.8 mm three quarters of the mass.
    bodies = population(intermediate=[1.2, 2.5], volume=[1.0, 3.0])
    curve = size_distribution(bodies, "iso")
    np.testing.assert_allclose(curve.sizes, [1, 1.4, 2, 2.8])
    np.testing.assert_allclose(curve.finer, [0, 25, 25, 100])
    assert curve.d10 == pytest.approx(1.4**0.4)
    assert curve.d50 == pytest.approx(2 * 1.4 ** (1 / 3))
    assert "ISO 3310" in curve.sieves


def test_a_body_as_wide_as_the_opening_passes():
    curve = size_distribution(population(intermediate=[0.5, 0.6], volume=[1, 1]), "astm")
    np.testing.assert_allclose(curve.sizes, [0.425, 0.5, 0.6])
    np.testing.assert_allclose(curve.finer, [0, 50, 100])


def test_openings_come_in_the_unit_of_the_bodies():
    np.testing.assert_allclose(standard_sieves("astm", 80, 140, "um"), [75, 90, 106, 125, 150])
    with pytest.raises(UnitError, match="no unit"):
        standard_sieves("astm", 80, 140, "unitless")


def test_what_no_sieve_bounds_is_not_a_number():
    # Half the mass is finer than the finest sieve of 0.045 mm.
    curve = size_distribution(population(intermediate=[0.03, 0.08], volume=[1, 1]), "iso")
    assert np.isnan(curve.d10)
    assert np.isnan(curve.cu)
    assert 0.063 < curve.d60 < 0.09
    with pytest.raises(MeasureError, match="outside the sieves"):
        size_distribution(population(intermediate=[300, 400], volume=[1, 1]), "iso")


def test_bodies_that_could_not_be_measured_have_no_mass():
    curve = size_distribution(population(intermediate=[1, np.nan, 2], volume=[1, np.nan, 1]))
    np.testing.assert_allclose(curve.finer, [50, 100])
    with pytest.raises(MeasureError, match="no sizes"):
        size_distribution(population(intermediate=[np.nan], volume=[np.nan]))


@given(
    st.lists(st.tuples(st.floats(0.05, 100), st.floats(0.1, 10)), min_size=1, max_size=30),
    st.sampled_from(["iso", "astm", None]),
)
def test_the_curve_rises_and_its_diameters_with_it(bodies, series):
    size, volume = np.array(bodies).T
    curve = size_distribution(population(intermediate=size, volume=volume), series)
    assert (np.diff(curve.finer) >= -1e-9).all()
    assert (np.diff(curve.sizes) > 0).all()
    found = [curve.diameter(percent) for percent in (10, 30, 50, 60, 100)]
    assert (np.diff(found) >= -1e-9).all()
    assert found[-1] >= size.max() * (1 - 1e-9) or series is None
    # All is finer than the last sieve: the series reaches so far.
    assert curve.finer[-1] == pytest.approx(100)
