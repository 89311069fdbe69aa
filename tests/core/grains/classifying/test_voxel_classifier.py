"""Learning from strokes: what is told, in which scans, and what is refused."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

import mbstudio as mb
from mbstudio.core.errors import (
    ClassifierError,
    MbstudioError,
    ScanError,
    SegmentationError,
    SegmentationWarning,
)
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.grains.classifying import Stroke, VoxelClassifier, load_classifier
from mbstudio.core.grains.classifying.features import features_in
from mbstudio.core.grains.classifying.grey_levels import GreyLevels
from mbstudio.core.grains.classifying.stroke import voxels_of
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.scan import Scan
from mbstudio.core.sealing import HEADER_BYTES
from mbstudio.core.units import VoxelSize
from tests.core.grains.classifying.simulated_strokes import paint_slices
from tests.core.grains.degraded import scanned, scattered

SIZE = VoxelSize(10, 10, 10, "um")


@pytest.fixture(scope="module")
def truth():
    return scattered(0.2, 3, 56)


@pytest.fixture(scope="module")
def scan(truth):
    return Scan(scanned(truth, seed=3), SIZE)


@pytest.fixture(scope="module")
def levels(scan):
    return GreyLevels.of(scan)


@pytest.fixture(scope="module")
def strokes(truth):
    return paint_slices(truth, 7, borders=0)


@pytest.fixture(scope="module")
def classifier(scan, strokes, levels):
    return VoxelClassifier.learned(scan, strokes, trees=12, levels=levels)


def test_features_do_not_depend_on_the_box_bit_by_bit(levels):
    whole = features_in(levels, (slice(0, 40), slice(10, 56), slice(0, 56))).reshape(40, 46, 56, -1)
    part = features_in(levels, (slice(7, 20), slice(11, 12), slice(30, 56)))
    assert np.array_equal(whole[7:20, 1:2, 30:56].reshape(part.shape), part)


def test_features_of_a_thin_scan_are_finite(rng):
    scan = Scan(rng.integers(0, 255, (2, 9, 70)).astype(np.uint8), VoxelSize(20, 10, 10, "um"))
    assert np.isfinite(features_in(GreyLevels.of(scan), (slice(0, 2), slice(0, 9), slice(0, 70)))).all()


def test_strokes_tell_grain_from_void(classifier, levels, truth):
    kinds = classifier.classified(levels)
    assert ((kinds > 0) == (truth > 0)).mean() > 0.97
    assert classifier.kinds == ("void", "grain")
    assert classifier.accuracy > 0.9


def test_neither_blocks_nor_threads_change_the_result(classifier, levels, monkeypatch):
    usual = classifier.classified(levels)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    assert np.array_equal(classifier.classified(levels, block=23), usual)


def test_the_same_seed_learns_the_same_trees(scan, strokes, levels, classifier):
    again = VoxelClassifier.learned(scan, strokes, trees=12, levels=levels)
    other = VoxelClassifier.learned(scan, strokes, trees=12, seed=1, levels=levels)
    for name, array in classifier.arrays.items():
        assert np.array_equal(again.arrays[name], array)
    assert not np.array_equal(other.forest.threshold, classifier.forest.threshold)


def test_classifying_is_told_of_and_can_be_cancelled(classifier, levels):
    told = []

    def cancel(share, _words):
        told.append(share)
        if len(told) == 3:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        classifier.classified(levels, progress=cancel, block=16)
    assert told == sorted(told)
    assert len(told) == 3
    assert not any(thread.name.startswith("classify") for thread in threading.enumerate())


def test_probabilities_of_a_slice_are_those_of_the_volume(classifier, levels):
    flat = classifier.probabilities(levels, (slice(20, 21), slice(0, 56), slice(0, 56)))
    block = classifier.probabilities(levels, (slice(0, 40), slice(0, 56), slice(0, 56)))
    assert np.array_equal(flat[0], block[20])
    assert np.allclose(flat.sum(axis=-1), 1, atol=1e-5)
    assert not flat[..., 2:].any()  # neither a mineral nor borders were painted


def test_grains_are_found_and_parted(scan, classifier, truth):
    grains = mb.segment(scan, classifier=classifier, smallest_voxels=100)
    assert agreement(grains.labels, truth).f1 > 0.9


def test_borders_part_grains_that_touch(scan):
    """Two blocks side by side: no neck to part them at but the painted border, which is darker."""
    labels = np.zeros((40, 40, 60), np.int32)
    labels[8:32, 8:32, 6:29], labels[8:32, 8:32, 31:54] = 1, 2
    grey = np.where(labels > 0, 200, 50)
    grey[8:32, 8:32, 29:31] = 140
    grey = (grey + np.random.default_rng(1).normal(0, 4, grey.shape)).astype(np.uint8)
    pressed = Scan(grey, SIZE)

    def line(kind, y, x, to):
        return Stroke(kind, ((20, y, x), (20, *to)), 1.0 if kind != "border" else 0.6, 0)

    painted = [
        line("void", 3, 5, (3, 50)), line("void", 36, 5, (36, 50)), line("grain", 12, 12, (28, 24)),
        line("grain", 10, 34, (28, 50)), line("border", 10, 29, (29, 29)), line("border", 10, 30, (29, 30)),
    ]  # fmt: skip
    borders = VoxelClassifier.learned(pressed, painted)
    without = VoxelClassifier.learned(pressed, [one for one in painted if one.kind != "border"])
    assert len(mb.segment(pressed, classifier=borders, splitting=0.3)) == 2
    assert len(mb.segment(pressed, classifier=without, splitting=0.3)) == 1
    found = mb.segment(pressed, classifier=borders, splitting=0.3).labels
    assert (found[12:28, 12:28, 29:31] > 0).mean() > 0.9  # borders go to the grains


def test_a_second_mineral_is_grain(truth):
    grey = scanned(truth, seed=5, toned=(0.5, 3.0))
    bright = np.array(ndimage_mean(grey, truth) > 38_000)
    scan = Scan(grey, SIZE)
    painted = paint_slices(truth, 8, borders=0, bright=bright)
    classifier = VoxelClassifier.learned(scan, painted, trees=12)
    kinds = classifier.classified(GreyLevels.of(scan))
    assert "mineral" in classifier.kinds
    assert (kinds[bright] == 2).mean() > 0.8
    assert ((kinds > 0) == (truth > 0)).mean() > 0.96


def ndimage_mean(grey, labels):
    """Return the mean grey value of each voxel's grain, 0 outside."""
    counts = np.bincount(labels.ravel())
    means = np.bincount(labels.ravel(), weights=grey.ravel()) / np.maximum(counts, 1)
    means[0] = 0
    return means[labels]


