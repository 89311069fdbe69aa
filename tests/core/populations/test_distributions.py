"""Distributions with answers computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations import bin_edges, cumulative, histogram, kernel_density, moments

VALUES = st.lists(st.floats(-1e3, 1e3, width=32), min_size=1, max_size=40)


def test_the_staircase_by_number_and_by_weight():
    cdf = cumulative(np.array([3.0, 1.0, 1.0, 2.0]))
    np.testing.assert_allclose(cdf.values, [1, 2, 3])
    np.testing.assert_allclose(cdf.shares, [0.5, 0.75, 1])
    np.testing.assert_allclose(cdf(np.array([0.9, 1.0, 1.9, 2.0, 5.0])), [0, 0.5, 0.5, 0.75, 1])
    assert [cdf.quantile(q) for q in (0, 0.5, 0.51, 1)] == [1, 1, 2, 3]
    weighted = cumulative(np.array([1.0, 2.0]), np.array([1.0, 9.0]))
    np.testing.assert_allclose(weighted.shares, [0.1, 1])
    assert weighted.quantile(0.5) == 2


def test_moments():
    assert moments(np.array([1.0, 2.0, 6.0])) == pytest.approx((3.0, np.sqrt(7)))  # (4 + 1 + 9) / 2
    mean, deviation = moments(np.array([0.0, 1.0]), np.array([1.0, 3.0]))
    # Variance 3/16, divided by 1 - (1/16 + 9/16).
    assert (mean, deviation) == pytest.approx((0.75, np.sqrt((3 / 16) / (6 / 16))))
    assert np.isnan(moments(np.array([5.0]))[1])


def test_bins_by_freedman_and_diaconis():
    values = np.arange(1.0, 65.0)  # quartiles 16 and 48: bins 2 * 32 / 4 = 16 wide over a span of 63
    np.testing.assert_allclose(bin_edges(values), np.linspace(1, 64, 5))


def test_equal_values_have_one_bin_and_no_kernel_density():
    values = np.full(5, 2.0)
    density = histogram(values)
    assert len(density.density) == 1
    assert density.x[0] < 2 < density.x[1]
    with pytest.raises(MeasureError, match="all equal"):
        kernel_density(values)


def test_the_kernel_density_of_many_normal_values_is_normal(rng):
    density = kernel_density(rng.normal(10, 2, 20_000))
    normal = np.exp(-(((density.x - 10) / 2) ** 2) / 2) / (2 * np.sqrt(2 * np.pi))
    np.testing.assert_allclose(density.density, normal, atol=0.01)


@pytest.mark.parametrize(
    ("values", "weights", "named"),
    [
        ([], None, "at least one"),
        ([1, np.nan], None, "finite"),
        ([1, 2], [1], "weights"),
        ([1, 2], [1, -1], "weights"),
        ([1, 2], [0, 0], "zero"),
    ],
)
def test_what_is_no_distribution(values, weights, named):
    with pytest.raises(MeasureError, match=named):
        cumulative(np.array(values, dtype=float), None if weights is None else np.array(weights, dtype=float))


@given(VALUES)
def test_densities_have_the_area_one(values):
    values = np.array(values, dtype=float)
    density = histogram(values)
    assert np.sum(density.density * np.diff(density.x)) == pytest.approx(1)
    if np.ptp(values) > 1e-3:
        smooth = kernel_density(values)
        assert np.trapezoid(smooth.density, smooth.x) == pytest.approx(1, abs=0.01)


@given(VALUES, st.integers(1, 4))
def test_a_whole_weight_is_so_many_equal_values(values, times):
    values = np.array(values, dtype=float)
    weights = np.ones(len(values))
    weights[0] = times
    repeated = np.concatenate([values, np.repeat(values[:1], times - 1)])
    np.testing.assert_allclose(cumulative(values, weights).shares, cumulative(repeated).shares)
    assert moments(values, weights)[0] == pytest.approx(moments(repeated)[0], abs=1e-9)
