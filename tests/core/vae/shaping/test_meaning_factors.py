from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metrics.star_factors import star_directions
from mbstudio.core.vae.models.radii import directions, log_radii
from mbstudio.core.vae.serialize.serialization import Serialization
from mbstudio.core.vae.shaping.meaning_factors import (
    MEANINGS,
    _integrals,
    departures,
    meaning_factors,
    roughness,
)
from tests.core.vae.boxes import boxes, eight_points


def one_sphere() -> Serialization:
    """Eight control points all but in one place: f = 8 k / r**2, a sphere of radius sqrt(8 k)."""
    template = eight_points()
    weight = 0.25 / 8  # radius 0.5 in D_n
    return Serialization(
        template, 1e-4 * template.centers[None], np.full((1, 8), np.log(weight)), np.array([3.0]), "mm",
        ("sphere",), np.zeros(1), np.ones(1, bool),
    )  # fmt: skip


def test_sphere() -> None:
    found = dict(zip(MEANINGS, meaning_factors(one_sphere())[0], strict=True))
    assert np.exp(found["size"]) == pytest.approx(3.0, rel=1e-4)
    for name in ("elongation", "csf", "sphericity"):
        assert found[name] == pytest.approx(1.0, abs=1e-4)
    assert found["roughness"] == pytest.approx(0.0, abs=1e-5)


def test_second_moments_of_an_ellipsoid() -> None:
    """Of a solid ellipsoid they are V a**2 / 5 along its axes; the mesh lies within by the faces' sagitta."""
    along, faces = star_directions()
    axes, shift = np.array([1.0, 0.7, 0.5]), np.array([0.1, -0.2, 0.05])
    volume, area, moments = _integrals(along * axes + shift, faces)
    assert volume == pytest.approx(4 / 3 * np.pi * axes.prod(), rel=0.01)
    np.testing.assert_allclose(np.diagonal(moments), axes**2 / 5, rtol=0.01)
    assert np.abs(moments - np.diag(np.diagonal(moments))).max() < 1e-10
    assert area > 4 * np.pi * (axes.prod() ** (2 / 3))  # more than the sphere of the same volume


@pytest.mark.parametrize("axes", [(1.0, 0.9, 0.8), (1.0, 0.6, 0.5), (1.0, 1.0, 0.5)])
def test_an_ellipsoid_has_no_roughness(axes: tuple[float, float, float]) -> None:
    along = directions()
    logs = -0.5 * np.log(np.square(along / np.array(axes)).sum(axis=1))
    assert np.abs(departures(logs[None])).max() < 1e-9


@pytest.mark.parametrize(("degree", "share"), [(1, 0.0), (2, 0.0), (3, 0.0), (4, 0.0), (5, 1.0), (7, 1.0)])
def test_roughness_is_of_degree_five_and_finer(degree: int, share: float) -> None:
    """A zonal harmonic a P_l on a sphere has an rms of a / sqrt(2 l + 1)."""
    axis = np.array([0.36, 0.48, 0.8])
    wave = 0.01 * np.polynomial.legendre.Legendre.basis(degree)(directions() @ axis)
    left = np.sqrt(np.square(departures(wave[None])).mean())
    assert left == pytest.approx(share * 0.01 / np.sqrt(2 * degree + 1), rel=0.08, abs=1e-4)


def test_roughness_of_bodies() -> None:
    bodies = boxes(3, np.random.default_rng(0))
    smooth, rough = roughness(one_sphere())[0], roughness(bodies)
    assert (rough > 10 * smooth).all()
    assert (rough < log_radii(bodies).std(axis=1)).all()


def test_factors_know_no_flips() -> None:
    bodies = boxes(2, np.random.default_rng(3))
    for flip in range(8):
        np.testing.assert_allclose(
            meaning_factors(bodies.flipped(np.array([flip, flip]))), meaning_factors(bodies), rtol=2e-3
        )
