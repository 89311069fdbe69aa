"""Distances between populations that are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.errors import MeasureError
from mbstudio.core.populations import compare, relative_errors
from tests.core.populations.made import population


def test_errors_of_mean_and_deviation_in_percent():
    reference = population(csf=[1.0, 2.0, 3.0])  # mean 2, deviation 1
    other = population("clones", csf=[0.8, 1.8, 2.8, 1.8])  # mean 1.8, variance 2 / 3
    found = compare(reference, other)["csf"]
    assert found.numbers == (3, 4)
    assert found.means == pytest.approx((2.0, 1.8))
    assert found.mean_error == pytest.approx(10.0)
    assert found.deviation_error == pytest.approx(100 * (1 - np.sqrt(2 / 3)))


def test_shifted_samples():
    # 0..9 against 5..14: five of ten lie below all of the other; every value moves by 5.
    values = np.arange(10.0)
    found = compare(population(csf=values), population(csf=values + 5))["csf"]
    assert found.ks == pytest.approx(0.5)
    assert found.wasserstein == pytest.approx(5.0)
    # P(D >= 5/10) of two samples of ten: 2 (C(20, 15) - C(20, 20)) / C(20, 10), by reflection.
    assert found.p == pytest.approx(2 * (15504 - 1) / 184756, rel=1e-6)


def test_two_deltas_are_as_far_apart_as_they_lie():
    found = compare(population(dn=[2.0] * 4), population(dn=[7.0] * 3))["dn"]
    assert found.wasserstein == pytest.approx(5.0)
    assert found.ks == 1.0
    assert np.isnan(found.deviation_error)  # the reference has no deviation
    assert found.mean_error == pytest.approx(250.0)


def test_by_volume():
    reference = population(csf=[0.0, 1.0], volume=[1.0, 3.0])
    other = population(csf=[0.0, 1.0], volume=[3.0, 1.0])
    by_number = compare(reference, other, ["csf"])["csf"]
    assert (by_number.ks, by_number.wasserstein, by_number.p) == (0, 0, 1)
    by_volume = compare(reference, other, ["csf"], by="volume")["csf"]
    assert by_volume.ks == by_volume.wasserstein == pytest.approx(0.5)
    assert by_volume.means == pytest.approx((0.75, 0.25))
    assert np.isnan(by_volume.p)


def test_bodies_without_the_factor_do_not_count():
    found = compare(population(csf=[1, np.nan, 3], dn=[np.nan] * 3), population(csf=[2, 2], dn=[1, 1]))
    assert list(found) == ["csf"]
    assert found["csf"].numbers == (2, 2)


def test_an_avatar_is_paired_with_its_own_grain():
    grains = population(labels=[3, 5, 8], volume=[10.0, 20.0, np.nan])
    avatars = population("avatars", labels=[8, 5, 3], volume=[1.0, 19.0, 11.0])
    assert relative_errors(grains, avatars, "volume") == pytest.approx({3: 0.1, 5: -0.05})
    with pytest.raises(MeasureError, match="duplicate label"):
        relative_errors(grains, population(labels=[3, 3], volume=[1, 2]), "volume")


@pytest.mark.parametrize("other", [{"unit": "um"}, {"axes": "feret"}])
def test_only_what_was_measured_alike_is_compared(other):
    with pytest.raises(MeasureError, match="measure both alike"):
        compare(population(csf=[1.0]), population(csf=[1.0], **other))


def test_an_unknown_factor_is_named():
    with pytest.raises(MeasureError, match="no factor 'colour'"):
        compare(population(csf=[1.0]), population(csf=[1.0]), ["colour"])


@given(
    st.lists(st.floats(0.1, 10), min_size=2, max_size=12),
    st.floats(0, 5),
    st.sampled_from(["number", "volume"]),
)
def test_a_shift_moves_all_by_the_shift(values, shift, by):
    values = np.array(values)
    volume = np.arange(1.0, len(values) + 1)
    a, b = population(csf=values, volume=volume), population(csf=values + shift, volume=volume)
    found = compare(a, b, ["csf"], by=by)["csf"]
    assert found.wasserstein == pytest.approx(shift, abs=1e-9)
    assert found.means[1] - found.means[0] == pytest.approx(shift, abs=1e-9)
    back = compare(b, a, ["csf"], by=by)["csf"]
    assert back.ks == pytest.approx(found.ks)
    assert 0 <= found.ks <= 1 + 1e-12
