from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import ProjectError
from mbstudio.core.project import FitSettings, ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.project.merging import merge_states
from mbstudio.core.vae.models.training import learn
from tests.core.project.conftest import make_fit
from tests.core.project.test_kept_table import grain
from tests.core.vae.boxes import boxes


@pytest.fixture
def base(state):
    return replace(state, kept=(grain("flat", (1.0,)), grain("round", (2.0,))))


@pytest.fixture
def again(tmp_path):
    """Return a state as another program finds it in the file: the same values, other objects."""

    def read(state):
        write_project(tmp_path / "sand.mbs", state)
        return read_project(tmp_path / "sand.mbs")

    return read


def test_nothing_new_changes_nothing(base, again):
    merge = merge_states(base, base, again(base))
    assert (sorted(merge.state.fits), merge.added, merge.in_both) == ([2, 7], 0, ())
    assert merge.state.kept == base.kept


def test_avatars_of_both_come_together(base, again, rng):
    ours = base.with_fits({11: make_fit(11, 4, rng)})
    theirs = again(base.with_fits({12: make_fit(12, 4, rng)}))
    merge = merge_states(base, ours, theirs)
    assert (sorted(merge.state.fits), merge.added, merge.in_both) == ([2, 7, 11, 12], 1, ())
    assert merge.state.fits[11] is ours.fits[11]
    assert merge.state.fits[12] is theirs.fits[12]
    assert merge.state.grains is base.grains


def test_what_one_has_changed_counts(base, again, rng):
    theirs = again(base.with_fits({2: make_fit(2, 9, rng)}))
    assert merge_states(base, base, theirs).state.fits[2].avatar.n == 9
    ours = base.with_fits({2: make_fit(2, 8, rng)})
    merge = merge_states(base, ours, again(base))
    assert (merge.state.fits[2].avatar.n, merge.in_both) == (8, ())


def test_of_a_grain_that_both_have_fitted_ours_is_kept_and_told(base, again, rng):
    ours, theirs = base.with_fits({2: make_fit(2, 8, rng)}), again(base.with_fits({2: make_fit(2, 9, rng)}))
    merge = merge_states(base, ours, theirs)
    assert (merge.state.fits[2].avatar.n, merge.in_both) == (8, (2,))
    assert merge_states(base, ours, again(ours)).in_both == ()


def test_what_was_removed_stays_away(base, again):
    without = replace(base, fits={7: base.fits[7]}, kept=base.kept[:1])
    assert sorted(merge_states(base, without, again(base)).state.fits) == [7]
    assert merge_states(base, without, again(base)).state.kept == base.kept[:1]
    assert sorted(merge_states(base, base, again(without)).state.fits) == [7]


def test_where_the_beginning_is_unknown_nothing_is_removed(base, again, rng):
    ours = replace(base, fits={7: base.fits[7]})
    merge = merge_states(None, ours, again(base.with_fits({12: make_fit(12, 4, rng)})))
    assert sorted(merge.state.fits) == [2, 7, 12]


def test_kept_grains_of_one_name_both_stay(base, again):
    ours = replace(base, kept=(*base.kept, grain("new", (3.0,))))
    theirs = again(replace(base, kept=(*base.kept, grain("new", (4.0,)))))
    merge = merge_states(base, ours, theirs)
    assert [kept.name for kept in merge.state.kept] == ["flat", "round", "new", "new 2"]
    assert merge.state.kept[3].recipe.latent == (4.0,)
    assert merge.added == 1


def test_settings_of_who_changed_them(base, again):
    theirs = again(replace(base, fit_settings=FitSettings(n=77)))
    assert merge_states(base, base, theirs).state.fit_settings.n == 77
    ours = replace(base, fit_settings=FitSettings(n=55))
    assert merge_states(base, ours, theirs).state.fit_settings.n == 55


def test_a_style_of_one_is_taken_and_of_both_refused(base, again):
    first, second = (learn(boxes(8, np.random.default_rng(seed)), "pca") for seed in (2, 3))
    theirs = again(replace(base, style=first))
    np.testing.assert_array_equal(merge_states(base, base, theirs).state.style.latents, first.latents)
    ours = replace(base, style=second)
    assert merge_states(base, ours, again(base)).state.style is second
    with pytest.raises(ProjectError, match="another style-learner"):
        merge_states(base, ours, theirs)


@pytest.mark.parametrize("change", ["labels", "grains"])
def test_other_grains_are_refused(base, again, change):
    if change == "labels":
        labels = base.grains.labels.copy()
        labels[0, 0, 0] = 2
        theirs = replace(base, grains=replace(base.grains, label_volume=labels))
    else:
        theirs = replace(base, grains=None, fits={})
    with pytest.raises(ProjectError, match="grains in the file are others"):
        merge_states(base, base, again(theirs))


def test_projects_without_grains_merge_too(again):
    ours = ProjectState(kept=(grain("one", (1.0,)),))
    merge = merge_states(ProjectState(), ours, again(ProjectState(kept=(grain("two", (2.0,)),))))
    assert [kept.name for kept in merge.state.kept] == ["one", "two"]
