from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.factor_regression import FactorRegression
from mbstudio.core.vae.latent import added
from mbstudio.core.vae.meaning import HELD, Meanings
from mbstudio.core.vae.meaning_factors import MEANINGS
from mbstudio.core.vae.training import StyleTraining
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def meanings() -> Meanings:
    training = StyleTraining(boxes(80, np.random.default_rng(2)), preset="pca", seed=0)
    for _ in training:
        pass
    return Meanings.of(training.result(), samples=1200)


def test_a_quadratic_function_is_found() -> None:
    rng = np.random.default_rng(0)
    latents = rng.normal(size=(900, 4)) * [2.0, 1.0, 0.5, 0.1]
    signs = np.ones((8, 4))
    signs[1::2, 2:] = -1.0  # the last two change with the flip of x

    def truth(z: np.ndarray) -> np.ndarray:
        return np.stack(
            [3 + z[..., 0] - 2 * z[..., 1] ** 2, z[..., 2] * z[..., 3] + 0.5 * z[..., 1]], axis=-1
        )

    found = FactorRegression.of(latents, truth(latents), signs)
    assert found.determination.min() > 0.999
    np.testing.assert_allclose(found.values(latents[:5]), truth(latents[:5]), atol=0.02)
    here, step = np.array([0.3, 0.7, -0.2, 0.05]), 1e-6
    slopes = [(truth(here + step * e) - truth(here - step * e)) / (2 * step) for e in np.eye(4)]
    np.testing.assert_allclose(found.gradient(here), np.array(slopes).T, atol=0.05)
    assert 2 not in found.linear
    assert 3 not in found.linear


@pytest.mark.parametrize("name", [name for name in MEANINGS if name != "roughness"])
def test_a_step_is_one_deviation_and_leaves_the_rest(meanings: Meanings, name: str) -> None:
    """About the parents' middle, where there is room for the step."""
    learner, place = meanings.learner, MEANINGS.index(name)
    near = np.argsort(np.abs(meanings.units(meanings.factors(learner.latents))).max(axis=1))[:6]
    held = [MEANINGS.index(other) for other in HELD[name]]
    for row in near:
        here = learner.latents[row]
        ways = np.stack([here, *(meanings.moved(here, {name: step}, corrections=8) for step in (-0.5, 0.5))])
        start, down, up = meanings.units(meanings.factors(ways))
        assert up[place] - start[place] == pytest.approx(0.5, abs=0.15)
        assert down[place] - start[place] == pytest.approx(-0.5, abs=0.15)
        assert np.abs((up - down)[held]).max() < 0.35


def test_rougher_is_rougher(meanings: Meanings) -> None:
    """Boxes of eight points can hardly be rougher at the same form: only the sign is asked for."""
    learner, place = meanings.learner, MEANINGS.index("roughness")
    gained = []
    for here in learner.latents[:10]:
        ways = np.stack([meanings.moved(here, {"roughness": step}, corrections=8) for step in (-0.5, 0.5)])
        down, up = meanings.factors(ways)[:, place]
        gained.append((up - down) / meanings.deviation[place])
    assert np.min(gained) > 0
    assert np.median(gained) > 0.4


def test_a_step_stops_where_no_grain_is(meanings: Meanings) -> None:
    here = meanings.learner.latents[0]
    far = meanings.units(meanings.factors(meanings.moved(here, {"csf": 50.0})[None]))[0]
    assert np.isfinite(far).all()
    assert far[MEANINGS.index("csf")] <= meanings.units(meanings.reach)[1, MEANINGS.index("csf")] + 0.1


def test_no_step_changes_nothing(meanings: Meanings) -> None:
    here = meanings.learner.latents[3]
    np.testing.assert_array_equal(meanings.moved(here, {"csf": 0.0}), here)


def test_inverse_design(meanings: Meanings) -> None:
    known = meanings.factors(meanings.learner.latents)
    low, high = np.percentile(known, [20, 80], axis=0)
    for csf in (low[2], high[2]):
        for sphericity in (low[3], high[3]):
            found = meanings.designed({"csf": csf, "sphericity": sphericity})
            assert found.residual < 0.02
            reached = meanings.factors(found.latent[None])[0]
            assert reached[2] == pytest.approx(found.reached["csf"])
            assert reached[3] == pytest.approx(sphericity, rel=0.02)
    sized = meanings.designed({"size": 0.5})
    assert sized.reached["size"] == pytest.approx(0.5, rel=0.02)


def test_differences_added_keep_their_sign(meanings: Meanings) -> None:
    learner, rng, right = meanings.learner, np.random.default_rng(0), []
    for _ in range(12):
        plus, minus, base = learner.latents[rng.choice(len(learner.parents), 3, replace=False)]
        moved = added(learner, base, plus, minus, 0.5, meanings=meanings)
        units = meanings.units(meanings.factors(np.stack([plus, minus, base, moved])))
        asked, found = units[0] - units[1], units[3] - units[2]
        telling = (np.abs(asked) > 0.2) & (np.array(MEANINGS) != "roughness")
        right += (np.sign(asked[telling]) == np.sign(found[telling])).tolist()
    assert np.mean(right) >= 0.9


def test_what_cannot_be(meanings: Meanings) -> None:
    here = meanings.learner.latents[0]
    with pytest.raises(StyleError, match="no meaning"):
        meanings.moved(here, {"colour": 1.0})
    with pytest.raises(StyleError, match="finite"):
        meanings.moved(here, {"csf": np.nan})
    with pytest.raises(StyleError, match="at least one target"):
        meanings.designed({})
    with pytest.raises(StyleError, match="does not belong"):
        meanings.moved(here[:-1], {"csf": 1.0})
