"""Necks whose width follows from the equation of the surface."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metaball import Avatar
from mbstudio.core.metaball.neck import smallest_neck
from mbstudio.core.metaball.validity import check


@pytest.mark.parametrize("waist", [0.5, 0.2, 0.05, 0.01, 1e-3])
def test_the_neck_between_two_spheres(waist: float) -> None:
    # Half way between (-1, 0, 0) and (1, 0, 0) f = 2 k / (1 + r**2): the neck has radius sqrt(2 k - 1).
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    pair = Avatar([[-1, 0, 0], [1, 0, 0]], np.full(2, 0.5 * (1 + waist**2)), "mm")
    assert smallest_neck(pair.transformed(turn).control) == pytest.approx(2 * waist, rel=1e-4)


def test_of_two_necks_the_thinner_counts() -> None:
    row = Avatar([[-2.2, 0, 0], [0, 0, 0], [2.1, 0, 0]], [0.55, 0.55, 0.55], "mm")
    # Along x, f is lowest between the two points farther apart.
    along = np.linspace(-2.0, -0.2, 20_001)[:, None] * [1.0, 0, 0]
    place = along[row.field(along).argmin()]
    # The waist about the axis: the sphere that fits in at the saddle.
    across = place + np.linspace(0, 1, 200_001)[:, None] * [0.0, 1, 0]
    radius = across[np.flatnonzero(row.field(across) < 1)[0], 1]
    assert smallest_neck(row.control) == pytest.approx(2 * radius, rel=1e-3)


def test_a_body_without_neck_has_the_width_of_its_largest_sphere() -> None:
    assert smallest_neck(Avatar([[5, 5, 5]], [4.0], "mm").control) == pytest.approx(4, rel=1e-6)
    # Two points as near as this make an egg: f at the middle is 2 * 1 / 0.09.
    egg = Avatar([[-0.3, 0, 0], [0.3, 0, 0]], [1.0, 1.0], "mm")
    assert smallest_neck(egg.control) == pytest.approx(2 * np.sqrt(2 - 0.09), rel=0.01)


def test_the_verdict_tells_it_in_the_avatars_unit() -> None:
    pair = Avatar([[-1, 0, 0], [1, 0, 0]], [0.52, 0.52], "mm")
    assert check(pair).smallest_neck == pytest.approx(0.4, rel=1e-4)
    assert check(pair.to("um")).smallest_neck == pytest.approx(400, rel=1e-4)
    assert check(Avatar([[-1, 0, 0], [1, 0, 0]], [0.4, 0.4], "mm")).smallest_neck == 0
