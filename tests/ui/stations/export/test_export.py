"""Station Export: the shape over the avatar with its numbers, clumps by target, the specimen."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.dem.preview import preview
from mbstudio.core.grains import load_labels
from mbstudio.core.imaging import fit
from mbstudio.core.metaball import Avatar
from mbstudio.core.populations.measuring import Conventions, Measurement
from mbstudio.core.project import Project, ProjectState
from tests.ui.conftest import PATIENCE


@pytest.fixture(scope="session")
def fitted(two_grains):
    """Two grains with avatars of a few control points."""
    return {label: fit(two_grains.grain(label), 8) for label in (1, 2)}


@pytest.fixture
def exporting(window, idle, qtbot, two_grains, fitted):
    """The window at station Export, and what waits until all previews are made."""
    window.workspace.replace_project(Project(ProjectState(grains=two_grains, fits=fitted)))
    window.enter("export")

    def settle():
        qtbot.waitUntil(lambda: not window.stations.export.link.is_waiting, timeout=PATIENCE)
        idle()

    settle()
    window.settle = settle
    return window


def choose_target(window, name):
    panel = window.stations.export.panel
    panel.target.setCurrentIndex(panel.target.findData(name))


def test_the_shape_lies_over_the_avatar_with_its_numbers(exporting):
    window, card = exporting, exporting.stations.export.panel.preview
    scene = window.view.scene
    assert card.texts["Watertight"] == "yes"
    assert float(card.texts["Smallest angle"].rstrip("°")) >= 15
    assert not window.commands.action("layer.avatars").isVisible()

    choose_target(window, "lammps")
    window.settle()
    assert card.texts["Spheres"] == "40"
    assert float(card.texts["IoU"]) > 0.97
    assert float(card.texts["Volume error"].split()[0]) < 0.2
    assert scene.layers.shape.is_shown
    assert scene.layers.envelope.is_shown
    assert not scene.layers.avatars.is_shown
    before = window.viewport.picture()
    window.stations.export.panel.options.clumps.number.setValue(3)
    window.settle()
    assert card.texts["Spheres"] == "3"
    assert float(card.texts["IoU"]) < 0.99
    assert (window.viewport.picture() != before).any(axis=2).mean() > 0.01

    choose_target(window, "stl")
    window.settle()
    fields = window.stations.export.panel.options.fields
    assert fields["cells"].isEnabled()
    assert fields["error"].text() == "by the cells"
    fields["error"].setValue(1.0)
    window.settle()
    assert not fields["cells"].isEnabled()
    assert float(card.texts["Hausdorff"].split("(")[1].split()[0]) <= 1.0

    card.switch.setChecked(False)
    window.settle()
    assert card.texts == {}
    assert scene.layers.avatars.is_shown
    assert not scene.layers.shape.is_shown
    assert window.commands.action("layer.avatars").isVisible()


def test_the_preview_is_centred_and_follows_the_selection(exporting):
    window, card = exporting, exporting.stations.export.panel.preview
    assert card.name.text() == "grain_00001"
    window.workspace.select(2)
    window.settle()
    assert card.name.text() == "grain_00002"
    low, high = (
        np.array(window.view.scene.points()).min(axis=0),
        np.array(window.view.scene.points()).max(axis=0),
    )
    # In its principal frame, 10 µm a voxel: the semi-axes are about 120, 100 and 80 µm.
    assert np.sort((high - low) / 2) == pytest.approx([80, 100, 120], rel=0.1)
    assert (high + low) / 2 == pytest.approx(np.zeros(3), abs=12)
    card.steps[1].click()
    window.settle()
    assert card.name.text() == "grain_00001"
    window.enter("fit")
    window.settle()
    assert not window.view.scene.layers.shape.is_shown


def test_spheres_are_chosen_by_what_they_reach(exporting, tmp_path):
    window, panel = exporting, exporting.stations.export.panel
    window.workspace.select(1)
    panel.choose("chosen")
    choose_target(window, "edem")
    panel.options.clumps.aim_at("iou", 0.96)
    window.settle()
    few = int(panel.preview.texts["Spheres"])
    assert few < 40
    assert float(panel.preview.texts["IoU"]) >= 0.96
    panel.options.clumps.aim_at("inertia", 0.01)
    panel.options.clumps.most.setValue(2)
    window.settle()
    assert "not reached with 2 spheres" in panel.preview._said.text()

    panel.options.clumps.aim_at("iou", 0.96)
    panel.options.clumps.most.setValue(100)
    panel.folder.setText(str(tmp_path / "out"))
    assert window.commands.run("export.run")
    window.settle()
    assert window.messages.level == "success", window.messages.text
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["options"]["clump_target"] == "iou 0.96 and n 100"
    assert manifest["items"][0]["details"]["spheres"] == few


def test_what_cannot_be_exported_is_said_in_the_card(exporting):
    window, panel = exporting, exporting.stations.export.panel
    two = Avatar([[0, 0, 0], [50, 0, 0]], [1.0, 1.0], "um", name="two")
    panel.chosen = lambda: type(panel)._once(panel, ("two",), lambda: _Chosen((("two", two),)))
    window.stations.export.link.update()
    window.settle()
    assert "2 pieces" in panel.preview._said.text()
    assert panel.preview.texts == {}
    assert window.messages.level != "error"


class _Chosen(tuple):
    @property
    def named(self):
        return self[0:]


@pytest.mark.parametrize(
    ("target", "numbers"),
    [("peclet", {"nodes", "spacing_length", "volume_error"}), ("metaball", {"control_points"})],
)
def test_grids_and_metaballs_have_previews_too(target, numbers):
    from mbstudio.core.dem.body import prepare_bodies
    from mbstudio.scene.export_preview import preview_surfaces

    (body,) = prepare_bodies([Avatar([[5, 5, 5.0]], [4.0], "mm")], ["ball"], "mm", None)
    found = preview(body, target, {})
    assert set(found.figures) == numbers
    assert abs(found.figures.get("volume_error", 0)) < 0.01
    shape = preview_surfaces(found).shape
    reach = np.linalg.norm(shape.points, axis=1).max()
    # sqrt(k) is the radius of a single metaball; its control point is a small sphere.
    assert reach == pytest.approx(2.0, rel=0.01) if target == "peclet" else reach < 0.2
    # Outward about the middle; where a node of the grid lies on the surface, triangles have no area.
    outward = np.einsum("ij,ij->i", shape.points, shape.normals)
    assert (outward >= -1e-6).all() if target == "peclet" else outward.mean() > 0


def test_a_specimen_meets_its_curve_and_is_written(exporting, tmp_path):
    window, panel = exporting, exporting.stations.export.panel
    form = panel.specimen
    assert form.plan() is None
    form.switch.setChecked(True)
    form.scale(True)
    form.set_points([100, 200, 400], [0, 60, 100], "um")
    form.count.setValue(300)
    window.settle()
    x, y = form.plot._found.getOriginalDataset()
    wanted = np.interp(np.log(x[1:]), np.log([100, 200, 400]), [0, 60, 100])
    assert np.abs(y[1:] - wanted).max() < 4
    assert "D50" in form.summary.text()
    assert "The avatars are scaled by" in form.summary.text()
    assert "box" in form.summary.text()

    choose_target(window, "lammps")
    panel.options.clumps.number.setValue(4)
    form.count.setValue(20)
    panel.folder.setText(str(tmp_path / "out"))
    assert window.commands.run("export.run")
    window.settle()
    assert window.messages.level == "success", window.messages.text
    assert (tmp_path / "out" / "in.specimen").exists()
    rows = (tmp_path / "out" / "specimen.csv").read_text().splitlines()[1:]
    assert len(rows) == 20
    sizes = [float(line.split(",")[2]) for line in rows]  # in m
    assert min(sizes) >= 100e-6
    assert max(sizes) <= 400e-6


def test_a_curve_that_is_none_holds_the_export_back_and_says_why(exporting, tmp_path):
    window, panel = exporting, exporting.stations.export.panel
    form = panel.specimen
    panel.folder.setText(str(tmp_path / "out"))
    assert panel.is_ready
    form.switch.setChecked(True)
    form.scale(True)
    form.set_points([100, 200], [0, 90], "um")
    window.settle()
    assert "everything passes" in form.refusal.text()
    assert not panel.is_ready
    assert not panel.export_button.isEnabled()
    form.table.item(1, 1).setText("much")
    window.settle()
    assert "'200 much'" in form.refusal.text()
    form.table.item(1, 1).setText("100")
    window.settle()
    assert form.refusal.text() == ""
    assert panel.is_ready
    form.add_row()
    form.table.item(2, 0).setText("300")
    window.settle()
    assert not panel.is_ready
    form.remove_row()
    assert panel.is_ready


def test_the_avatars_own_curve_can_be_taken(exporting):
    window, form = exporting, exporting.stations.export.panel.specimen
    form.switch.setChecked(True)
    form.scale(True)
    form.sizes_asked.emit()
    window.settle()
    curve = form.curve()
    assert curve.unit == "um"
    # Intermediate axes of the two ellipsoids: about 180 and 200 µm.
    assert curve.sizes[1] == pytest.approx(180, rel=0.06)
    assert curve.sizes[-1] == pytest.approx(200, rel=0.08)


def many_grains(count):
    """A set of so many cubes, whose avatars alone matter."""
    labels = np.zeros((4, 4, 4 * count), np.int32)
    for label in range(1, count + 1):
        labels[1:3, 1:3, 4 * label - 3 : 4 * label - 1] = label
    return load_labels(labels, voxel_size="10 um")


def measurement(size):
    return Measurement(
        {"longest": 1.5 * size, "intermediate": size, "shortest": 0.5 * size, "volume": size**3}
    )


def test_a_specimen_is_by_default_of_all_avatars_as_they_are(window, idle, qtbot, fitted):
    """Of sixty avatars, from what was measured before, with nothing scaled."""
    avatars = {label: Avatar([[0, 0, 0.0]], [float(label)], "um") for label in range(1, 61)}
    fits = {label: replace(fitted[1], avatar=avatar) for label, avatar in avatars.items()}
    window.workspace.replace_project(Project(ProjectState(grains=many_grains(60), fits=fits)))
    known = window.studio.offers.known
    sizes = np.exp(np.random.default_rng(4).normal(5, 0.3, 60))
    for avatar, size in list(zip(avatars.values(), sizes, strict=True))[:-1]:
        known[(avatar, Conventions("um", "obb", None, False))] = measurement(size)
    window.enter("export")
    link, form = window.stations.export.link, window.stations.export.panel.specimen
    form.switch.setChecked(True)
    assert form.plan().curve is None

    def settle():
        qtbot.waitUntil(lambda: not link.is_waiting, timeout=PATIENCE)
        idle()

    settle()  # one avatar takes less than a second: it is measured without being asked for
    sizes[-1] = known[(avatars[60], Conventions("um", "obb", None, False))].factors["intermediate"]
    settle()
    form.count.setValue(60)
    form.unit.setCurrentIndex(form.unit.findData("um"))
    settle()
    x, y = form.plot._found.getOriginalDataset()
    assert np.sort(x[1:]) == pytest.approx(np.sort(sizes))
    volume = np.append(
        sizes[:-1] ** 3, known[(avatars[60], Conventions("um", "obb", None, False))].factors["volume"]
    )
    order = np.argsort(sizes)
    assert y[1:] == pytest.approx(100 * np.cumsum(volume[order]) / volume.sum())
    assert "No avatar is scaled." in form.summary.text()
    assert f"D100 {sizes.max():.3g} µm" in form.summary.text()
    # The table can take the same curve, with as many points as it needs.
    form.scale(True)
    form.sizes_asked.emit()
    settle()
    assert form.table.rowCount() > 10
    assert form.curve().sizes[-1] == pytest.approx(sizes.max(), rel=1e-3)


def test_measuring_many_avatars_waits_for_its_button_and_says_how_long(window, idle, qtbot, fitted):
    fits = {label: replace(fitted[1], avatar=Avatar([[0, 0, 0.0]], [9.0], "um")) for label in range(1, 301)}
    window.workspace.replace_project(Project(ProjectState(grains=many_grains(300), fits=fits)))
    window.enter("export")
    link, form = window.stations.export.link, window.stations.export.panel.specimen
    form.switch.setChecked(True)
    qtbot.waitUntil(lambda: not link.is_waiting, timeout=PATIENCE)
    assert not link.work.is_measuring
    assert form.measure_button.isVisibleTo(form)
    assert "300 of 300 avatars are not measured yet: about " in form.summary.text()
    form.measure_button.click()
    qtbot.waitUntil(lambda: len(window.studio.offers.known) >= 2, timeout=PATIENCE)
    assert window.commands.run("work.cancel")
    idle()
    done = len(window.studio.offers.known)
    qtbot.waitUntil(lambda: not link.is_waiting, timeout=PATIENCE)
    assert f"{300 - done} of 300 avatars" in form.summary.text()
