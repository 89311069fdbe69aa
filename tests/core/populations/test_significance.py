"""Several tests at once: Holm's steps, error rates, pairs, and what would be missed."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations.significance import POWER, adjust_by_holm, find_differences
from tests.core.populations.made import population

NAMES = ("sphericity", "csf", "dn", "ds", "dns", "circularity")


def normal(rng, count, shift=0.0):
    columns = {name: rng.normal(10 + shift * (name == "csf"), 1.0, count) for name in NAMES}
    return population(volume=np.ones(count), **columns)


def test_holm_on_paper():
    assert adjust_by_holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert adjust_by_holm([0.01, float("nan"), 0.2]) == pytest.approx([0.02, float("nan"), 0.2], nan_ok=True)
    assert adjust_by_holm([]) == []
    with pytest.raises(MeasureError, match="between 0 and 1"):
        adjust_by_holm([1.5])


def test_of_equal_populations_one_in_twenty_at_most_has_a_factor_that_differs():
    rng, wrong, naive = np.random.default_rng(3), 0, 0
    for _ in range(100):
        tests = find_differences(normal(rng, 60), normal(rng, 60), NAMES)
        wrong += any(test.differs for test in tests.values())
        naive += any(test.p < 0.05 for test in tests.values())
    assert wrong <= 10
    assert naive >= 12, "without adjusting, one in four would"


def test_the_stated_distance_is_found_as_often_as_stated():
    rng, count, found = np.random.default_rng(4), 80, 0
    stated = find_differences(normal(rng, count), normal(rng, count), NAMES)["csf"].detectable
    # Two normal distributions of deviation 1 are 2 Phi(d / 2) - 1 apart at most.
    from scipy.special import ndtri

    shift = 2 * float(ndtri((1 + stated) / 2))
    for _ in range(60):
        found += find_differences(normal(rng, count), normal(rng, count, shift), NAMES)["csf"].differs
    assert found / 60 >= POWER - 0.05


def test_pairs_show_what_two_samples_hide():
    rng = np.random.default_rng(5)
    grains = normal(rng, 50)
    avatars = population(
        "avatars", volume=np.ones(50), **{name: grains.column(name) * 1.0 for name in NAMES if name != "ds"},
        ds=grains.column("ds") * (0.99 + rng.normal(0, 0.002, 50)),
    )  # fmt: skip
    apart = find_differences(grains, avatars, NAMES)
    assert not apart["ds"].differs
    paired = find_differences(grains, avatars, NAMES, paired=True)
    assert paired["ds"].differs
    assert paired["ds"].is_paired
    assert paired["csf"].p == 1.0


def test_two_bodies_can_show_nothing():
    rng = np.random.default_rng(6)
    for test in find_differences(normal(rng, 2), normal(rng, 2), NAMES).values():
        assert not test.differs
        assert test.detectable == 1.0
    paired = find_differences(normal(rng, 2), normal(rng, 2), NAMES, paired=True)
    assert not any(test.differs for test in paired.values())
