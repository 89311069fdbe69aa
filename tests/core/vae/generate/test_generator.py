from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import Cancelled, GenerationError
from mbstudio.core.metaball.validity import check
from mbstudio.core.metrics.star_factors import STAR_FACTORS, star_factors
from mbstudio.core.populations import Population, compare, size_distribution
from mbstudio.core.vae.generate.candidates import PIECES, REPAIRED, VALID, examine
from mbstudio.core.vae.generate.generator import generate
from tests.core.vae.boxes import BoxLearner, boxes

PARENTS = boxes(12, np.random.default_rng(1))


@pytest.fixture(autouse=True)
def few_candidates(monkeypatch):
    monkeypatch.setattr("mbstudio.core.vae.generate.generator._SPARE", 10)


def test_the_same_seed_gives_the_same_clones_on_one_process_and_on_two() -> None:
    learner = BoxLearner(PARENTS, loose_every=6)
    first = generate(learner, 6, 4, measured=False)
    second = generate(learner, 6, 4, measured=False, processes=2)
    other = generate(learner, 6, 5, measured=False)
    assert np.array_equal(first.clones.centers, second.clones.centers)
    assert np.array_equal(first.clones.log_weights, second.clones.log_weights)
    assert np.array_equal(first.clones.diameters, second.clones.diameters)
    assert first.counts == second.counts
    assert not np.array_equal(first.clones.centers, other.clones.centers)


def test_invalid_candidates_are_replaced_and_counted() -> None:
    found = generate(BoxLearner(PARENTS, stray_every=4), 8, 0)
    counts = found.counts
    strays = -(-counts.candidates // 4)
    assert counts.refused["falls into pieces"] >= strays
    assert counts.valid + counts.repaired + sum(counts.refused.values()) == counts.candidates
    assert len(found) == 8
    assert all(check(avatar).valid for avatar in found.avatars())
    assert found.factors is not None
    assert found.factors.kind == "clones"
    assert found.factors.measured.all()
    # A stray corner would lie a million diameters away.
    assert np.abs(found.clones.centers).max() < 1


def test_a_loose_corner_is_pulled_in() -> None:
    body = boxes(1, np.random.default_rng(2))
    control = np.concatenate([body.centers[0].T, np.exp(body.log_weights[0])[None]])
    assert examine(control)[1] == VALID
    loose = control.copy()
    loose[:3, 0] *= 2.6
    mended, state, factors = examine(loose)
    assert state == REPAIRED
    assert np.isfinite(factors).all()
    assert np.linalg.norm(mended[:3, 0]) < np.linalg.norm(loose[:3, 0])
    assert np.array_equal(mended[:, 1:], loose[:, 1:])
    lost = control.copy()
    lost[:3, 0] = 1e6
    assert examine(lost)[1] == PIECES


def test_a_range_and_a_sieve_curve_are_met() -> None:
    found = generate(BoxLearner(PARENTS), 24, 1, targets=["csf=0.75..0.9", "sieve=0.36:30,0.42:65 mm"])
    assert found.factors is not None
    csf = found.factors.column("csf")
    assert csf.min() >= 0.75
    assert csf.max() <= 0.9
    size, volume = found.factors.column("intermediate"), found.factors.column("volume")
    # No choice of so few comes nearer than half of the largest.
    near = max(1.0, 50 * volume.max() / volume.sum())
    for opening, percent in ((0.36, 30.0), (0.42, 65.0)):
        assert 100 * volume[size <= opening].sum() / volume.sum() == pytest.approx(percent, abs=near)
    assert all(figure.is_met for figure in found.reached)
    assert size_distribution(found.factors).diameter(65) == pytest.approx(0.42, rel=0.03)


def test_what_the_parents_cannot_give_is_refused_with_their_range() -> None:
    learner = BoxLearner(PARENTS)
    with pytest.raises(GenerationError, match=r"6 clones with csf = 0.1..0.2.* csf 0\.[67].* to 0\.9"):
        generate(learner, 6, 1, targets=["csf=0.1..0.2"])
    with pytest.raises(GenerationError, match=r"6 clones with D50 = 4 mm.* intermediate 0\.[234]"):
        generate(learner, 6, 1, targets=["D50=4 mm"])


def test_bad_calls_and_cancelling() -> None:
    with pytest.raises(GenerationError, match="1 or more"):
        generate(BoxLearner(PARENTS), 0)
    with pytest.raises(GenerationError, match="processes"):
        generate(BoxLearner(PARENTS), 5, processes=0)

    def stop(_share: float, _describe_targets: str) -> None:
        raise Cancelled("enough")

    with pytest.raises(Cancelled):
        generate(BoxLearner(PARENTS), 5, on_progress=stop)


def test_parents_that_are_no_bodies_are_refused() -> None:
    from dataclasses import replace

    lost = PARENTS.centers.copy()
    lost[:, 0] = 100.0
    with pytest.raises(GenerationError, match="0 of the 12 parents"):
        generate(BoxLearner(replace(PARENTS, centers=lost)), 5)


def test_what_rays_miss_is_made_up(monkeypatch) -> None:
    """Rays blind to circularity, candidates that differ more in it: the exact ones follow all the same."""

    class Wide(BoxLearner):
        def sample(self, count, seed=0):
            drawn = super().sample(count, seed)
            body, template = drawn.serialization, drawn.serialization.template
            wide = template.log_weights + 5.0 * (body.log_weights - template.log_weights)
            return replace(drawn, serialization=replace(body, log_weights=wide))

    learner = Wide(boxes(60, np.random.default_rng(4)))
    place = STAR_FACTORS.index("circularity")

    def blunt(control):
        found = star_factors(control)
        found[place] = 0.92 + 0.01 * np.sin(1e6 * found[0])
        return found

    def by_rays(bodies, labels, *, name="clones", **_):
        """Measure as well as sharp rays do, which is quick."""
        table = np.array([star_factors(body.control) for body in bodies])
        columns = {factor: table[:, i] for i, factor in enumerate(STAR_FACTORS)}
        empty = ("",) * len(table)
        return Population(name, "clones", np.array(labels), columns, "mm", "obb", "avatar", empty, empty)

    monkeypatch.setattr("mbstudio.core.vae.generate.candidates.star_factors", blunt)
    monkeypatch.setattr("mbstudio.core.vae.generate.generator.measure_population", by_rays)
    errors = {}
    for rounds in (0, 3):
        monkeypatch.setattr("mbstudio.core.vae.generate.generator._CORRECTIONS", rounds)
        found = generate(learner, 40, 2)
        errors[rounds] = compare(found.parent_factors, found.factors, ["circularity"])["circularity"]
    assert errors[3].deviation_error < 5.0 < errors[0].deviation_error
    assert errors[3].mean_error < 0.3
