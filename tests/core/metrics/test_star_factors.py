from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import measure
from mbstudio.core.metrics.mass import mass_properties
from mbstudio.core.metrics.star_factors import STAR_FACTORS, star_directions, star_factors


def test_the_directions_close_a_sphere() -> None:
    vertices, faces = star_directions()
    assert (len(vertices), len(faces)) == (642, 1280)
    assert np.allclose(np.linalg.norm(vertices, axis=1), 1)
    corners = vertices[faces]
    assert (np.linalg.det(corners) > 0).all()


def test_a_sphere() -> None:
    # One control point: the radius is sqrt(k) = 2.
    found = dict(zip(STAR_FACTORS, star_factors(np.array([[0.0], [0.0], [0.0], [4.0]])), strict=True))
    assert found["volume"] == pytest.approx(4 / 3 * np.pi * 8, rel=1e-4)
    assert found["area"] == pytest.approx(4 * np.pi * 4, rel=1e-4)
    assert found["longest"] == pytest.approx(4, rel=2e-3)
    assert found["ds"] == pytest.approx(4, rel=4e-3)
    assert found["circularity"] == pytest.approx(1, abs=2e-3)


def test_a_rough_body_is_measured_nearly_as_exactly() -> None:
    rng = np.random.default_rng(3)
    around = rng.normal(size=(30, 3))
    around *= np.array([0.36, 0.28, 0.2]) / np.linalg.norm(around, axis=1)[:, None]
    avatar = Avatar(around, rng.uniform(0.003, 0.006, 30), "mm")
    avatar = avatar.transformed(translation=-mass_properties(avatar, 1.0).com)
    exact = measure(avatar)
    found = dict(zip(STAR_FACTORS, star_factors(avatar.control), strict=True))
    for name, tolerance in (
        ("volume", 5e-4), ("area", 5e-4), ("sphericity", 5e-4), ("circularity", 2e-3), ("dns", 5e-3),
        ("csf", 0.02), ("longest", 0.02),
    ):  # fmt: skip
        assert found[name] == pytest.approx(getattr(exact, name), rel=tolerance), name


def test_a_body_whose_centre_is_hollow_has_no_factors() -> None:
    far = np.array([[3.0, -3.0], [0.0, 0.0], [0.0, 0.0], [1.0, 1.0]])
    assert np.isnan(star_factors(far)).all()
