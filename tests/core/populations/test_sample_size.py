"""Enough grains? Numbers of the standard, of drawing again, and of samples drawn in truth."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations import size_distribution
from mbstudio.core.populations.sample_size import lognormal_bodies, needed_bodies, read_off_bodies
from tests.core.populations.made import spheres


def test_the_standard_asks_for_six_thousand_at_a_geometric_deviation_of_1_6():
    # ISO 13322-1:2004, scope: "over 6 000 particles" for a repeatable mean size by volume of this spread.
    assert 6000 < lognormal_bodies(np.log(1.6), 0.03) < 6100
    # Masuda and Iinoya: u**2 s**2 (2 c**2 s**2 + 1) / delta**2 with c = 3 for the median by mass.
    s = np.log(1.3)
    assert lognormal_bodies(s, 0.05, 50) == np.ceil(1.959964**2 * s**2 * (18 * s**2 + 1) / 0.05**2)


@pytest.mark.parametrize("percent", [None, 10, 50, 90])
def test_so_many_log_normal_spheres_have_the_precision(percent):
    spread, precision = 0.25, 0.05
    count = max(how(spread, precision, percent) for how in (lognormal_bodies, read_off_bodies))
    rng = np.random.default_rng(7)
    truth = np.exp(3.5 * spread**2)
    if percent is not None:
        truth = np.exp(3 * spread**2 + spread * {10: -1.2816, 50: 0.0, 90: 1.2816}[percent])
    found = []
    for _ in range(300):
        d = np.exp(rng.normal(0.0, spread, count))
        read = (d**4).sum() / (d**3).sum()
        found.append(read if percent is None else size_distribution(spheres(*d)).diameter(percent))
    assert 0.92 < np.mean(np.abs(np.array(found) / truth - 1) < precision) < 0.98 + 0.02 * (percent is None)


def test_more_bodies_are_enough_for_what_few_are_not():
    rng = np.random.default_rng(1)
    few, many = (spheres(*np.exp(rng.normal(0, 0.3, n))) for n in (60, 1500))
    needs = {need.name: need for need in needed_bodies(few, 0.05, samples=300)}
    assert list(needs) == ["mean", "d10", "d50", "d90"]
    assert not any(need.is_enough for need in needs.values())
    assert all(need.needed >= need.by_bootstrap for need in needs.values())
    later = {need.name: need for need in needed_bodies(many, 0.08, samples=300)}
    assert later["d50"].is_enough
    # Two samples of one kind ask for about the same.
    again = {need.name: need for need in needed_bodies(many, 0.05, samples=300)}
    assert again["d50"].by_bootstrap == pytest.approx(needs["d50"].by_bootstrap, rel=0.8)


@pytest.mark.parametrize("sizes", [(1.0,), (1.0, 2.0), (2.0,) * 30])
def test_one_two_or_bodies_all_alike_tell_nothing(sizes):
    for need in needed_bodies(spheres(*sizes), samples=100):
        assert need.needed is None
        assert need.is_enough is None
        assert np.isfinite(need.found.value)


def test_what_is_no_precision_is_refused():
    with pytest.raises(MeasureError, match=r"such as 0\.05"):
        needed_bodies(spheres(1.0, 2.0), 5)
    with pytest.raises(MeasureError, match="not a factor"):
        needed_bodies(spheres(1.0, 2.0), factors=("hue",))
    with pytest.raises(MeasureError, match="spread"):
        lognormal_bodies(0.0, 0.05)
