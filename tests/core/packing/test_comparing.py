"""Whether two kinds of grains pack alike: means, errors, differences."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from mbstudio.core.errors import PackingError
from mbstudio.core.packing import comparing
from mbstudio.core.packing.comparing import Mean, compare_packings
from tests.core.packing.test_measures import cubic_packing


def test_a_mean_has_the_error_of_its_scatter():
    mean = Mean.of([1.0, 2.0, 3.0])
    assert (mean.value, mean.error) == (2.0, pytest.approx(1 / np.sqrt(3)))


def test_the_chance_is_that_of_welch():
    first, second = [0.41, 0.43, 0.42, 0.44], [0.45, 0.43, 0.46]
    expected = scipy.stats.ttest_ind(first, second, equal_var=False).pvalue
    assert comparing._chance(Mean.of(first), Mean.of(second)) == pytest.approx(expected)


def test_packings_that_differ_are_told_from_those_that_do_not(balls):
    dense = [cubic_packing(balls, pitch=pitch) for pitch in (0.9990, 0.9993, 0.9996)]
    loose = [cubic_packing(balls, pitch=pitch) for pitch in (1.05, 1.051, 1.052)]
    found = compare_packings({"dense": dense, "loose": loose, "again": dense})
    far, same = found.difference("porosity", "loose"), found.difference("porosity", "again")
    assert far.differs
    assert far.value == pytest.approx(np.pi / 6 * (1 - 1 / 1.051**3), abs=0.05)
    assert far.value > 0.03
    assert not same.differs
    assert same.within_an_error
    assert found.difference("coordination", "loose").chance == 0.0
    assert found.as_dict()["groups"]["dense"]["coordination"]["mean"] == 6.0


def test_avatars_are_packed_with_several_seeds(balls, monkeypatch, grains):
    made: list[tuple[int, dict]] = []

    def fake(kinds, seed, progress, **options):
        made.append((seed, options))
        progress(1.0, "done")
        return cubic_packing(balls, pitch=0.999 + 1e-4 * seed)

    monkeypatch.setattr(comparing, "pack", fake)
    told: list[float] = []
    found = compare_packings(
        {"grains": grains}, seeds=2, with_spheres=True, spheres=4, count=9, friction=0.3, processes=1,
        progress=lambda share, _message: told.append(share),
    )  # fmt: skip
    assert [seed for seed, _ in made] == [0, 1, 0, 1]
    assert all(options["count"] == 9 for _, options in made)
    assert list(found.means) == ["grains", "spheres"]
    assert told == sorted(told)


@pytest.mark.parametrize(
    ("groups", "words"), [({"one": 1}, "needs two groups"), ({"one": 1, "two": 2}, "needs at least 2 seeds")]
)
def test_too_few_packings_are_no_comparison(balls, groups, words):
    packings = {name: [cubic_packing(balls)] * count for name, count in groups.items()}
    with pytest.raises(PackingError, match=words):
        compare_packings(packings)


def test_a_group_called_spheres_is_not_lost(balls):
    with pytest.raises(PackingError, match="called 'spheres'"):
        compare_packings({"stones": balls, "spheres": balls}, with_spheres=True)
