from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.vae.generate.balancing import draw_balanced, inclusion
from mbstudio.core.vae.generate.selection import Moments, choose, novelty_rows


def test_tilting_a_gaussian_to_another_mean_is_the_exponential_tilt() -> None:
    # Of N(0, 1) the tilt to mean 0.4 is exp(0.4 x); with few taken of many no probability nears 1.
    x = np.random.default_rng(0).normal(size=20000)
    found = inclusion((x - 0.4)[:, None], 100)
    p = found.probabilities
    assert found.converged
    assert p.sum() == pytest.approx(100, abs=1e-4)
    assert p @ x / 100 == pytest.approx(0.4, abs=1e-5)
    slope = np.polyfit(x, np.log(p / (1 - p)), 1)[0]
    assert slope == pytest.approx(0.4, abs=0.03)


def test_probabilities_stay_below_one_where_few_candidates_fit() -> None:
    x = np.random.default_rng(1).normal(size=300)
    found = inclusion((x - 0.5)[:, None], 150)
    assert found.converged
    assert found.probabilities.min() > 0
    assert found.probabilities.max() < 1
    assert 150 < found.effective < 300


def test_what_no_subset_can_give_is_said() -> None:
    x = np.random.default_rng(2).uniform(0, 1, 200)
    assert not inclusion((x - 1.5)[:, None], 50).converged


def test_softness_meets_in_part_what_cannot_be_met() -> None:
    x = np.random.default_rng(2).uniform(0, 1, 200)
    found = inclusion((x - 1.5)[:, None], 50, softness=0.3)
    assert found.converged
    assert x @ found.probabilities / 50 > 0.6


def test_the_draw_keeps_the_sums_and_takes_each_as_often_as_asked() -> None:
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(400, 4))
    p = inclusion(rows - 0.1, 150).probabilities
    taken = draw_balanced(p, rows, rng)
    assert len(taken) == len(set(taken.tolist())) == 150
    # A plain draw would miss the mean by about 0.08; five undecided bodies of 150 miss less than 0.05.
    assert np.abs(rows[taken].mean(axis=0) - 0.1).max() < 0.05
    often = np.zeros(8)
    wanted = np.array([0.2, 0.5, 0.8, 0.5, 0.2, 0.3, 0.7, 0.8])
    for _ in range(1500):
        often[draw_balanced(wanted, np.empty((8, 0)), rng)] += 1
    assert np.abs(often / 1500 - wanted).max() < 0.05


def test_clones_have_the_moments_of_parents_that_were_drawn_otherwise() -> None:
    rng = np.random.default_rng(4)
    mix = np.eye(6) + 0.3
    parents = Moments.from_values(rng.normal(size=(300, 6)) @ mix + 5.0)
    candidates = rng.normal(size=(2500, 6)) @ (1.15 * np.eye(6) + 0.25) + 5.1
    found = choose(candidates, 1000, parents, np.random.default_rng(5))
    assert found is not None
    taken = candidates[found.rows]
    assert found.level == 0
    assert len(set(found.rows.tolist())) == 1000
    assert np.abs(taken.mean(axis=0) / parents.means - 1).max() < 0.002
    assert np.abs(taken.std(axis=0, ddof=1) / parents.deviations - 1).max() < 0.01
    plain = np.abs(np.corrcoef(candidates.T) - parents.correlations).max()
    assert np.abs(np.corrcoef(taken.T) - parents.correlations).max() < 0.3 * plain


def test_candidates_that_cannot_follow_are_taken_as_far_as_they_go() -> None:
    rng = np.random.default_rng(6)
    parents = Moments.from_values(rng.normal(size=(100, 6)) + 10.0)
    found = choose(rng.normal(size=(300, 6)) + 4.0, 100, parents, rng)
    assert found is not None
    assert found.level > 1
    assert len(found.rows) == 100


def test_clones_are_as_far_from_parents_as_these_from_each_other() -> None:
    rng = np.random.default_rng(7)
    parents = Moments.from_values(rng.normal(size=(100, 6)) + 10.0)
    among = rng.uniform(1.0, 2.0, 100)
    candidates, distances = rng.normal(size=(800, 6)) + 10.0, rng.uniform(0.8, 2.4, 800)
    found = choose(candidates, 250, parents, rng, novel=novelty_rows(distances, among))
    assert found is not None
    # Even draws have a median of 1.6; that of the parents is about 1.5.
    assert found.level == 0
    assert np.median(distances[found.rows]) == pytest.approx(np.median(among), abs=0.04)
    assert novelty_rows(distances, among[:20]).shape == (800, 0)
