"""Classes of form of bodies with stated axes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.populations import sneed_folk_diagram, zingg_diagram
from tests.core.populations.made import population


def of_axes(*axes, volumes=None):
    a, b, c = np.array(axes, dtype=float).T
    return population(longest=a, intermediate=b, shortest=c, volume=volumes or np.ones(len(a)))


def test_zingg():
    diagram = zingg_diagram(
        of_axes((1, 0.9, 0.8), (1, 0.9, 0.3), (1, 0.5, 0.45), (1, 0.5, 0.2), volumes=[5, 3, 1, 1])
    )
    assert diagram.classes == ("equant", "disc", "rod", "blade")
    np.testing.assert_allclose(diagram.y, [0.9, 0.9, 0.5, 0.5])
    np.testing.assert_allclose(diagram.x, [0.8 / 0.9, 0.3 / 0.9, 0.9, 0.4])
    assert diagram.counts == {"disc": 1, "equant": 1, "blade": 1, "rod": 1}
    assert diagram.volume_shares == pytest.approx({"disc": 0.3, "equant": 0.5, "blade": 0.1, "rod": 0.1})


@pytest.mark.parametrize(
    ("axes", "named"),
    [
        ((1, 0.9, 0.8), "compact"),
        ((1, 0.95, 0.6), "compact-platy"),
        ((1, 0.8, 0.6), "compact-bladed"),
        ((1, 0.65, 0.6), "compact-elongate"),
        ((1, 0.95, 0.4), "platy"),
        ((1, 0.7, 0.4), "bladed"),
        ((1, 0.45, 0.4), "elongate"),
        ((1, 0.95, 0.1), "very platy"),
        ((1, 0.55, 0.1), "very bladed"),
        ((1, 0.15, 0.1), "very elongate"),
        ((2, 2, 2), "compact"),
    ],
)
def test_sneed_and_folk(axes, named):
    assert sneed_folk_diagram(of_axes(axes)).classes == (named,)


def test_bodies_without_axes_are_left_out_and_labels_kept():
    bodies = population(
        labels=[4, 7, 9], longest=[1, np.nan, 1], intermediate=[0.9, np.nan, 0.5],
        shortest=[0.8, np.nan, 0.2], volume=[1, np.nan, 1],
    )  # fmt: skip
    assert zingg_diagram(bodies).labels.tolist() == [4, 9]
    assert sum(sneed_folk_diagram(bodies).counts.values()) == 2


@given(st.lists(st.tuples(*[st.floats(0.01, 10)] * 3), min_size=1, max_size=20), st.floats(0.1, 10))
def test_form_does_not_depend_on_size(bodies, factor):
    axes = [tuple(sorted(body, reverse=True)) for body in bodies]
    one = sneed_folk_diagram(of_axes(*axes))
    assert len(one.classes) == len(axes)
    assert ((one.x >= 0) & (one.x <= 1) & (one.y > 0) & (one.y <= 1)).all()
    other = sneed_folk_diagram(of_axes(*[tuple(factor * length for length in body) for body in axes]))
    np.testing.assert_allclose(other.y, one.y)
