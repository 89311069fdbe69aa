"""Trials: kinds of grains packed with several seeds, watched, measured, and kept as plain arrays."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbstudio.core.errors import Cancelled, MbstudioError, PackingError
from mbstudio.core.packing.comparing import compare_packings
from mbstudio.core.packing.packer import pack
from mbstudio.core.packing.trial import Findings, run_trial
from mbstudio.core.packing.trial_file import build_trial, trial_arrays, trial_entries


@pytest.fixture(scope="session")
def trial(grains):
    """Parents and spheres of their volumes, two small packings of each."""
    groups = {"parents": grains}
    return run_trial(groups, 20, seeds=2, seed=4, with_spheres=True, inset=0.4, spheres=6, processes=1)


def test_a_trial_packs_each_kind_with_each_seed_and_compares(trial, kinds, settled):
    assert list(trial.packings) == ["parents", "spheres"]
    assert np.array_equal(trial.first.poses.positions, settled.poses.positions)  # the same seed
    assert [clump.radii.size for clump in trial.packings["spheres"].kinds.clumps] == [1, 1, 1]
    assert trial.packings["spheres"].kinds.volumes == pytest.approx(kinds.volumes)
    both = [pack(kinds, 20, seed=seed) for seed in (4, 5)]
    by_hand = compare_packings({"parents": both, "others": both}, inset=0.4)
    assert trial.comparison.means["parents"] == by_hand.means["parents"]
    assert [one.second for one in trial.comparison.differences] == ["spheres"] * 3


def test_a_packing_is_watched_as_it_settles_and_ends_as_the_last_frame(kinds):
    frames, shares = [], []
    made = pack(kinds, 5, seed=1, watch=frames.append, progress=lambda share, _: shares.append(share))
    heights = [frame.poses.positions[:, 2].mean() for frame in frames]
    assert len(frames) > 20
    assert heights[0] > 1.5 * heights[-1]
    assert all(frame.kinds is kinds for frame in frames)
    assert np.allclose(np.linalg.norm(frames[3].poses.quaternions, axis=1), 1)
    assert np.abs(frames[-1].poses.positions - made.poses.positions).max() < 0.01 * made.mean_diameter
    assert shares == sorted(shares)


def test_who_watches_can_end_it(kinds):
    def stop(_frame):
        raise Cancelled("enough")

    with pytest.raises(Cancelled):
        pack(kinds, 5, seed=1, watch=stop)


def test_findings_are_those_of_the_packing(settled):
    found = Findings.of(settled, 0.4)
    assert found.summary["porosity"] == found.measures.porosity == settled.measures(0.4).porosity
    assert len(found.heights) == len(found.by_height)
    assert (found.by_height[found.heights < 2 * settled.mean_diameter] < 1).all()
    assert np.array_equal(found.rose, settled.rose(0.4, 9))


def test_a_trial_is_the_same_after_a_round_trip(trial):
    entries = json.loads(json.dumps(trial_entries(trial)))
    again = build_trial(entries, trial_arrays(trial))
    assert again.comparison == trial.comparison
    for name, packing in trial.packings.items():
        other = again.packings[name]
        assert other.history == packing.history
        assert (other.mould, other.friction, other.kinds.names) == (
            packing.mould, packing.friction, packing.kinds.names,
        )  # fmt: skip
        assert other.summary(0.4) == packing.summary(0.4)
        assert np.array_equal(other.poses.quaternions, packing.poses.quaternions)
        assert np.array_equal(other.found_contacts.forces, packing.found_contacts.forces)
        figures = [[clump.iou, clump.hausdorff] for clump in other.kinds.clumps]
        assert np.array_equal(figures, [[c.iou, c.hausdorff] for c in packing.kinds.clumps], equal_nan=True)


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("quaternions_0", lambda array: array * 1.1),
        ("grain_kinds_0", lambda array: array + 1),
        ("grain_kinds_0", lambda array: array.astype(float)),
        ("ends_0", lambda array: array[::-1]),
        ("clump_ends_0", lambda array: array + 1),
        ("pairs_0", lambda array: array + 19),
        ("positions_0", lambda array: array[:-1]),
        ("scales_0", lambda array: -array),
        ("weights_1", lambda array: 0 * array),
    ],
)
def test_arrays_of_no_packing_are_refused(trial, name, spoil):
    arrays = trial_arrays(trial)
    with pytest.raises(MbstudioError):
        build_trial(trial_entries(trial), {**arrays, name: spoil(arrays[name])})


@pytest.mark.parametrize(
    "spoil",
    [
        lambda entries: entries["kinds"][0].update(mould="bag"),
        lambda entries: entries["kinds"][0].update(half=-1.0),
        lambda entries: entries["means"].pop("parents"),
        lambda entries: entries["means"]["parents"].update(porosity=[0.4]),
        lambda entries: entries.update(inset=-1.0),
        lambda entries: entries.update(kinds=[]),
    ],
)
def test_entries_of_no_packing_are_refused(trial, spoil):
    entries = json.loads(json.dumps(trial_entries(trial)))
    spoil(entries)
    with pytest.raises(PackingError):
        build_trial(entries, trial_arrays(trial))


def test_too_few_grains_to_be_compared_are_told_at_the_first_packing(grains):
    told = []
    with pytest.raises(PackingError, match="has no inner part"):
        run_trial(
            {"parents": grains}, 5, seeds=3, spheres=6, processes=1, progress=lambda *one: told.append(one)
        )
    assert max(share for share, _ in told) < 0.5


@pytest.mark.parametrize(
    ("groups", "options", "match"),
    [({}, {}, "no avatars"), ({"parents": []}, {}, "no avatars"), (None, {"seeds": 0}, "at least 1 seed")],
)
def test_trials_of_nothing_are_refused(grains, groups, options, match):
    with pytest.raises(PackingError, match=match):
        run_trial({"parents": grains} if groups is None else groups, 5, **options)
