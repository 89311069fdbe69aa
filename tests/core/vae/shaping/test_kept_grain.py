"""Kept grains: what they hold, their names, and variations that are valid bodies."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping import kept_grain as keeping
from mbstudio.core.vae.shaping.latent_recipe import Operation, Recipe, read_recipe, style_digest
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def learner():
    return learn(boxes(12, np.random.default_rng(2)), preset="pca", seed=0)


@pytest.fixture(scope="module")
def kept(learner):
    digest = style_digest(learner)
    recipes = [
        Recipe(
            f"kept {row}",
            tuple(learner.latents[row].tolist()),
            (Operation("begin", {"parent": "p"}),),
            digest,
        )
        for row in (1, 2, 4)
    ]
    return keeping.measure_recipes(learner, recipes)


def test_a_kept_grain_comes_back_from_json_to_the_last_bit(kept, learner):
    for grain in kept:
        again = keeping.read_kept_grain(json.loads(json.dumps(grain.as_record())))
        assert again == grain
        np.testing.assert_array_equal(again.recipe.vector, grain.recipe.vector)
    volume = learner.decode(learner.latents[1:2]).avatar(0).mesh(96).volume
    assert kept[0].factors[0] == pytest.approx((6 * volume / np.pi) ** (1 / 3), rel=0.005)
    assert kept[0].unit == "mm"
    with pytest.raises(StyleError, match="'factors' of a kept grain is missing"):
        keeping.read_kept_grain(kept[0].recipe.as_record())


def test_names_are_unique_and_can_be_file_names(kept):
    assert keeping.next_number(kept) == 5
    assert keeping.next_number([]) == 1
    named = keeping.rename_grain(kept, "kept 2", " flat one ")
    assert [grain.name for grain in named] == ["kept 1", "flat one", "kept 4"]
    assert named[1].recipe.latent == kept[1].recipe.latent
    assert keeping.rename_grain(kept, "kept 2", "kept 2") == kept
    for taken in ("kept 4", "kept_4", "box 3"):
        with pytest.raises(StyleError, match="already"):
            keeping.rename_grain(kept, "kept 2", taken, ["box 3"])
    for no_file in ("", "  ", "a/b", "..", "a\\b", "a:b"):
        with pytest.raises(StyleError, match="cannot be the name"):
            keeping.rename_grain(kept, "kept 2", no_file)


def test_only_grains_of_the_style_learner_can_be_made(kept, learner):
    other = learn(boxes(12, np.random.default_rng(3)), preset="pca", seed=0)
    assert keeping.select_style(kept, learner) == kept
    assert keeping.select_style(kept, other) == ()
    assert keeping.select_style(kept, None) == ()
    avatars, names, attached = keeping.prepare_export(learner, kept[1:])
    assert names == ["kept_2", "kept_4"]
    np.testing.assert_array_equal(avatars[0].centers, learner.decode(learner.latents[2:3]).avatar(0).centers)
    records = json.loads(attached["recipes.json"])
    assert read_recipe(records[1]) == kept[2].recipe


def test_variations_are_as_many_as_asked_for_and_each_can_be_made_again(learner):
    here = learner.latents[3]
    made = keeping.find_variations(learner, here, {"sigma": 0.2}, 5, seed=7)
    assert len(made) == 5
    assert len({operation.given["seed"] for _, operation in made}) == 5
    assert min(operation.given["seed"] for _, operation in made) == 7
    for latent, _ in made:
        assert keeping.is_sound(learner, latent)
        assert np.abs(latent - here).max() > 1e-3
    again = keeping.find_variations(learner, here, {"sigma": 0.2}, 5, seed=7)
    np.testing.assert_array_equal([latent for latent, _ in again], [latent for latent, _ in made])
