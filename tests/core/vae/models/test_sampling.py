from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.features import character
from mbstudio.core.vae.models.sampling import (
    band_latents,
    even_normals,
    flip_moments,
    similar_parents,
    split_bands,
    stratified_rows,
)


def test_bands_double_in_width() -> None:
    assert split_bands((32, 20)) == ((0, 8), (8, 16), (16, 32), (32, 40), (40, 48), (48, 52))
    assert split_bands((3,)) == ((0, 3),)
    assert split_bands((0,)) == ()


def test_every_parent_lends_as_often() -> None:
    rows = stratified_rows(7, 24, np.random.default_rng(0))
    counts = np.bincount(rows, minlength=7)
    assert len(rows) == 24
    assert set(counts.tolist()) == {3, 4}
    assert len(stratified_rows(7, 0, np.random.default_rng(0))) == 0


def test_even_normals_fill_every_interval_once() -> None:
    values = even_normals(100, 3, np.random.default_rng(1))
    from scipy.special import ndtr

    for column in ndtr(values).T:
        assert sorted((column * 100).astype(int).tolist()) == list(range(100))


def test_moments_over_flips() -> None:
    latents = np.array([[1.0, 2.0], [3.0, 6.0]])
    signs = character(np.array([0, 1]))
    mean, covariance = flip_moments(latents, signs)
    # The second changes its sign with x: its mean over the flips is 0, and it goes with nothing even.
    np.testing.assert_allclose(mean, [2.0, 0.0])
    np.testing.assert_allclose(covariance, [[1.0, 0.0], [0.0, 20.0]])


def test_higher_bands_keep_a_parents_strength_and_lose_its_direction() -> None:
    rng = np.random.default_rng(2)
    latents = rng.normal(size=(30, 16))
    latents[:, 8:] *= rng.uniform(0.5, 2.0, (30, 1))
    parities = rng.integers(1, 8, 16)  # all odd: the mean is 0
    signs, bands = character(parities), split_bands((16,))
    drawn, rows = band_latents(latents, signs, bands, 300, rng, turning=1.0)
    strength = np.linalg.norm(drawn[:, 8:], axis=1)
    np.testing.assert_allclose(strength, np.linalg.norm(latents[rows, 8:], axis=1))
    cosine = np.abs(np.einsum("cd,cd->c", drawn[:, 8:], latents[rows, 8:])) / strength**2
    assert np.median(cosine) < 0.5


@pytest.mark.parametrize("mixing", [0.0, 0.5, 1.0])
def test_first_band_keeps_mean_and_covariance(mixing: float) -> None:
    rng = np.random.default_rng(3)
    latents = rng.normal(size=(40, 4)) @ rng.normal(size=(4, 4)) + [5.0, 0, 0, 0]
    signs = character(np.array([0, 0, 1, 2]))
    drawn, _ = band_latents(latents, signs, split_bands((4,)), 40000, rng, mixing=mixing, neighbours=40)
    mean, covariance = flip_moments(latents, signs)
    np.testing.assert_allclose(drawn.mean(0), mean, atol=0.05)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=0.03 * np.abs(covariance).max())


def test_noise_comes_from_parents_of_the_same_strength() -> None:
    # Ten weak parents along one latent and ten strong ones along another: no clone has a bit of both.
    latents = np.zeros((20, 10))
    latents[:10, 0] = np.linspace(0.01, 0.02, 10)
    latents[10:, 1] = np.linspace(3.0, 4.0, 10)
    signs, bands = character(np.array([1, 2, *[4] * 8])), split_bands((10,))
    rng = np.random.default_rng(6)
    drawn, rows = band_latents(latents, signs, bands, 100, rng, mixing=0.9, neighbours=10)
    assert np.abs(drawn[rows < 10, 1]).max() == 0.0
    assert np.abs(drawn[rows >= 10, 0]).max() == 0.0
    assert np.abs(drawn[rows >= 10, 1]).max() > 1.0


def test_neighbours_begin_with_oneself_whatever_the_flip() -> None:
    rng = np.random.default_rng(7)
    latents, signs = rng.normal(size=(12, 10)), character(np.arange(10) % 8)
    near = similar_parents(latents, signs, split_bands((10,)), 5)
    assert near.shape == (12, 5)
    assert near[:, 0].tolist() == list(range(12))
    flipped = latents * signs[rng.integers(0, 8, 12)]
    np.testing.assert_array_equal(similar_parents(flipped, signs, split_bands((10,)), 5), near)
    assert similar_parents(latents, signs, split_bands((10,)), 50).shape == (12, 12)


def test_without_mixing_the_first_band_is_a_parents() -> None:
    rng = np.random.default_rng(4)
    latents, signs = rng.normal(size=(10, 5)), character(np.array([1, 2, 4, 7, 3]))
    drawn, rows = band_latents(latents, signs, split_bands((5,)), 20, rng, mixing=0.0)
    np.testing.assert_allclose(np.abs(drawn), np.abs(latents[rows]))


def test_impossible_samples_are_refused() -> None:
    latents, signs, rng = np.zeros((5, 3)), np.ones((8, 3)), np.random.default_rng(0)
    with pytest.raises(StyleError, match="0 or more, not -1"):
        band_latents(latents, signs, split_bands((3,)), -1, rng)
    with pytest.raises(StyleError, match=r"shares of noise .* not 2"):
        band_latents(latents, signs, split_bands((3,)), 5, rng, mixing=2.0)
