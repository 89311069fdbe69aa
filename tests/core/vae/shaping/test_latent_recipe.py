from __future__ import annotations

import json

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping import latent as hand
from mbstudio.core.vae.shaping.latent_recipe import Operation, Recipe, carry_out, read_recipe, style_digest
from mbstudio.core.vae.shaping.meaning import Meanings
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def learner() -> StyleLearner:
    return learn(boxes(40, np.random.default_rng(2)), preset="pca", seed=0)


@pytest.fixture(scope="module")
def meanings(learner: StyleLearner) -> Meanings:
    return Meanings.measure(learner)


def test_a_recipe_leads_to_the_same_grain_again(learner: StyleLearner, meanings: Meanings) -> None:
    steps = (
        Operation("begin", {"parent": learner.parents.names[4]}),
        Operation("reach", {"meaning": "csf", "to": -0.8}),
        Operation("noise", {"sigma": 0.3, "seed": 5, "meanings": ["size"], "components": [2]}),
        Operation("component", {"component": 1, "to": 0.4}),
        Operation("place", {"place": [0.5, -0.5]}),
    )
    latent = hand.mean_latent(learner)
    for step in steps:
        latent, _ = carry_out(learner, latent, step, meanings)
    kept = Recipe("kept 1", tuple(latent.tolist()), steps, style_digest(learner))
    again = read_recipe(json.loads(json.dumps(kept.as_record())))
    assert again == kept
    np.testing.assert_array_equal(again.vector, latent)
    np.testing.assert_array_equal(again.retrace(learner, meanings), latent)


def test_a_meaning_reaches_its_value(learner: StyleLearner, meanings: Meanings) -> None:
    row = MEANINGS.index("csf")
    for wanted in (-1.0, 0.5):
        moved, held = carry_out(
            learner, learner.latents[0], Operation("reach", {"meaning": "csf", "to": wanted}), meanings
        )
        assert meanings.units(meanings.factors(moved[None]))[0, row] == pytest.approx(wanted, abs=0.1)
        assert not held


def test_locks_hold_what_they_lock(learner: StyleLearner, meanings: Meanings) -> None:
    here = learner.latents[7]
    free, _ = carry_out(learner, here, Operation("random", {"seed": 3}), meanings)
    given = {"seed": 3, "meanings": ["size", "elongation"], "components": [0, 4]}
    moved, _ = carry_out(learner, here, Operation("random", given), meanings)
    np.testing.assert_array_equal(moved[[0, 4]], here[[0, 4]])
    before, after, loose = meanings.units(meanings.factors(np.stack([here, moved, free])))
    rows = [MEANINGS.index(name) for name in ("size", "elongation")]
    assert np.abs(after - before)[rows].max() < 0.15
    assert np.abs(loose - before)[rows].max() > 0.3
    assert np.abs(moved - here).max() > 0.1


def test_what_is_far_outside_is_held_and_told(learner: StyleLearner) -> None:
    moved, held = carry_out(learner, learner.latents[0], Operation("component", {"component": 0, "to": 1e3}))
    assert held
    limit = hand.mean_latent(learner) + hand.farthest(learner)
    assert moved[0] == pytest.approx(limit[0])


def test_interpolation_and_sum(learner: StyleLearner) -> None:
    a, b, c = (row.tolist() for row in learner.latents[:3])
    start, _ = carry_out(learner, np.array(c), Operation("between", {"a": a, "b": b, "share": 0.0}))
    np.testing.assert_array_equal(start, a)
    unchanged, _ = carry_out(
        learner, np.array(b), Operation("sum", {"a": a, "b": a, "c": c, "strength": 1.0, "told": False})
    )
    np.testing.assert_allclose(unchanged, c, atol=1e-12)


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (Operation("melt", {}), "melt"),
        (Operation("noise", {"sigma": 0.1}), "seed"),
        (Operation("begin", {"parent": "nobody"}), "nobody"),
        (Operation("reach", {"meaning": "csf", "to": 0.0}), "still being learned"),
    ],
)
def test_what_cannot_be_done_is_refused(learner: StyleLearner, step: Operation, words: str) -> None:
    with pytest.raises(StyleError, match=words):
        carry_out(learner, learner.latents[0], step)


def test_recipes_of_other_learners_and_broken_ones_are_refused(learner: StyleLearner) -> None:
    with pytest.raises(StyleError, match="another style-learner"):
        Recipe("x", (0.0,), (), "0123456789abcdef").retrace(learner)
    with pytest.raises(StyleError, match="operations"):
        read_recipe({"name": "x", "style": "", "z": [0.0]})
