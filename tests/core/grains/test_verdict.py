"""The verdict on a segmentation: green where the scan bears the grains out, never where it does not."""

import json

import numpy as np
import pytest

import mbstudio as mb
from mbstudio.core.batch.segmenting import segment_in_process
from mbstudio.core.errors import SegmentationError
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.grains.judging import judge_labels
from mbstudio.core.grains.verdict import CRITERIA, RULES, SegmentationVerdict, likely_agreement
from mbstudio.core.scan import Scan
from mbstudio.core.scan.field_of_view import find_field_of_view
from mbstudio.core.units import VoxelSize
from tests.core.grains.degraded import CONTRAST, VOID, packed, scanned, scattered

SIZE = VoxelSize(10, 10, 10, "um")


def judged(grey, labels):
    return judge_labels(grey, labels.astype(np.int32), find_field_of_view(grey))


def found(truth, degraded=None, **settings):
    return mb.segment(Scan(scanned(truth, **(degraded or {})), SIZE), **settings)


def doubts(verdict):
    return {criterion.name for criterion in verdict.doubts}


@pytest.mark.parametrize(
    "degraded",
    [{}, {"noise": 0.5}, {"cupping": 0.4}, {"rings": 0.3}, {"toned": (0.4, 3.0)}],
    ids=["as it is", "noise", "cupping", "rings", "two tones"],
)
def test_good_grains_are_green(degraded):
    truth = packed(5)
    grains = found(truth, degraded)
    assert agreement(grains.labels, truth).f1 > 0.95
    assert grains.verdict.level == "green"
    assert grains.verdict.described == []


def test_grains_split_too_seldom_are_told():
    truth = packed(5)
    grains = found(truth, splitting=0.3)
    assert agreement(grains.labels, truth).f1 < 0.8
    assert "splitting_agreement" in doubts(grains.verdict)


@pytest.mark.parametrize("height", [0.1, 0.9])
def test_a_threshold_in_the_void_or_in_the_grains_is_told(height):
    truth = packed(5)
    grains = found(truth, {"noise": 0.2, "blur": 1.5}, threshold=VOID + height * CONTRAST)
    assert agreement(grains.labels, truth).f1 < 0.8
    assert grains.verdict.level != "green"


def test_the_pores_taken_for_grains_are_told():
    truth = packed(5)
    grains = found(truth, dark=True)
    assert "solidity" in doubts(grains.verdict)


def test_a_liquid_taken_for_grain_is_told():
    truth = scattered(0.02, 1)
    grey = scanned(truth, water=5.0)
    verdict = judged(grey, truth)
    assert "edges_inside" not in doubts(verdict)
    swollen = mb.segment(Scan(grey, SIZE), threshold=VOID + 0.25 * CONTRAST)
    assert "edges_inside" in doubts(swollen.verdict)


def test_a_liquid_between_the_grains_is_no_doubt():
    truth = scattered(0.1, 2)
    verdict = judged(scanned(truth, water=5.0), truth)
    assert verdict.phases == 3
    assert verdict.level == "green"


def test_faint_grains_that_were_missed_are_told():
    truth = packed(5)
    grey = scanned(truth, toned=(0.4, 0.3), noise=0.15)
    bright = np.where(np.isin(truth, np.unique(truth)[::3]), 0, truth)
    verdict = judged(grey, np.unique(bright, return_inverse=True)[1].reshape(truth.shape))
    assert verdict.level != "green"


def test_missing_grains_are_told():
    truth = packed(5)
    grey = scanned(truth)
    less = np.where(truth % 3 == 0, truth, 0)
    verdict = judged(grey, np.unique(less, return_inverse=True)[1].reshape(less.shape))
    assert doubts(verdict) & {"edges_outside", "surface_borne_out"}


def test_labels_beside_the_grains_are_told():
    truth = packed(5)
    grey = scanned(truth)
    assert judged(grey, truth).level == "green"
    beside = np.roll(truth, 8, axis=2)
    assert "surface_borne_out" in doubts(judged(grey, beside))


def test_noise_is_told():
    truth = packed(5)
    assert "contrast_to_noise" in doubts(judged(scanned(truth, noise=1.6), truth))


def test_grains_that_cannot_be_compared_are_not_green():
    truth = packed(5)[40:47]
    truth = np.unique(truth, return_inverse=True)[1].reshape(truth.shape)
    verdict = judged(scanned(truth), truth)
    assert verdict.figures["surface_compared"] == 0
    assert verdict.doubts[0].name == "surface_compared"
    assert verdict.level == "amber"


def test_small_grains_are_told():
    truth = packed(5)[::4, ::4, ::4]
    truth = np.unique(truth, return_inverse=True)[1].reshape(truth.shape)
    assert "median_diameter" in doubts(judged(scanned(truth, blur=0.4), truth))