def test_another_grey_range_works(classifier, scan, levels):
    eight_bits = replace(scan, voxels=(scan.voxels // 256).astype(np.uint8))
    other = GreyLevels.of(eight_bits)
    classifier.require_fits(other, eight_bits)
    assert (classifier.classified(other) == classifier.classified(levels)).mean() > 0.99


def test_another_scan_of_the_kind_works(classifier):
    truth = scattered(0.1, 9, 56)
    scan = Scan(scanned(truth, seed=9), SIZE)
    grains = mb.segment(scan, classifier=classifier, smallest_voxels=100)
    assert agreement(grains.labels, truth).f1 > 0.85


def test_dark_grains_are_refused_where_bright_ones_were_learned(classifier, truth):
    turned = Scan(scanned(truth, seed=3, dark=True), SIZE)
    with pytest.raises(ClassifierError, match=r"learned from bright grains.*are dark|distributed otherwise"):
        mb.segment(turned, classifier=classifier)


def test_much_noise_is_refused_by_name(classifier, truth, tmp_path):
    noisy = Scan(scanned(truth, seed=3, noise=3.0), SIZE, path=tmp_path / "noisy.tif")
    with pytest.raises(ClassifierError, match=r"noisy\.tif are distributed otherwise"):
        mb.segment(noisy, classifier=classifier)


def test_another_voxel_size_is_told(classifier, scan):
    coarser = replace(scan, voxel_size=VoxelSize(14, 14, 14, "um"))
    with pytest.warns(SegmentationWarning, match="learned at voxels of"):
        classifier.require_fits(GreyLevels.of(coarser), coarser)


def test_a_constant_scan_is_refused(classifier):
    flat = Scan(np.full((30, 30, 30), 7, np.uint8), SIZE)
    with pytest.raises(ScanError, match="constant"):
        mb.segment(flat, classifier=classifier)
    with pytest.raises(ScanError, match="constant"):
        VoxelClassifier.learned(flat, [Stroke("grain", ((3, 3, 3),), 2)])


@pytest.mark.parametrize(
    ("kinds", "words"),
    [(("grain",), "paint some void"), (("void",), "paint some grain"), (("void", "border"), "some grain"),
     ((), "no strokes")],
)  # fmt: skip
def test_strokes_of_too_few_kinds_are_refused(scan, strokes, levels, kinds, words):
    painted = [one for one in strokes if one.kind in kinds]
    border = Stroke("border", ((20.0, 20.0, 20.0),), 3.0)
    painted += [border] if "border" in kinds else []
    with pytest.raises(ClassifierError, match=words):
        VoxelClassifier.learned(scan, painted, levels=levels)


def test_strokes_outside_the_scan_are_refused(scan, strokes, levels):
    with pytest.raises(ClassifierError, match=r"Stroke 1 \(grain\).*lies (beyond|outside)"):
        VoxelClassifier.learned(scan, [Stroke("grain", ((400, 3, 3),)), *strokes], levels=levels)


def test_strokes_outside_the_field_of_view_are_refused(truth):
    grey = scanned(truth, seed=3).copy()
    y, x = np.indices(truth.shape[1:])
    grey[:, np.hypot(y - 27.5, x - 27.5) > 26] = 0
    scan = Scan(grey, SIZE)
    painted = [Stroke("grain", ((20, 2, 2),), 2), Stroke("void", ((30, 53, 2),), 2)]
    with pytest.raises(ClassifierError, match="field of view"):
        VoxelClassifier.learned(scan, painted)


def test_the_last_stroke_counts_and_strokes_can_be_taken_away(scan):
    first = Stroke("grain", ((5, 5, 5), (5, 5, 15)), 1)
    indices, kinds = voxels_of([first, Stroke("void", ((5, 5, 5),), 1)], scan.shape, SIZE)
    assert kinds[indices == np.ravel_multi_index((5, 5, 5), scan.shape)].tolist() == [0]
    assert 1 in kinds
    left, _ = voxels_of([first, Stroke("", ((5, 5, 5), (5, 5, 15)), 3)], scan.shape, SIZE)
    assert not len(left)


def test_a_stroke_of_no_kind_is_refused():
    with pytest.raises(ClassifierError, match="'sand' is no kind"):
        Stroke("sand", ((1, 1, 1),))
    with pytest.raises(ClassifierError, match="finite"):
        Stroke("grain", ((1, 1, np.nan),))


def test_strokes_are_kept_as_records(strokes):
    assert [Stroke.from_record(one.to_record()) for one in strokes] == strokes
    for broken in ({}, {"kind": "grain", "centres": [[1, 2]]}, {**strokes[0].to_record(), "axis": 5}):
        with pytest.raises(ClassifierError):
            Stroke.from_record(broken)


# ---- files ---------------------------------------------------------------------------------------


def test_a_saved_classifier_tells_the_same(tmp_path, classifier, levels):
    path = classifier.save(tmp_path / "sand.mbclf")
    read = load_classifier(path)
    assert np.array_equal(read.classified(levels), classifier.classified(levels))
    assert read.entries == classifier.entries


def test_a_damaged_classifier_is_refused(tmp_path, classifier, rng):
    path = classifier.save(tmp_path / "sand.mbclf")
    whole = path.read_bytes()
    for place in rng.integers(0, len(whole), 40):
        changed = bytearray(whole)
        changed[place] ^= 4
        path.write_bytes(changed)
        with pytest.raises(ClassifierError, match=r"sand\.mbclf"):
            load_classifier(path)
    for content in (b"", whole[: HEADER_BYTES + 9], b"PK\3\4" + whole):
        path.write_bytes(content)
        with pytest.raises(ClassifierError, match="no classifier"):
            load_classifier(path)
    with pytest.raises(ClassifierError, match="does not exist"):
        load_classifier(tmp_path / "none.mbclf")


@pytest.mark.parametrize(
    ("entry", "value", "words"),
    [
        ("features", 99, "other features"),
        ("feature_names", ["grey"], "other features"),
        ("format", 99, "update mbstudio"),
        ("kind", "something", "no classifier"),
        ("kinds", ["void", "sand"], "damaged"),
        ("kinds", ["grain", "void"], "damaged"),
        ("voxels", [1], "damaged"),
        ("accuracy", "high", "damaged"),
        ("voxel_size_zyx", [0, 1, 1], "damaged"),
    ],
)
def test_entries_of_another_kind_are_refused(tmp_path, classifier, entry, value, words):
    from mbstudio.core.grains.classifying.classifier_file import write_classifier_file

    write_classifier_file(tmp_path / "x.mbclf", {**classifier.entries, entry: value}, classifier.arrays)
    with pytest.raises(ClassifierError, match=words):
        load_classifier(tmp_path / "x.mbclf")


def _with(arrays, name, place, value):
    changed = arrays[name].copy()
    changed[place] = value
    return {**arrays, name: changed}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("left", 0),
        ("right", 10**6),
        ("feature", 10**4),
        ("feature", -7),
        ("threshold", np.nan),
        ("starts", 5),
    ],
)
def test_trees_that_would_not_end_are_refused(tmp_path, classifier, name, value):
    from mbstudio.core.grains.classifying.classifier_file import write_classifier_file

    write_classifier_file(tmp_path / "x.mbclf", classifier.entries, _with(classifier.arrays, name, 0, value))
    with pytest.raises(ClassifierError, match="damaged"):
        load_classifier(tmp_path / "x.mbclf")


def test_a_classifier_and_a_threshold_are_not_both_taken(scan, classifier):
    for given in ({"threshold": 5.0}, {"ranges": (1.0, 2.0)}, {"dark": True}):
        with pytest.raises(SegmentationError, match="give one of them"):
            mb.segment(scan, classifier=classifier, **given)
    with pytest.raises(SegmentationError, match="give it"):
        mb.segment(scan, SegmentationSettings(by_classifier=True))


def test_another_process_finds_the_same(scan, classifier):
    from mbstudio.core.batch.segmenting import segment_in_process

    here = mb.segment(scan, classifier=classifier)
    there = segment_in_process(scan, classifier=classifier)
    assert np.array_equal(here.labels, there.labels)


def test_errors_are_those_of_mbstudio():
    assert issubclass(ClassifierError, MbstudioError)
