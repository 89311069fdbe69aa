"""Kept grains: in the project and its file, undone and made again, and all the way to a DEM engine."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt
from PySide6.QtGui import QDrag, QDragEnterEvent, QDragMoveEvent, QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit

from mbstudio.core.dem.engines import find_engine
from mbstudio.core.project import Project
from mbstudio.core.vae.generate.generation import Counts, Generation
from tests.ui.conftest import PATIENCE
from tests.ui.hand import drag

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier


def keep(window, rest):
    window.stations.latent.panel.keep.click()
    rest()


def names(window):
    return [grain.name for grain in window.workspace.state.kept]


def test_keeping_renaming_and_removing_are_steps_of_undo(shaping, rest):
    window, work = shaping, shaping.stations.latent.work
    window.stations.latent.panel.randomise.click()
    keep(window, rest)
    keep(window, rest)
    assert names(window) == ["kept 1", "kept 2"] == window.stations.latent.shelf.kept.names
    window.stations.latent.shelf.kept.choose("kept 1")
    window.stations.latent.shelf.rename.click()
    editor = window.stations.latent.shelf.kept.findChild(QLineEdit)
    editor.setText("flat one")
    QTest.keyClick(editor, Qt.Key.Key_Return)
    rest()
    assert names(window) == ["flat one", "kept 2"] == window.stations.latent.shelf.kept.names
    assert not window.stations.latent.shelf.kept.item(0).icon().isNull()
    # A name that is taken is refused, and the gallery goes back to the old one.
    window.stations.latent.shelf.kept.item(1).setText("flat one")
    rest()
    assert names(window) == ["flat one", "kept 2"] == window.stations.latent.shelf.kept.names
    assert "already" in window.messages.text
    window.stations.latent.shelf.kept.choose("kept 2")
    window.stations.latent.shelf.remove.click()
    rest()
    assert names(window) == ["flat one"]
    where = work.stance.latent
    for expected in (["flat one", "kept 2"], ["kept 1", "kept 2"], ["kept 1"], []):
        assert window.commands.run("edit.undo")
        rest()
        assert names(window) == expected == window.stations.latent.shelf.kept.names
    np.testing.assert_array_equal(work.stance.latent, where)
    assert window.commands.run("edit.undo")  # the step before: the drawn grain
    assert work.stance.operations[-1].kind == "average"
    for _ in range(5):
        assert window.commands.run("edit.redo")
    rest()
    assert names(window) == ["flat one"]
    np.testing.assert_array_equal(work.stance.latent, where)
    assert not window.commands.run("edit.redo")


def test_what_was_undone_at_another_station_is_passed_over(shaping, rest):
    window, work = shaping, shaping.stations.latent.work
    window.stations.latent.panel.randomise.click()
    keep(window, rest)
    window.enter("scan")
    assert window.commands.run("edit.undo")
    assert names(window) == []
    window.enter("latent")
    # Undo goes on with the step of shaping; the style-learner stays.
    assert window.commands.run("edit.undo")
    rest()
    assert work.learner is not None
    assert work.stance.operations[-1].kind == "average"
    assert window.commands.run("edit.redo")
    assert window.commands.run("edit.redo")
    assert names(window) == ["kept 1"]


def test_kept_grains_come_back_with_their_project(shaping, rest, tmp_path, learner, meanings):
    window, work = shaping, shaping.stations.latent.work
    window.stations.latent.panel.another.click()
    rest()
    shown = work.grain
    keep(window, rest)
    assert window.workspace.is_modified
    path = tmp_path / "shaped.mbs"
    window.project_work.save(path)
    rest()
    window.project_work.new()
    rest()
    assert window.stations.latent.shelf.kept.names == []
    window.project_work.open(path)
    rest()
    window.enter("latent")
    rest()
    assert window.stations.latent.shelf.kept.names == ["kept 1"]
    assert not window.stations.latent.shelf.kept.item(0).icon().isNull()
    (recipe,) = work.kept
    np.testing.assert_array_equal(recipe.retrace(work.learner, meanings), shown.latent)
    work.begin_with("kept 1")
    rest()
    np.testing.assert_array_equal(work.grain.avatar.centers, shown.avatar.centers)
    np.testing.assert_array_equal(work.grain.avatar.weights, shown.avatar.weights)
    np.testing.assert_array_equal(work.grain.points, shown.points)
    keep(window, rest)
    assert names(window) == ["kept 1", "kept 2"]  # its number is not given again
    assert Project.open(path).state.kept[0].factors == pytest.approx(tuple(shown.values.values()), rel=1e-9)


def drag_and_drop(window, qtbot, strip, name, slot):
    """Drag a grain out of the gallery with the mouse and drop it on a slot."""
    strip.choose(name)
    strip.scrollToItem(strip.currentItem())
    start = strip.visualItemRect(strip.currentItem()).center()
    carried: list[QMimeData] = []

    def dropped(drag_object):
        """Send what the window system sends while the mouse wanders to the slot."""
        data = drag_object.mimeData()
        carried.append(data)
        copy, middle = Qt.DropAction.CopyAction, slot.rect().center()
        enter = QDragEnterEvent(middle, copy, data, LEFT, NONE)
        QApplication.sendEvent(slot, enter)
        assert enter.isAccepted()
        QApplication.sendEvent(slot, QDragMoveEvent(middle, copy, data, LEFT, NONE))
        QApplication.sendEvent(slot, QDropEvent(QPointF(middle), copy, data, LEFT, NONE))
        return copy

    with pytest.MonkeyPatch.context() as patch:
        # The modal loop of a real drag ends only with the window system's own events.
        patch.setattr(QDrag, "exec", lambda self, *_: dropped(self))
        QTest.mousePress(strip.viewport(), LEFT, NONE, start)
        for step in (4, 12, 24):
            QTest.mouseMove(strip.viewport(), start + QPoint(0, -step))
            QTest.qWait(5)
        QTest.mouseRelease(strip.viewport(), LEFT, NONE, start + QPoint(0, -24))
    assert carried


def test_three_grains_by_hand_settle_in_liggghts(shaping, rest, qtbot, tmp_path, learner):
    liggghts = find_engine("LIGGGHTS")
    if liggghts is None:
        pytest.skip("LIGGGHTS is not installed")
    window, blend, panel = shaping, shaping.stations.latent.dock.blend, shaping.stations.latent.panel
    # The first: a slider of a meaning under the mouse.
    window.stations.latent.dock.open_page("Factors")
    before = window.stations.latent.work.grain.values["csf"]
    drag(panel.meanings["csf"].slider, 0.5, 0.35, 0.2)
    rest()
    assert window.stations.latent.work.grain.values["csf"] < before - 0.02
    assert (
        f"{window.stations.latent.work.grain.values['csf']:.3f}"
        == window.stations.latent.dock.factors.value("csf")
    )
    keep(window, rest)
    # The second: half-way between two grains dragged from the gallery.
    window.stations.latent.dock.open_page("Blend")
    window.stations.latent.shelf.tabs.setCurrentIndex(0)
    rest()
    parents = learner.parents.names
    for letter, row in (("A", 3), ("B", 11)):
        drag_and_drop(window, qtbot, window.stations.latent.shelf.parents, parents[row], blend.slots[letter])
        rest()
        assert blend.slots[letter].grain == parents[row]
    drag(blend.share.slider, 0.1, 0.5)
    rest()
    assert window.stations.latent.work.stance.operations[-1].given["share"] == pytest.approx(0.5, abs=0.01)
    keep(window, rest)
    # The third: a latent variable.
    k = next(iter(panel.components))
    drag(panel.components[k].slider, 0.5, 0.7)
    rest()
    keep(window, rest)
    assert names(window) == ["kept 1", "kept 2", "kept 3"]
    window.enter("export")
    export = window.stations.export.panel
    export.selection.setCurrentIndex(export.selection.findData("kept"))
    export.target.setCurrentIndex(export.target.findData("liggghts"))
    export.folder.setText(str(tmp_path / "deck"))
    export.options.clumps.number.setValue(8)
    export.options.fields["poured"].setValue(4)
    assert export.export_button.text() == "Export 3 kept grains"
    QTest.mouseClick(export.export_button, LEFT)
    qtbot.waitUntil(lambda: (tmp_path / "deck" / "in.settle").exists(), timeout=PATIENCE)
    rest()
    records = json.loads((tmp_path / "deck" / "recipes.json").read_text(encoding="utf-8"))
    assert [len(record["z"]) for record in records] == [learner.dimension] * 3
    done = subprocess.run(
        [*liggghts, "-in", "in.settle"], cwd=tmp_path / "deck", capture_output=True, text=True, timeout=240,
        check=False,
    )  # fmt: skip
    log = (tmp_path / "deck" / "log.liggghts").read_text()
    assert done.returncode == 0, log[-2000:] + done.stderr
    assert "inserted 4 particle templates" in log
    # The deck's own words for what would be one are printed with it.
    assert not re.search(r"^ERROR", log, re.MULTILINE)


def test_clones_are_on_the_map_and_come_under_the_hand(shaping, rest, learner, meanings):
    window, work = shaping, shaping.stations.latent.work
    assert not window.stations.latent.shelf.tabs.isTabVisible(2)
    drawn = learner.sample(6, 1)
    named = replace(drawn.serialization, names=tuple(f"clone_{i}" for i in range(6)))
    window.workspace.use_clones(
        Generation(named, drawn.latents, drawn.parents, None, Counts(6, 6, 0, {}, 0, 0), "", 6.0, (), 1)
    )
    rest()
    gallery = window.stations.latent.shelf
    assert gallery.tabs.tabText(2) == "Clones (6)"
    gallery.tabs.setCurrentIndex(2)
    rest()
    assert all(not gallery.clones.item(row).icon().isNull() for row in range(6))
    name = gallery.clones.names[4]
    gallery.clones.choose(name)
    assert window.commands.run("latent.pick_b")
    assert window.stations.latent.dock.blend.slots["B"].grain == name
    gallery.opened.emit(name)
    rest()
    clones = window.workspace.clones
    np.testing.assert_array_equal(work.grain.latent, clones.latents[4])
    np.testing.assert_allclose(work.grain.avatar.centers, clones.clones.avatar(4).centers, atol=1e-12)
    np.testing.assert_allclose(
        window.stations.latent.dock.map.here, work.about.map.places(clones.latents[4:5])[0]
    )
    keep(window, rest)
    np.testing.assert_array_equal(work.kept[0].retrace(learner, meanings), clones.latents[4])
    # Another style-learner has no clones yet.
    window.workspace.use_style(None)
    rest()
    assert not gallery.tabs.isTabVisible(2)


def test_one_kept_grain_alone_is_exported(shaping, rest):
    window, export = shaping, shaping.stations.export.panel
    for _ in range(2):
        window.stations.latent.panel.randomise.click()
        keep(window, rest)
    window.stations.latent.shelf.kept.choose("kept 2")
    window.enter("export")
    rest()
    export.choose("kept")
    both = export.chosen().named
    assert len(both) == 2
    export.choose("kept one")
    assert export.selection.currentText() == "Kept grain kept 2"
    assert export.export_button.text() == "Export 1 kept grain"
    ((name, avatar),) = export.chosen().named
    assert name == both[1][0] != both[0][0]
    np.testing.assert_array_equal(avatar.centers, both[1][1].centers)
    # Another choice in the gallery is followed; without one all kept grains are offered again.
    window.stations.latent.shelf.kept.choose("kept 1")
    assert export.selection.currentText() == "Kept grain kept 1"
    assert export.chosen().named[0][0] == both[0][0]
    window.stations.latent.shelf.kept.setCurrentItem(None)
    window.enter("export")
    rest()
    assert export.selection.currentText() == "Kept grains (2)"
    assert export.selection.findData("kept one") == -1
