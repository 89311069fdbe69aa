from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import elliprg

from mbstudio.core.errors import StyleError
from mbstudio.core.metrics.form_bound import highest_sphericity


def of_ellipsoid(long: float, middle: float, short: float) -> float:
    """Wadell's sphericity by the exact area: Carlson's symmetric integral R_G."""
    a, b, c = long**2, middle**2, short**2
    area = 4.0 * np.pi * elliprg(a * b, a * c, b * c)
    return float(np.pi * (8.0 * long * middle * short) ** (2 / 3) / area)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.45, 1.0), st.floats(0.4, 1.0))
def test_no_ellipsoid_is_more_spherical(csf: float, elongation: float) -> None:
    ours = of_ellipsoid(1.0, elongation, csf * np.sqrt(elongation))
    assert ours <= highest_sphericity(csf) + 1e-6


@pytest.mark.parametrize(("csf", "room"), [(0.5, 0.003), (0.7, 0.0003), (0.9, 0.0001), (1.0, 1e-9)])
def test_the_best_body_is_nearly_a_spheroid(csf: float, room: float) -> None:
    spheroid = of_ellipsoid(1.0, 1.0, csf)
    assert spheroid - 1e-9 <= highest_sphericity(csf) <= spheroid + room


@pytest.mark.parametrize("csf", [0.1, 1.01, np.nan])
def test_only_bodies_of_such_a_form(csf: float) -> None:
    with pytest.raises(StyleError, match="Corey shape factor"):
        highest_sphericity(csf)
