"""Parents spread over the sizes of many grains."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.cloning.parent_choice import spread_over_sizes


def test_few_are_all_taken():
    assert spread_over_sizes([3.0, 1.0, 2.0], 3) == [0, 1, 2]
    assert spread_over_sizes([], 3) == []


@pytest.mark.parametrize("most", [2, 7, 200, 999])
def test_some_of_many_have_the_sizes_of_all(most):
    volumes = np.random.default_rng(0).lognormal(sigma=1.5, size=1000)
    chosen = spread_over_sizes(volumes, most)
    assert chosen == sorted(set(chosen))
    assert len(chosen) == most
    assert {int(volumes.argmin()), int(volumes.argmax())} <= set(chosen)
    shares = (0.1, 0.5, 0.9)
    if most >= 200:
        assert np.quantile(volumes[chosen], shares) == pytest.approx(np.quantile(volumes, shares), rel=0.05)


def test_none_cannot_be_taken():
    with pytest.raises(ValueError, match="At least 1 body"):
        spread_over_sizes([1.0], 0)
