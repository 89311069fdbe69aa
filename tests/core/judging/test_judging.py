from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from mbstudio.core.errors import Cancelled, GenerationError
from mbstudio.core.judging import comparing, forest, judging
from mbstudio.core.judging.comparing import Sample, compare_samples, permute_kinds
from mbstudio.core.judging.features import FEATURE_SETS, FEATURES
from mbstudio.core.judging.judgement import Area, SetResult
from mbstudio.core.judging.judging import CLONES, FITS_OF_BOTH, FITS_PAIRED, FITS_UNPAIRED, HALVES, judge
from mbstudio.core.judging.likeness import radii_correlations
from tests.core.judging.bodies import drawn, made_up

PLACE = {kind.name: place for place, kind in enumerate(FEATURES)}


def bodies(count: int, seed: int, **shifts: float) -> list:
    """Return made-up features, independent of each other, with shifts in standard deviations."""
    rng = np.random.default_rng(seed)
    values = np.exp(0.2 * rng.standard_normal((count, len(FEATURES))))
    for name, shift in shifts.items():
        values[:, PLACE[name]] *= np.exp(0.2 * shift)
    return [
        dataclasses.replace(made_up(row), log_radii=0.1 * rng.standard_normal(144)) for row in values
    ]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _fewer_repeats():
    """Repeat and permute less: what is tested are not the last digits."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            comparing, "_CLASSIFIERS",
            tuple((word, scorer, 3, 12) for word, scorer, _, _ in comparing._CLASSIFIERS),
        )  # fmt: skip
        patch.setattr(forest, "TREES", 30)
        yield


@pytest.fixture(scope="module")
def true() -> list:
    return bodies(24, 1)


@pytest.fixture(scope="module")
def judged(true):
    """Clones more convex than true grains by four standard deviations, two of each of twelve parents."""
    clones = bodies(24, 2, convexity=4.0)
    fits = [*bodies(23, 3, band_17=-6.0), None]
    told: list[float] = []
    found = judge(
        true, clones, clone_parents=[*range(12), *range(12)], fits_of_true=fits,
        fits_of_clones=bodies(24, 4, band_17=-6.0), progress=lambda share, _words: told.append(share),
    )  # fmt: skip
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)
    return found


def test_what_differs_is_told_and_the_rest_is_not(judged):
    found = judged[CLONES]
    assert found["convexity and roughness"].logistic.value > 0.9
    assert found["convexity and roughness"].verdict == "told apart"
    assert judged.is_told_apart
    for name in ("edge angles", "form"):
        assert abs(found[name].logistic.value - 0.5) < 3.0 * found[name].logistic.error
    assert found["all"].numbers == (24, 24)
    assert found.groups == (24, 12)
    assert all(0.52 < row.logistic.chance < 0.9 for row in found.results)
    assert all(0.0 < row.logistic.error < 0.25 for row in found.results)


def test_halves_of_true_grains_stand_beside(judged):
    halves = judged[HALVES]
    assert halves.numbers == (12, 12)
    assert not any(row.is_told_apart for row in halves.results)
    assert halves["all"].logistic.error > 0.05


def test_fits_stand_beside(judged):
    assert judged[FITS_PAIRED]["bands 2-20"].logistic.value > 0.95
    assert judged[FITS_PAIRED]["bands 2-12"].logistic.value < 0.8
    assert judged[FITS_PAIRED].numbers == (24, 23)
    assert judged[FITS_UNPAIRED]["bands 2-20"].logistic.value > 0.8
    assert judged[FITS_OF_BOTH]["bands 2-20"].logistic.value < 0.8


def test_drifts_are_in_deviations_of_true_grains(judged):
    drifts = {row.feature: row for row in judged.drifts}
    assert drifts["convexity"].drift == pytest.approx(5.0, abs=3.0)
    assert drifts["convexity"].drift > 5 * drifts["convexity"].error
    assert drifts["convexity"].ks > 0.8 > drifts["convexity"].ks_floor[1]
    assert abs(drifts["il"].drift) < 4 * drifts["il"].error
    assert 0.1 < drifts["il"].error < 0.6
    assert drifts["il"].ks_floor[0] < drifts["il"].ks_floor[1]


def test_a_judgement_is_a_table_and_plain_values(judged):
    table = judged.table()
    assert set(table["comparison"]) == {item.name for item in judged.comparisons}
    assert len(table) == sum(len(item.results) for item in judged.comparisons)
    assert list(judged.drift_table()["feature"]) == [kind.name for kind in FEATURES]
    plain = json.loads(json.dumps(judged.as_dict()))
    assert plain["comparisons"][0]["results"][0]["verdict"] in (
        "told apart",
        "not told apart, within the error",
    )


def test_the_same_seed_gives_the_same_numbers(true):
    samples = [Sample(np.array([body.values for body in some]), tuple(groups)) for some, groups in (
        (true[:12], range(12)), (true[12:], range(12, 24)),
    )]  # fmt: skip
    one, same, other = (compare_samples("n", "t", *samples, seed=seed)[0] for seed in (5, 5, 6))
    assert one == same
    assert one != other


def test_errors_hold_for_samples_of_one_kind():
    """What is called two standard errors must hold about nineteen times of twenty."""
    columns = np.array(FEATURE_SETS["form"])
    rng = np.random.default_rng(0)
    outside, low = 0, 0
    for number in range(40):
        values = np.zeros((60, len(FEATURES)))
        values[:, columns] = rng.standard_normal((60, len(columns)))
        first, second = Sample(values[:30], tuple(range(30))), Sample(values[30:], tuple(range(30, 60)))
        found, _ = comparing._area_of(
            first, second, columns, comparing.score_by_logistic, 4, 30, np.random.default_rng(number), None
        )
        outside += abs(found.value - 0.5) > 1.96 * found.error
        low += found.value < 0.5
    assert outside <= 5
    assert 8 <= low <= 32


def test_permuting_keeps_relatives_together():
    groups = np.array([0, 1, 2, 3, 0, 0, 0, 4, 4, 5])
    kinds = np.array([True] * 4 + [False] * 6)
    changed = 0
    for seed in range(20):
        rows, permuted = permute_kinds(kinds, groups, np.random.default_rng(seed))
        own = groups[rows]
        assert np.bincount(own).tolist() == [2, 1, 1, 1, 1, 1]
        assert permuted[own == 0].sum() == 1
        assert permuted.sum() == 4
        changed += (permuted != kinds[rows]).any()
    assert changed > 15


def test_the_rule_is_one_sided():
    def result(value, error=0.05, chance=0.6):
        return SetResult("form", (20, 20), Area(value, error, chance), Area(0.5, 0.05, 0.6))

    assert result(0.65).verdict == "told apart"
    assert result(0.57).verdict == result(0.2).verdict == result(0.59, 0.01).verdict
    assert result(0.57).verdict == "not told apart, within the error"


def test_likeness_knows_copies_and_sources():
    rng = np.random.default_rng(0)
    true = [dataclasses.replace(body, log_radii=0.1 * rng.standard_normal(144)) for body in bodies(12, 1)]
    clones = [
        dataclasses.replace(body, log_radii=body.log_radii + 0.01 * rng.standard_normal(144)) for body in true
    ]
    found = judging.find_likeness(true, range(12), clones, range(12), true, range(12))
    assert found.copies == 1.0
    assert found.distance[1] == pytest.approx(0.01, rel=0.1)
    assert found.distance[0] > 0.1
    assert found.source_correlation > 0.99 > found.correlation[0]
    assert radii_correlations(true[0].log_radii[None], true[0].log_radii[None]) == pytest.approx(1.0)
    unknown = judging.find_likeness(true, range(12), clones, None, true, range(12))
    assert np.isnan(unknown.source_distance)


def test_missing_features_are_told_and_left_out(true):
    clones = bodies(24, 2)
    for body in clones[:4]:
        body.values[PLACE["band_3"]] = np.nan
    notes: list[str] = []
    judging._note_bodies("clones", clones, notes)
    assert "4 lack" in notes[0]
    assert "band_3" in notes[0]
    samples = [
        judging._Bodies(some, list(range(start, start + 24))).sample()
        for some, start in ((true, 0), (clones, 50))
    ]
    found, _, _ = compare_samples("n", "t", *samples, 0, nulls={})
    assert found["form"].numbers == (24, 24)
    assert found["all"].numbers == found["bands 2-12"].numbers == (24, 20)
    for body in clones[:20]:
        body.values[PLACE["band_3"]] = np.nan
    samples[1] = judging._Bodies(clones, list(range(50, 74))).sample()
    found, _, told = compare_samples("n", "t", *samples, 0, nulls={})
    assert [row.features for row in found.results] == [
        "curvature",
        "edge angles",
        "convexity and roughness",
        "form",
    ]
    assert len(told) == 3


def test_what_cannot_be_judged_is_refused(true):
    with pytest.raises(GenerationError, match="10 true grains and 10 clones, not 24 and 9"):
        judge(true, true[:9])
    with pytest.raises(GenerationError, match="all of one parent"):
        judge(true, bodies(20, 2), clone_parents=[3] * 20)
    with pytest.raises(GenerationError, match="of 4 parents only"):
        judge(true, bodies(20, 2), clone_parents=[0, 1, 2, 3] * 5)
    with pytest.raises(GenerationError, match="give one for each"):
        judge(true, bodies(20, 2), clone_parents=[0, 1])
    with pytest.raises(GenerationError, match="give one for each"):
        judge(true, bodies(20, 2), fits_of_true=bodies(3, 1))


def test_judging_can_be_cancelled(true):
    def stop(_share, _words):
        raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        judge(true, bodies(20, 2), progress=stop)


def test_unknown_parents_are_told():
    notes: list[str] = []
    grains = drawn(6, 0)
    assert judging._relatives_of(grains, None, grains, list("abcdef"), notes) == list("abcdef")
    assert "not known" in notes[0]
    alone = judging._relatives_of([grains[0]] * 12, None, grains, list("abcdef"), notes)
    assert len(set(alone)) == 12
    assert "flatters" in notes[1]
