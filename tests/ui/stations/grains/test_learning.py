"""Strokes, previews and finding anew at station Grains, by mouse and keys."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

import mbstudio as mb
from mbstudio.core.grains import SegmentationSettings
from mbstudio.core.grains.classifying import Stroke
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.project import Project
from mbstudio.core.units import VoxelSize
from mbstudio.ui.stations.grains.learning.slice_preview import KIND_COLOURS
from tests.core.grains.degraded import scanned, scattered
from tests.core.grains.editing.placed_grains import ORIGIN, SIZE, placed_grains, scan_of
from tests.core.project.conftest import make_fit
from tests.ui.conftest import PATIENCE

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def truth():
    return scattered(0.2, 3, 56)


@pytest.fixture
def at_scan(window, idle, truth):
    """The window at station Grains, with a scan of balls and no grains yet."""
    scan = mb.Scan(scanned(truth, seed=3), VoxelSize(10, 10, 10, "um"))
    window.workspace.replace_project(Project.new(scan, embed_scan=True))
    window.workspace.give_scan(scan)
    window.studio.enter("grains")
    window.resize(1500, 900)
    idle()
    return window


@pytest.fixture
def settled(qtbot, window):
    """Wait until all workers of the station are done and what they found is shown."""

    def wait():
        station = window.stations.grains
        workers = (station.painting.worker, station.preview.worker, station.preview_link.counter)

        def all_idle():
            return all(worker.is_idle for worker in workers) and window.queue.is_idle

        qtbot.waitUntil(all_idle, timeout=PATIENCE)
        QTest.qWait(20)
        qtbot.waitUntil(all_idle, timeout=PATIENCE)

    return wait


def choose_kind(window, kind):
    field = window.stations.grains.panel.threshold_kind
    field.setCurrentIndex(field.findData(kind))


def press(window, key, modifier=Qt.KeyboardModifier.NoModifier):
    QTest.keyClick(window, key, modifier)
    QTest.qWait(20)


def draw(window, axis, start, end):
    """Draw a straight stroke in a pane, from one voxel (column, row) to another."""
    pane = window.slice_views.panes.panes[axis]
    places = [
        pane.place_of(*(a + share * (b - a) for a, b in zip(start, end, strict=True))).toPoint()
        for share in (0.0, 0.5, 1.0)
    ]
    QTest.mousePress(pane, LEFT, pos=places[0])
    for place in places[1:]:
        QTest.mouseMove(pane, place)
    QTest.mouseRelease(pane, LEFT, pos=places[-1])
    QTest.qWait(20)


def spots(truth, z, wanted):
    """Return places (x, y) well inside grains of a slice, or well inside the void."""
    from scipy import ndimage

    inside = ndimage.binary_erosion((truth[z] > 0) == wanted, iterations=3)
    places = np.argwhere(inside)
    return [(int(x), int(y)) for y, x in places[:: max(1, len(places) // 6)][:6]]


def paint_both(window, truth):
    z = window.view.scene.layers.slices.planes.index["z"]
    press(window, Qt.Key.Key_1)
    for place in spots(truth, z, True):
        draw(window, "z", place, place)
    press(window, Qt.Key.Key_2)
    for place in spots(truth, z, False):
        draw(window, "z", place, place)


def test_strokes_teach_a_classifier_that_finds_the_grains(at_scan, settled, truth):
    space, station = at_scan.workspace, at_scan.stations.grains
    choose_kind(at_scan, "classifier")
    paint_both(at_scan, truth)
    settled()
    strokes = space.state.strokes
    assert {stroke.kind for stroke in strokes} == {"grain", "void"}
    assert all(stroke.axis == 0 for stroke in strokes)
    learned = mb.VoxelClassifier.learned(space.scan, strokes)
    for name, array in learned.arrays.items():
        assert np.array_equal(space.state.classifier.arrays[name], array)
    assert "voxels painted" in station.learning_box.told.text()
    assert all(at_scan.slice_views.panes.panes[axis].is_tinted for axis in "xyz")
    press(at_scan, Qt.Key.Key_Escape)
    assert at_scan.view.slice_tool is None
    station.panel.smallest.setValue(100)
    press(at_scan, Qt.Key.Key_G, Qt.KeyboardModifier.ControlModifier)
    settled()
    found = mb.segment(space.scan, classifier=learned, smallest_voxels=100)
    assert np.array_equal(space.state.grains.labels, found.labels)
    assert space.state.segmentation.by_classifier


def test_strokes_are_undone_one_by_one_and_the_classifier_with_them(at_scan, settled, truth):
    space = at_scan.workspace
    choose_kind(at_scan, "classifier")
    paint_both(at_scan, truth)
    settled()
    learned, count = space.state.classifier, len(space.state.strokes)
    draw(at_scan, "y", (20, 20), (24, 24))
    settled()
    assert space.state.classifier is not learned
    assert space.state.strokes[-1].axis == 1
    press(at_scan, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    settled()
    assert len(space.state.strokes) == count
    assert np.array_equal(space.state.classifier.forest.threshold, learned.forest.threshold)
    for _ in range(count):
        press(at_scan, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    settled()
    assert space.state.strokes == ()
    assert space.state.classifier is None


def test_a_stroke_is_seen_while_it_is_drawn(at_scan):
    choose_kind(at_scan, "classifier")
    press(at_scan, Qt.Key.Key_4)
    pane = at_scan.slice_views.panes.panes["z"]
    QTest.mousePress(pane, LEFT, pos=pane.place_of(20, 30).toPoint())
    assert tuple(at_scan.view.tints["z"][30, 20, :3]) == KIND_COLOURS["border"]
    assert at_scan.workspace.state.strokes == ()
    QTest.mouseRelease(pane, LEFT, pos=pane.place_of(20, 30).toPoint())
    assert [stroke.kind for stroke in at_scan.workspace.state.strokes] == ["border"]


def test_one_kind_alone_is_told_and_nothing_is_learned(at_scan, settled, truth):
    choose_kind(at_scan, "classifier")
    press(at_scan, Qt.Key.Key_1)
    draw(at_scan, "z", spots(truth, 28, True)[0], spots(truth, 28, True)[0])
    settled()
    assert "paint some void" in at_scan.stations.grains.learning_box.told.text()
    assert at_scan.workspace.state.classifier is None
    press(at_scan, Qt.Key.Key_G, Qt.KeyboardModifier.ControlModifier)
    settled()
    assert at_scan.workspace.state.grains is None
    assert "Paint strokes" in at_scan.messages.text


def test_keys_of_strokes_count_only_where_strokes_are_learned_from(at_scan):
    choose_kind(at_scan, "")
    press(at_scan, Qt.Key.Key_1)
    assert at_scan.view.slice_tool is None
    choose_kind(at_scan, "classifier")
    press(at_scan, Qt.Key.Key_1)
    assert at_scan.view.slice_tool is at_scan.stations.grains.painting
    choose_kind(at_scan, "threshold")
    assert at_scan.view.slice_tool is None


def test_a_classifier_is_saved_and_loaded(at_scan, settled, truth, tmp_path):
    space, painting = at_scan.workspace, at_scan.stations.grains.painting
    choose_kind(at_scan, "classifier")
    paint_both(at_scan, truth)
    settled()
    learned = space.state.classifier
    painting.save(tmp_path / "sand.mbclf")
    space.change("none", strokes=(), classifier=None)
    painting.load(tmp_path / "sand.mbclf")
    settled()
    assert np.array_equal(space.state.classifier.forest.threshold, learned.forest.threshold)
    assert space.state.strokes == ()
    assert at_scan.slice_views.panes.panes["z"].is_tinted
    (tmp_path / "bad.mbclf").write_bytes(b"nothing")
    painting.load(tmp_path / "bad.mbclf")
    assert at_scan.messages.level == "error"
    assert "bad.mbclf" in at_scan.messages.text


def test_the_threshold_is_shown_while_its_line_is_dragged(at_scan, settled):
    panel, space = at_scan.stations.grains.panel, at_scan.workspace
    choose_kind(at_scan, "threshold")
    settled()
    counts = panel.greys._bars.opts["height"]
    assert len(counts) == 128
    panel.greys.line.setPos(27_000.0)
    panel.greys.line.sigDragged.emit(panel.greys.line)
    settled()
    assert panel.threshold.value() == 27_000
    for axis in "zyx":
        shown = at_scan.view.tints[axis][..., 3] > 0
        settings = SegmentationSettings(threshold=27_000.0)
        mask = at_scan.stations.grains.preview._foreground.mask("zyx".index(axis), 28, settings)
        assert np.array_equal(shown, mask)
    panel.threshold.setValue(30_000)
    assert panel.greys.line.value() == 30_000
    settled()
    assert (at_scan.view.tints["z"][..., 3] > 0).sum() < mask.size
    fewer = (at_scan.view.tints["z"][..., 3] > 0).sum()
    panel.smoothing.setValue(3.0)
    settled()
    assert (at_scan.view.tints["z"][..., 3] > 0).sum() != fewer
    at_scan.view.move_slice("z", 10)
    settled()
    settings = panel.settings()
    mask = at_scan.stations.grains.preview._foreground.mask(0, 10, settings)
    assert np.array_equal(at_scan.view.tints["z"][..., 3] > 0, mask)
    at_scan.studio.enter("scan")
    assert not at_scan.view.tints
    assert space.state.grains is None


def test_the_splitting_is_previewed_about_the_crossing(at_scan, settled, truth):
    station = at_scan.stations.grains
    press(at_scan, Qt.Key.Key_P)
    settled()
    region = station.preview.region
    assert region.box == (slice(0, 56),) * 3
    assert region.count > 3
    assert np.array_equal(at_scan.view.tints["z"][..., 3] > 0, region.labels[28] > 0)
    before = region.count
    station.panel.splitting.set_value(1.0)
    settled()
    assert station.preview.region is not region
    assert station.preview.region.count >= before
    press(at_scan, Qt.Key.Key_P)
    assert not at_scan.view.tints
    assert at_scan.workspace.state.grains is None


@pytest.fixture
def fitted(window, idle, rng):
    """The window at station Grains, with placed grains and an avatar each."""
    scan = scan_of(placed_grains().labels)
    project = Project.new(scan, embed_scan=True)
    project.change("Find grains", grains=placed_grains())
    project.add_fits({label: make_fit(label, 4, rng) for label in (1, 2, 3, 4)})
    window.workspace.replace_project(project)
    window.workspace.give_scan(scan)
    window.studio.enter("grains")
    idle()
    return window


def found_instead(monkeypatch, labels):
    monkeypatch.setattr(
        "mbstudio.ui.stations.grains.work.segment_in_process",
        lambda *_, **__: build_grain_set(labels, SIZE, ORIGIN, None),
    )


def test_finding_anew_keeps_avatars_of_what_did_not_change(fitted, idle, monkeypatch):
    labels = np.array(placed_grains().labels)
    found_instead(monkeypatch, np.where(labels > 0, labels.max() + 1 - labels, 0).astype(np.int32))
    fits = dict(fitted.workspace.state.fits)
    fitted.workspace.select(2)
    told = []
    fitted.messages.shown.connect(lambda _level, text: told.append(text))
    press(fitted, Qt.Key.Key_G, Qt.KeyboardModifier.ControlModifier)
    idle()
    state = fitted.workspace.state
    assert {label: state.fits[label] for label in state.fits} == {
        int(labels.max()) + 1 - label: fit for label, fit in fits.items()
    }
    assert fitted.workspace.selected == labels.max() - 1
    assert "4 avatars stay" in told[-1]


def test_finding_anew_asks_before_it_discards(fitted, idle, monkeypatch):
    labels = np.array(placed_grains().labels)
    labels[labels == 3] = 0
    found_instead(monkeypatch, np.where(labels > 3, labels - 1, labels).astype(np.int32))
    assert "asked before" in fitted.stations.grains.panel._hint.text()
    before = fitted.workspace.state
    press(fitted, Qt.Key.Key_G, Qt.KeyboardModifier.ControlModifier)
    idle()
    assert fitted.workspace.state is before
    assert "1 of 4 avatars would be discarded" in fitted.messages.text
    fitted.messages._action.click()
    idle()
    state = fitted.workspace.state
    assert set(state.fits) == {1, 2, 3}
    assert state.fits[3] is before.fits[4]
    fitted.workspace.undo()
    assert fitted.workspace.state is before


def test_a_project_brings_its_strokes_back(at_scan, settled, truth, tmp_path, idle):
    choose_kind(at_scan, "classifier")
    paint_both(at_scan, truth)
    settled()
    at_scan.workspace.project.save(tmp_path / "sand.mbs")
    again = Project.open(tmp_path / "sand.mbs")
    assert again.state.strokes == at_scan.workspace.state.strokes
    assert isinstance(again.state.strokes[0], Stroke)
    assert again.state.classifier.entries == at_scan.workspace.state.classifier.entries
