"""Targets: read from words, reached with the fewest control points, and said so where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import FitError
from mbstudio.core.goals import Aim, SmallestNumber
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitGoal, fit, start_fit
from mbstudio.core.imaging.fast import fast
from mbstudio.core.imaging.fast.fast import FastFit
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import ellipsoid, grain_where

VOXEL = VoxelSize(1, 1, 1, "um")


@pytest.mark.parametrize(
    ("text", "aims", "most"),
    [
        ("volume 0.5 %", {"volume": 0.005}, 320),
        ("Volume 0.5% and hausdorff <= 2 %", {"volume": 0.005, "hausdorff": 0.02}, 320),
        ("iou 0.97, n 64", {"iou": 0.97}, 64),
        ("iou > 97 %; csf .02", {"iou": 0.97, "csf": 0.02}, 320),
        ("D_n 1 % and sneed folk 3% and rms 1e-2", {"dn": 0.01, "sneed_folk": 0.03, "rms": 0.01}, 320),
    ],
)
def test_targets_are_read_and_written(text: str, aims: dict[str, float], most: int) -> None:
    target = FitGoal.parse(text)
    assert {aim.measure: aim.limit for aim in target.aims} == pytest.approx(aims)
    assert target.most == most
    assert FitGoal.parse(str(target)) == target
    assert FitGoal.parse(target) is target


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("beauty 1 %", "'beauty', which is not known: use rms, hausdorff, iou, volume"),
        ("volume", "write a measure and its limit"),
        ("volume one percent", "write a measure and its limit"),
        ("volume 2", "write it as 'volume 1 %'"),
        ("volume 0 %", "write it as 'volume 1 %'"),
        ("iou 1.2", "between 0 and 1"),
        ("volume 1 % and volume 2 %", "names volume twice"),
        ("n 40", "no measure"),
        ("volume 1 % and n 2.5", "not a number of control points"),
        (" and ", "no measure"),
    ],
)
def test_what_is_no_target_is_refused(ellipsoid_grain: Grain, text: str, message: str) -> None:
    with pytest.raises(FitError, match=message):
        start_fit(ellipsoid_grain, target=text)


def test_what_is_met_and_how_far_off() -> None:
    overlap, error = Aim("iou", 0.96), Aim("dns", 0.02)
    assert overlap.is_met(0.96)
    assert not overlap.is_met(0.95)
    assert overlap.shortfall(0.88) == pytest.approx(3.0)
    assert error.is_met(-0.02)
    assert not error.is_met(0.021)
    assert error.shortfall(-0.05) == pytest.approx(2.5)
    for aim in (overlap, error):
        assert not aim.is_met(float("nan"))
        assert aim.shortfall(float("nan")) == float("inf")


@pytest.mark.parametrize(
    ("least", "most", "order"),
    [
        (1, 320, [10, 5, 2, 1]),
        (10, 320, [10, 5, 7, 8, 9]),
        (37, 320, [10, 20, 40, 30, 35, 37, 36]),
        (1000, 60, [10, 20, 40, 60]),
        (3, 4, [4, 2, 3]),
        (1, 1, [1]),
    ],
)
def test_numbers_are_doubled_then_bisected(least: int, most: int, order: list[int]) -> None:
    numbers, tried = SmallestNumber(most), []
    while (n := numbers.choose_next()) is not None:
        tried.append(n)
        numbers.record(n, will_do=n >= least)
    assert tried == order
    assert numbers.enough == (least if least <= most else None)


def test_a_ball_needs_one_control_point() -> None:
    ball = grain_where(ellipsoid(10.2, 10.2, 10.2), 13, VOXEL)
    result = fit(ball, target="volume 1 % and iou 0.97 and sphericity 1 %")
    assert (result.n, result.avatar.n) == (1, 1)
    assert result.verdict.valid
    assert not result.verdict.warnings
    assert result.target == "volume 1 % and iou 0.97 and sphericity 1 %"
    assert list(result.reached) == ["volume", "iou", "sphericity"]
    assert result.reached["volume"] < 0.01
    assert result.reached["iou"] >= 0.97


def test_the_number_found_will_do_and_that_before_it_will_not(angular_grain: Grain) -> None:
    notes: list[str] = []
    found = fit(angular_grain, target="rms 1.5 %", on_step=lambda step: notes.append(step.note))
    again = fit(angular_grain, found.n)
    np.testing.assert_array_equal(found.avatar.centers, again.avatar.centers)
    np.testing.assert_array_equal(found.history, again.history)
    assert again.verdict.rms / angular_grain.nominal_diameter == found.reached["rms"] <= 0.015
    before = fit(angular_grain, found.n - 1)
    assert before.verdict.rms / angular_grain.nominal_diameter > 0.015
    assert notes[0].startswith("n = 10; goal rms 1.5 %")
    told = [note for note in notes if "n = 10 missed the goal: rms" in note]
    assert len(told) == 1
    assert told[0].startswith("n = 20; ")
    assert all(note.startswith("n = ") for note in notes)


def test_a_target_out_of_reach_says_so(angular_grain: Grain) -> None:
    result = fit(angular_grain, target="hausdorff 0.1 % and volume 2 % and n 12")
    assert result.n == 12
    assert result.reached["hausdorff"] > 0.001
    (warning,) = result.verdict.warnings
    assert "was not reached: the best avatar, of n = 12, has hausdorff" in warning
    assert "volume" not in warning.partition("best avatar")[2]  # that was reached
    assert "More than 12 control points were not allowed" in warning
    assert "and n 24" in warning
    assert "does not resolve finer shape" in warning


def test_voxels_may_hold_too_few_control_points() -> None:
    speck = Grain(np.ones((3, 4, 4), bool), VOXEL)
    result = fit(speck, target="iou 0.999")
    (warning,) = [told for told in result.verdict.warnings if "was not reached" in told]
    assert "48 voxels hold" in warning
    assert "Scan with smaller voxels" in warning
    assert 1 <= result.n <= 48


def test_a_search_can_be_stopped_changed_and_continued(ellipsoid_grain: Grain) -> None:
    run = start_fit(ellipsoid_grain, target="hausdorff 0.01 % and n 20", generations=12)
    with pytest.raises(FitError):
        run.result()
    for step in run:
        if step.phase == "search" and step.generation == 2:
            break
    stopped = run.result()
    assert stopped.n == 10
    assert dict(stopped.reached) == {}
    assert "was stopped before the goal" in stopped.verdict.warnings[0]
    # From here on by hand: the target is given up.
    run.change_control_points(14)
    for _ in run:
        pass
    by_hand = run.result()
    assert (by_hand.n, by_hand.avatar.n, by_hand.target) == (14, 14, "")
    assert by_hand.verdict.warnings == ()
    run.more_generations(3)
    for _ in run:
        pass
    assert len(run.result().history) > len(by_hand.history)


def test_the_best_fit_can_go_on_when_the_search_has_ended(ellipsoid_grain: Grain) -> None:
    run = start_fit(ellipsoid_grain, target="rms 5 %", generations=8)
    for _ in run:
        pass
    ended = run.result()
    run.more_generations(2)
    first = next(run)
    assert first.avatar.n == ended.avatar.n
    assert run.result().n == ended.n


def test_the_paper_method_takes_targets(ellipsoid_grain: Grain) -> None:
    result = fit(
        ellipsoid_grain, method="paper", target="volume 4 %", generations=60, hull_points=800,
        clustering="incremental",
    )  # fmt: skip
    assert result.method == "paper"
    assert result.reached["volume"] <= 0.04


class Failing(FastFit):
    """Fits that fail with up to so many control points."""

    fails_up_to = 0

    def _begin_at(self, control: np.ndarray) -> float:
        if self.n <= self.fails_up_to:
            raise FitError("The equations of the search cannot be solved.")
        return super()._begin_at(control)


def test_a_number_that_cannot_be_fitted_does_not_end_the_search(ellipsoid_grain, monkeypatch) -> None:
    monkeypatch.setattr(fast, "FastFit", Failing)
    monkeypatch.setattr(Failing, "fails_up_to", 13)
    notes: list[str] = []
    found = fit(
        ellipsoid_grain, target="rms 5 %", on_step=lambda step: notes.append(step.note), generations=5
    )
    assert found.n == 14
    assert any("n = 10 could not be fitted: The equations of the search" in note for note in notes)
    monkeypatch.setattr(Failing, "fails_up_to", 50)
    with pytest.raises(FitError, match="equations of the search cannot be solved"):
        fit(ellipsoid_grain, target="rms 5 % and n 40", generations=5)
