from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.model_card import ModelCard
from mbstudio.core.vae.models.radii import log_radii
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import StyleTraining
from mbstudio.core.vae.shaping import latent as hand
from mbstudio.core.vae.shaping.meaning import add_difference
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def learner() -> StyleLearner:
    training = StyleTraining(boxes(40, np.random.default_rng(2)), preset="pca", seed=0)
    for _ in training:
        pass
    return training.result()


def surfaces(learner: StyleLearner, latents: np.ndarray) -> np.ndarray:
    return log_radii(learner.decode(np.atleast_2d(latents)))


def test_noise_goes_farther_the_same_way(learner: StyleLearner) -> None:
    here = learner.latents[0]
    near, far = (hand.add_noise(learner, here, sigma, seed=3)[0] - here for sigma in (0.2, 0.8))
    np.testing.assert_allclose(far, 4 * near)
    assert not np.allclose(hand.add_noise(learner, here, 0.2, seed=4)[0] - here, near)
    np.testing.assert_array_equal(hand.add_noise(learner, here, 0.0, seed=4)[0], here)


def test_noise_has_the_covariance_of_the_parents(learner: StyleLearner) -> None:
    strayed = hand.add_noise(learner, learner.latents[0], 1.0, seed=0, count=4000) - learner.latents[0]
    np.testing.assert_allclose(strayed.std(axis=0), hand.deviations(learner), rtol=0.06)


def test_interpolation_takes_the_nearest_flip(learner: StyleLearner) -> None:
    assert learner.signs is not None
    first = learner.latents[0]
    mirrored = first * learner.signs[3]
    assert np.abs(mirrored - first).max() > 1e-3
    ways = hand.interpolate(learner, first, mirrored, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(ways, np.tile(first, (3, 1)), atol=1e-9)
    ends = hand.interpolate(learner, first, learner.latents[5], [0.0, 1.0])
    np.testing.assert_array_equal(ends[0], first)
    assert any(np.allclose(ends[1], learner.latents[5] * row) for row in learner.signs)


def test_every_step_of_a_morph_is_as_long(learner: StyleLearner) -> None:
    way = hand.morph(learner, learner.latents[1], learner.latents[7], 9)
    steps = np.sqrt(np.square(np.diff(surfaces(learner, way), axis=0)).mean(axis=1))
    assert way.shape == (9, learner.dimension)
    assert steps.max() < 1.05 * steps.mean()
    np.testing.assert_array_equal(way[0], learner.latents[1])


def test_sums_of_grains(learner: StyleLearner) -> None:
    base, other = learner.latents[2], learner.latents[3]
    np.testing.assert_allclose(add_difference(learner, base, other, other, 1.0), base, atol=1e-9)
    np.testing.assert_allclose(hand.blend(learner, np.stack([base, base]), [0.5, 0.5]), base, atol=1e-9)
    np.testing.assert_allclose(hand.blend(learner, base[None], [0.0]), hand.mean_latent(learner))


def test_outside_and_clamped(learner: StyleLearner) -> None:
    inside, spread = learner.latents[4], hand.deviations(learner)
    far = inside.copy()
    far[0] += 9 * spread[0]
    assert not hand.is_far_outside(learner, inside)
    assert hand.is_far_outside(learner, far)
    back = hand.clamp(learner, far)
    assert not hand.is_far_outside(learner, back)
    np.testing.assert_array_equal(back[1:], far[1:])


def test_effects_are_those_of_one_deviation(learner: StyleLearner) -> None:
    mean, spread = hand.mean_latent(learner), hand.deviations(learner)
    found = hand.effects(learner)
    moved = surfaces(learner, np.stack([mean + spread * (np.arange(len(mean)) == 0), mean]))
    assert found[0] == pytest.approx(np.sqrt(np.square(moved[0] - moved[1]).mean()), rel=0.1)
    assert found.shape == (learner.dimension,)


def test_the_map_leads_there_and_back(learner: StyleLearner) -> None:
    chart = hand.latent_map(learner)
    places = chart.places(learner.latents)
    np.testing.assert_allclose(places.std(axis=0), 1.0, rtol=1e-6)
    np.testing.assert_allclose(places.mean(axis=0), 0.0, atol=1e-9)
    assert 0 < chart.share[1] <= chart.share[0] < 1
    at = chart.latent_at(np.array([0.7, -1.2]), base=learner.latents[6])
    np.testing.assert_allclose(chart.places(at[None])[0], [0.7, -1.2], atol=1e-9)
    # What the map does not show stays that of the grain begun from.
    other = chart.latent_at(chart.places(learner.latents[6][None])[0], base=at)
    np.testing.assert_allclose(other, learner.latents[6], atol=1e-9)


def test_a_grain_that_was_learned_is_projected_to_its_place(learner: StyleLearner) -> None:
    parent = learner.parents.avatar(0)
    found = hand.project_bodies(learner, [parent])
    near = np.abs(surfaces(learner, hand.align_to(learner, learner.latents[0], found[0]))
                  - surfaces(learner, learner.latents[0]))  # fmt: skip
    assert near.max() < 0.1


def test_a_learner_without_flips_works_too() -> None:
    parents = boxes(8, np.random.default_rng(5))
    latents = np.random.default_rng(1).normal(size=(8, 33))

    class Plain:
        preset, scaler = "paper", None
        core = dimension = 33
        signs, bands = None, ()

        def decode(self, latents, names=None):
            return parents.take(np.arange(len(latents)) % 8)

    learner = StyleLearner(Plain(), parents, latents, ModelCard.__new__(ModelCard))  # type: ignore[arg-type]
    np.testing.assert_array_equal(hand.align_to(learner, latents[0], latents[1]), latents[1])
    assert hand.add_noise(learner, latents[0], 0.5).shape == (1, 33)


@pytest.mark.parametrize(
    ("what", "said"),
    [
        (lambda learner: hand.add_noise(learner, learner.latents[0], -1.0), "sigma"),
        (lambda learner: hand.add_noise(learner, learner.latents[0][:-1], 0.5), "does not fit"),
        (lambda learner: hand.add_noise(learner, learner.latents[0] * np.nan, 0.5), "finite"),
        (lambda learner: hand.morph(learner, learner.latents[0], learner.latents[1], 1), "at least two"),
        (lambda learner: hand.interpolate(learner, *learner.latents[:2], [np.inf]), "finite"),
        (lambda learner: hand.blend(learner, learner.latents[:2], [1.0]), "finite weights"),
        (lambda learner: add_difference(learner, *learner.latents[:3], strength=np.nan), "finite"),
    ],
)  # fmt: skip
def test_what_cannot_be(learner: StyleLearner, what, said: str) -> None:
    with pytest.raises(StyleError, match=said):
        what(learner)
