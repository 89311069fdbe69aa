"""Intervals by drawing bodies again: held against closed forms, reproducible, none where there are too
few."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations import moments, size_distribution
from mbstudio.core.populations.bootstrap import Bootstrap
from mbstudio.core.populations.distributions import kernel_density
from tests.core.populations.made import population, spheres


def lognormal(count: int, seed: int, spread: float = 0.3):
    d = np.exp(np.random.default_rng(seed).normal(0.0, spread, count))
    return spheres(*d)


def test_the_interval_of_a_mean_is_that_of_its_standard_error():
    values = np.random.default_rng(1).normal(10.0, 2.0, 400)
    found = Bootstrap(population(sphericity=values, volume=np.ones(400)), seed=3).mean("sphericity")
    assert found.value == pytest.approx(values.mean())
    assert (found.high - found.low) / 2 == pytest.approx(1.96 * values.std(ddof=1) / 20, rel=0.1)


def test_values_are_those_of_the_other_functions():
    one = lognormal(80, 2)
    drawn, curve = Bootstrap(one, samples=100), size_distribution(one)
    for percent in (10, 30, 50, 60, 90):
        assert drawn.diameter(percent).value == pytest.approx(curve.diameter(percent), rel=1e-12)
    assert drawn.cu.value == pytest.approx(curve.cu)
    assert drawn.cc.value == pytest.approx(curve.cc)
    for by in ("number", "volume"):
        mean, deviation = moments(one.values("intermediate"), one.weights("intermediate", by))
        assert drawn.mean("intermediate", by).value == pytest.approx(mean)
        assert drawn.deviation("intermediate", by).value == pytest.approx(deviation)
    assert drawn.finer(curve.sizes).value == pytest.approx(curve.finer)
    smooth = kernel_density(one.values("intermediate"))
    assert drawn.density("intermediate", smooth.x).value == pytest.approx(smooth.density)


def test_nineteen_of_twenty_intervals_hold_the_truth():
    truth = np.exp(3.0 * 0.3**2)  # of D50 by volume, median 1 by number
    held = []
    for seed in range(60):
        found = Bootstrap(lognormal(300, seed), samples=200, seed=seed).diameter(50)
        held.append(found.low <= truth <= found.high)
    assert 0.85 <= np.mean(held) <= 1.0


def test_the_same_seed_draws_the_same_and_another_not():
    one = lognormal(50, 4)
    assert Bootstrap(one, seed=5).diameter(50) == Bootstrap(one, seed=5).diameter(50)
    assert Bootstrap(one, seed=5).diameter(50).low != Bootstrap(one, seed=6).diameter(50).low


@pytest.mark.parametrize("count", [1, 2, 9])
def test_too_few_bodies_have_a_value_and_no_interval(count):
    found = Bootstrap(spheres(*np.linspace(1, 2, count))).diameter(50)
    assert np.isfinite(found.value)
    assert np.isnan(found.low)
    assert np.isnan(found.half_width)
    band = Bootstrap(spheres(*np.linspace(1, 2, count))).finer(np.array([1.5]))
    assert np.isnan(band.high).all()


def test_bodies_without_numbers_do_not_count_and_equal_ones_leave_nothing_open():
    values = np.concatenate([np.full(20, 3.0), [np.nan]])
    found = Bootstrap(population(sphericity=values, volume=np.ones(21))).mean("sphericity")
    assert (found.low, found.value, found.high) == pytest.approx((3.0, 3.0, 3.0))
    with pytest.raises(MeasureError, match="nothing to draw"):
        Bootstrap(population(sphericity=[np.nan], volume=[1.0])).mean("sphericity")


def test_what_makes_no_interval_is_refused():
    one = lognormal(20, 1)
    with pytest.raises(MeasureError, match="at least 100"):
        Bootstrap(one, samples=5)
    with pytest.raises(MeasureError, match="between 0 and 1"):
        Bootstrap(one, level=95)
    with pytest.raises(MeasureError, match="share"):
        Bootstrap(one).quantile("intermediate", 50)


def test_the_share_of_a_class_is_binomial():
    one = population(intermediate=np.ones(400), volume=np.ones(400), sphericity=np.arange(400.0))
    found = Bootstrap(one, seed=1).share(np.arange(400) < 100)
    assert found.value == 0.25
    assert (found.high - found.low) / 2 == pytest.approx(1.96 * np.sqrt(0.25 * 0.75 / 400), rel=0.15)