def test_it_does_not_depend_on_dark_or_bright_nor_on_the_kind_of_numbers():
    truth = packed(5)
    grey = scanned(truth)
    plain = judged(grey, truth)
    turned = judged((60_000 - grey.astype(np.int64)).astype(np.uint16), truth)
    swapped = judged(grey.astype(">u2"), truth)
    for other in (turned, swapped):
        assert other.figures == pytest.approx(plain.figures, rel=1e-3, abs=1e-3)


def test_dropping_cut_grains_changes_no_verdict():
    truth = packed(5)
    whole, inner = found(truth), found(truth, drop_border=True)
    assert len(inner) < len(whole)
    assert inner.verdict == whole.verdict


def test_another_process_gives_the_same_verdict():
    scan = Scan(scanned(scattered(0.05, 1)), SIZE)
    assert segment_in_process(scan).verdict.figures == pytest.approx(
        mb.segment(scan).verdict.figures, abs=1e-4
    )


def test_labels_of_another_program_are_judged_by_their_scan():
    truth = packed(5)
    scan = Scan(scanned(truth), SIZE)
    assert mb.load_labels(truth, scan).verdict.level == "green"
    assert mb.load_labels(truth, voxel_size="10 um").verdict is None
    holes = scan.load().astype(np.float32)
    holes[40:43, 40:43, 40:43] = np.nan
    assert mb.load_labels(truth, Scan(holes, SIZE)).verdict is None


def test_a_verdict_survives_its_record():
    verdict = SegmentationVerdict({"solidity": 0.7, "contrast_to_noise": 3.0}, 2, "the whole box")
    record = json.loads(json.dumps(verdict.to_record()))
    assert record["level"] == "amber"
    assert [doubt["criterion"] for doubt in record["doubts"]] == ["solidity"]
    assert SegmentationVerdict.from_record(record) == verdict
    assert verdict.described[0].startswith("Median solidity: 0.7, should be 0.8 or more.")


@pytest.mark.parametrize(
    "record",
    [
        {},
        {"figures": [], "phases": 2},
        {"figures": {"solidity": "high"}, "phases": 2},
        {"figures": {"solidity": float("nan")}, "phases": 2},
        {"figures": {"beauty": 1.0}, "phases": 2},
    ],
)
def test_records_that_are_none_are_refused(record):
    with pytest.raises(SegmentationError, match=r"is none: find the grains again"):
        SegmentationVerdict.from_record({"rules": RULES, **record})


def test_a_verdict_by_other_rules_is_refused():
    record = SegmentationVerdict({"solidity": 0.9}, 2).to_record()
    assert SegmentationVerdict.is_readable(record)
    for other in ({**record, "rules": RULES - 1}, {name: record[name] for name in record if name != "rules"}):
        assert not SegmentationVerdict.is_readable(other)
        with pytest.raises(SegmentationError, match="other rules"):
            SegmentationVerdict.from_record(other)


def test_the_likely_agreement_follows_what_it_is_made_of():
    best = {
        "splitting_agreement": 1.0, "smooth_agreement": 1.0, "thin_agreement": 1.0, "unconvex_share": 0.0,
        "edge_sharpness": 0.4, "texture_of_void": 0.0,
    }  # fmt: skip
    worse = {
        "splitting_agreement": 0.5, "smooth_agreement": 0.5, "thin_agreement": 0.5, "unconvex_share": 0.5,
        "edge_sharpness": 0.3, "texture_of_void": 0.3,
    }  # fmt: skip
    assert likely_agreement(best) > 0.95
    for name, figure in worse.items():
        assert likely_agreement({**best, name: figure}) < likely_agreement(best) - 0.02, name
    assert likely_agreement(worse) < 0.6
    assert 0.0 <= likely_agreement(dict.fromkeys(best, 1e9)) <= 1.0


def test_the_likely_agreement_is_near_the_true_one():
    truth = packed(5)
    well, badly = found(truth), found(truth, splitting=0.3)
    assert well.verdict.figures["likely_agreement"] == pytest.approx(
        agreement(well.labels, truth).f1, abs=0.1
    )
    assert agreement(badly.labels, truth).f1 < 0.8
    assert badly.verdict.figures["likely_agreement"] < 0.82


@pytest.mark.parametrize("criterion", CRITERIA, ids=lambda criterion: criterion.name)
def test_levels_follow_their_limits(criterion):
    step = 1e-6 if criterion.is_high_good else -1e-6
    assert criterion.level_of(criterion.amber + step) == "green"
    assert criterion.level_of(criterion.amber - step) == "amber"
    assert criterion.level_of(criterion.red - step) == "red"
