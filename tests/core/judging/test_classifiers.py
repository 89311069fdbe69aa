from __future__ import annotations

import numpy as np
import pytest
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import LogisticRegression

from mbstudio.core.judging.folds import FOLDS, area, area_error, assign_folds, held_out_wins
from mbstudio.core.judging.forest import TREES, score_by_forest
from mbstudio.core.judging.logistic import PENALTY, score_by_logistic


def two_kinds(count: int, shift: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    kinds = np.repeat([True, False], count)
    values = rng.standard_normal((2 * count, 6)) @ rng.standard_normal((6, 6))
    values[kinds, 2] += shift
    return values, kinds


def test_logistic_is_that_of_scikit_learn():
    values, kinds = two_kinds(40, 1.5)
    kinds[5:15] = False  # unequal kinds
    scaled = (values - values.mean(0)) / values.std(0)
    other = LogisticRegression(C=1 / PENALTY, class_weight="balanced", tol=1e-10, max_iter=5000)
    expected = other.fit(scaled, kinds).decision_function(scaled)
    assert score_by_logistic(values, kinds, values, 0) == pytest.approx(expected, abs=1e-4)


def test_a_constant_feature_teaches_nothing():
    values, kinds = two_kinds(20, 1.0)
    more = np.concatenate([values, np.full((40, 1), 7.0)], axis=1)
    strange = more.copy()
    strange[:, -1] = -1e6
    assert score_by_logistic(more, kinds, strange, 0) == pytest.approx(
        score_by_logistic(values, kinds, values, 0)
    )


def test_forest_is_as_good_as_that_of_scikit_learn():
    def other(train, kinds, held_out, seed):
        trees = ExtraTreesClassifier(TREES, min_samples_leaf=2, class_weight="balanced", random_state=seed)
        return trees.fit(train, kinds).predict_proba(held_out)[:, 1]

    rng = np.random.default_rng(1)
    values, kinds = two_kinds(100, 0.0, 1)
    values[kinds, 1] *= 3.0  # no line tells them apart
    groups = np.arange(200)
    ours, theirs = (
        area(*held_out_wins(values, kinds, groups, how, 1, rng)) for how in (score_by_forest, other)
    )
    assert theirs > 0.6
    assert ours == pytest.approx(theirs, abs=0.05)
    assert area(*held_out_wins(values, kinds, groups, score_by_logistic, 1, rng)) < theirs - 0.1


def test_a_forest_is_the_same_for_the_same_seed():
    values, kinds = two_kinds(30, 1.0)
    one, same, other = (score_by_forest(values, kinds, values, seed) for seed in (1, 1, 2))
    assert (one == same).all()
    assert (one != other).any()
    assert one[kinds].mean() > one[~kinds].mean()


def test_relatives_lie_in_one_fold_and_folds_are_alike():
    rng = np.random.default_rng(0)
    groups = np.concatenate([np.arange(40), np.repeat(np.arange(40, 60), 4)])
    kinds = np.arange(len(groups)) < 40
    folds = assign_folds(groups, kinds, rng)
    assert all(len(np.unique(folds[groups == group])) == 1 for group in range(60))
    assert np.bincount(folds[kinds]).tolist() == [8] * FOLDS
    assert np.bincount(folds[~kinds]).tolist() == [16] * FOLDS
    assert (assign_folds(groups, kinds, rng) != folds).any()


def test_grouped_folds_stop_the_leak_of_relatives():
    """Ten copies of each of ten bodies drawn alike: held out one by one they are known again."""
    rng = np.random.default_rng(3)
    made = np.repeat(rng.standard_normal((10, 8)), 10, axis=0) + 0.01 * rng.standard_normal((100, 8))
    values = np.concatenate([rng.standard_normal((100, 8)), made])
    kinds = np.repeat([True, False], 100)
    alone = np.arange(200)
    together = np.concatenate([np.arange(100), 100 + np.repeat(np.arange(10), 10)])
    leaking, honest = (
        area(*held_out_wins(values, kinds, groups, score_by_forest, 2, rng)) for groups in (alone, together)
    )
    assert leaking > 0.9
    assert honest < 0.75


def test_ties_are_half_a_win():
    wins, meetings = held_out_wins(
        np.zeros((40, 1)), np.repeat([True, False], 20), np.arange(40), score_by_logistic, 2,
        np.random.default_rng(0),
    )  # fmt: skip
    assert area(wins, meetings) == 0.5
    assert meetings.sum() == 2 * FOLDS * 4 * 4


def test_error_by_drawing_groups_grows_with_relatives():
    rng = np.random.default_rng(0)
    base = rng.random((12, 12))
    wins = np.kron((base > 0.4).astype(float), np.ones((4, 4)))
    meetings = np.ones_like(wins)
    alone, kin = np.arange(48), np.repeat(np.arange(12), 4)
    single = area_error(wins, meetings, alone, 48 + alone, rng)
    together = area_error(wins, meetings, kin, 12 + kin, rng)
    assert together > 1.3 * single
