from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.training import StyleTraining
from mbstudio.core.vae.shaping.latent import is_far_outside
from mbstudio.core.vae.shaping.meaning import HELD, Design, Meanings, add_difference
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def meanings() -> Meanings:
    training = StyleTraining(boxes(80, np.random.default_rng(2)), preset="pca", seed=0)
    for _ in training:
        pass
    return Meanings.measure(training.result())


@pytest.mark.parametrize("name", [name for name in MEANINGS if name != "roughness"])
def test_a_step_is_one_deviation_and_leaves_the_rest(meanings: Meanings, name: str) -> None:
    """About the parents' middle, where there is room for the step."""
    learner, place = meanings.learner, MEANINGS.index(name)
    middle = np.argsort(np.abs(meanings.units(meanings.known)).max(axis=1))[:5]
    held = [MEANINGS.index(other) for other in HELD[name]]
    for row in middle:
        here = learner.latents[row]
        ways = np.stack([here, *(meanings.move_along(here, {name: step}) for step in (-0.5, 0.5))])
        start, down, up = meanings.units(meanings.factors(ways))
        assert up[place] - start[place] == pytest.approx(0.5, abs=0.1)
        assert down[place] - start[place] == pytest.approx(-0.5, abs=0.1)
        assert np.abs((up - down)[held]).max() < 0.25


def test_rougher_is_rougher_and_of_the_same_form(meanings: Meanings) -> None:
    """Boxes of eight points have little room to be rougher at their form: only the sign is asked for."""
    middle = np.argsort(np.abs(meanings.units(meanings.known)).max(axis=1))[:5]
    for here in meanings.learner.latents[middle]:
        rougher = meanings.move_along(here, {"roughness": 0.5})
        start, up = meanings.units(meanings.factors(np.stack([here, rougher])))
        assert (up - start)[4] > 0
        assert np.abs((up - start)[:3]).max() < 0.15


def test_two_meanings_are_brought_to_values_at_once(meanings: Meanings) -> None:
    wanted = {"csf": -0.4, "size": 0.6}
    moved = meanings.bring_to(meanings.learner.latents[5], wanted)
    reached = meanings.units(meanings.factors(moved[None]))[0]
    for name, value in wanted.items():
        assert reached[MEANINGS.index(name)] == pytest.approx(value, abs=0.05)


def test_a_few_corrections_follow_a_slider(meanings: Meanings) -> None:
    here, place = meanings.learner.latents[5], MEANINGS.index("elongation")
    start = meanings.units(meanings.factors(here[None]))[0, place]
    quick = meanings.move_along(here, {"elongation": -0.4}, corrections=2)
    assert meanings.units(meanings.factors(quick[None]))[0, place] - start == pytest.approx(-0.4, abs=0.1)


def test_a_step_stops_where_no_grain_is(meanings: Meanings) -> None:
    here = meanings.learner.latents[0]
    far = meanings.units(meanings.factors(meanings.move_along(here, {"csf": 50.0})[None]))[0]
    assert np.isfinite(far).all()
    assert far[MEANINGS.index("csf")] <= meanings.units(meanings.reach)[1, MEANINGS.index("csf")] + 0.1


@pytest.mark.parametrize("step", [-4.0, 4.0])
def test_no_search_leaves_the_range_of_the_latents(meanings: Meanings, step: float) -> None:
    """What would be held back afterwards is not looked for: the grain keeps the factors it was found with."""
    learner = meanings.learner
    for name in ("size", "csf", "sphericity"):
        assert not is_far_outside(learner, meanings.move_along(learner.latents[4], {name: step}))
    flat = meanings.design({"csf": 0.45, "sphericity": 0.8})
    assert not is_far_outside(learner, flat.latent)


def test_no_step_changes_nothing(meanings: Meanings) -> None:
    here = meanings.learner.latents[3]
    np.testing.assert_array_equal(meanings.move_along(here, {"csf": 0.0}), here)


def test_inverse_design(meanings: Meanings) -> None:
    known = meanings.factors(meanings.learner.latents)
    low, high = np.percentile(known, [20, 80], axis=0)
    for csf in (low[2], high[2]):
        for sphericity in (low[3], high[3]):
            found = meanings.design({"csf": csf, "sphericity": sphericity})
            assert found.residual < 0.02
            reached = meanings.factors(found.latent[None])[0]
            assert reached[2] == pytest.approx(found.reached["csf"])
            assert reached[3] == pytest.approx(sphericity, rel=0.02)
    sized = meanings.design({"size": 0.5})
    assert sized.reached["size"] == pytest.approx(0.5, rel=0.02)


def test_differences_added_keep_their_sign(meanings: Meanings) -> None:
    learner, rng, right = meanings.learner, np.random.default_rng(0), []
    for _ in range(12):
        plus, minus, base = learner.latents[rng.choice(len(learner.parents), 3, replace=False)]
        moved = add_difference(learner, base, plus, minus, 0.5, meanings=meanings)
        units = meanings.units(meanings.factors(np.stack([plus, minus, base, moved])))
        asked, found = units[0] - units[1], units[3] - units[2]
        telling = (np.abs(asked) > 0.2) & (np.array(MEANINGS) != "roughness")
        right += (np.sign(asked[telling]) == np.sign(found[telling])).tolist()
    assert np.mean(right) >= 0.9


def test_what_cannot_be(meanings: Meanings) -> None:
    here = meanings.learner.latents[0]
    with pytest.raises(StyleError, match="not a meaning"):
        meanings.move_along(here, {"colour": 1.0})
    with pytest.raises(StyleError, match="finite"):
        meanings.move_along(here, {"csf": np.nan})
    with pytest.raises(StyleError, match="at least one target"):
        meanings.design({})
    with pytest.raises(StyleError, match="above 0"):
        meanings.design({"csf": -0.5})
    with pytest.raises(StyleError, match="relative error"):
        meanings.design({"csf": 0.5}, tolerance=0.0)
    with pytest.raises(StyleError, match="does not fit"):
        meanings.move_along(here[:-1], {"csf": 1.0})
    with pytest.raises(StyleError, match="does not fit"):
        meanings.bring_to(here[:-1], {"csf": 1.0})


def test_a_design_knows_what_no_body_can_be() -> None:
    """A spheroid of axes 1 : 1 : 0.6 has a sphericity of 0.952, a body of that form hardly more."""
    flat = Design(np.zeros(1), {"csf": 0.6, "sphericity": 0.97}, {"csf": 0.6, "sphericity": 0.95})
    assert not flat.is_possible()
    assert flat.is_possible(0.02)  # 0.612 and 0.951
    assert Design(np.zeros(1), {"csf": 0.6, "sphericity": 0.95}, {}).is_possible()
    assert not Design(np.zeros(1), {"elongation": 1.1}, {}).is_possible(0.02)
    assert Design(np.zeros(1), {"size": 40.0, "csf": 0.9}, {}).is_possible()


def test_a_design_that_is_missed_tells_what_it_reached(meanings: Meanings) -> None:
    found = meanings.design({"csf": 0.5, "sphericity": 0.99})
    assert found.residual > 0.02
    assert not found.is_possible(0.02)
    reached = meanings.factors(found.latent[None])[0]
    np.testing.assert_allclose(list(found.reached.values()), reached[2:4], rtol=1e-9)
