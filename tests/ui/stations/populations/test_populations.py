"""Populations in the window: measured, compared, brushed both ways, drawn and written."""

from __future__ import annotations

from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QCoreApplication, QPoint, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtTest import QTest

from mbstudio.core.grains import load_labels
from mbstudio.core.imaging import fit
from mbstudio.core.metrics import FACTORS, Factor
from mbstudio.core.populations import (
    Bootstrap,
    Population,
    largest_gap,
    needed_bodies,
    read_laboratory_table,
    size_distribution,
)
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.measuring import ProjectPopulations, measure_project
from mbstudio.scene.reports import population_report
from mbstudio.ui.stations.populations.work import Measured
from mbstudio.ui.widgets.brush_plot import points_inside
from tests.ui.conftest import PATIENCE, ellipsoid

SHAPE = (72, 72, 72)
# Semi-axes (z, y, x) in voxels: volumes 4/3 pi abc of 4189, 2714 and 1810 voxels.
BODIES = (((18, 18, 18), (10, 10, 10)), ((50, 20, 50), (6, 9, 12)), ((44, 52, 22), (6, 6, 12)))


@pytest.fixture(scope="module")
def sand():
    """A project's state, a ball and two ellipsoids of which two have avatars, and its populations."""
    labels = np.zeros(SHAPE, dtype=np.int32)
    for label, (centre, radii) in enumerate(BODIES, 1):
        labels[ellipsoid(SHAPE, centre, radii)] = label
    grains = load_labels(labels, voxel_size="10 um")
    fits = {label: fit(grains.grain(label), 6) for label in (1, 2)}
    state = ProjectState(grains=grains, fits=fits)
    return state, measure_project(Project(state), [1, 2, 3])


@pytest.fixture
def opened(window, idle, sand):
    """The window with the grains and avatars, not yet measured."""
    window.workspace.replace_project(Project(sand[0]))
    window.stations.populations.panel.scope.setCurrentIndex(1)  # all inside, with an avatar or not
    idle()
    return window


def choose_factor(panel, name):
    """Choose a factor as a person does, in the panel's list."""
    panel.factor.setCurrentIndex(panel.factor.findData(name))


@pytest.fixture
def measured(opened, idle, sand):
    """The window at station Populations with everything measured."""
    opened.stations.populations.work._keep_populations(
        Measured(opened.stations.populations.work.asked, *sand)
    )
    opened.stations.populations.work.changed.emit()
    opened.enter("populations")
    idle()
    return opened


def click(plot, label, group=0, modifier=Qt.KeyboardModifier.NoModifier):
    QTest.mouseClick(
        plot.viewport(), Qt.MouseButton.LeftButton, modifier, plot.place_of(label, group).toPoint()
    )


def drag(plot, *places):
    """Press at the first place, move through the others, release at the last."""
    button, viewport = Qt.MouseButton.LeftButton, plot.viewport()
    QTest.mousePress(viewport, button, pos=places[0])
    for start, end in pairwise(places):
        for share in (0.25, 0.5, 0.75, 1.0):
            QTest.mouseMove(viewport, start + (end - start) * share)
            QTest.qWait(5)
    QTest.mouseRelease(viewport, button, pos=places[-1])
    QCoreApplication.processEvents()


def test_populations_are_measured_and_appear_with_their_numbers(opened, idle):
    window = opened
    window.enter("populations")
    assert not window.stations.populations.work.run.is_running
    hint = window.stations.populations.panel._hint
    assert hint.text().startswith("5 grains and avatars are to be measured: about ")
    assert window.commands.run("populations.measure")
    assert window.stations.populations.work.run.is_running
    assert "being measured" in window.stations.populations.dock.words.text()
    idle()
    grains, avatars = window.stations.populations.work.populations
    assert (len(grains), len(avatars)) == (3, 2)
    panel = window.stations.populations.panel
    choose_factor(panel, "volume")
    # By hand: the mean of 4/3 pi abc over the three bodies, 10 µm a voxel.
    volumes = [4 / 3 * np.pi * np.prod(radii) * 1000 for _, radii in BODIES]
    shown = float(panel.statistics.text("Mean", 1)) * (
        1e9 if "mm³" in panel.statistics.text("Mean", 0) else 1
    )
    assert shown == pytest.approx(np.mean(volumes), rel=0.02)
    assert panel.statistics.text("Bodies", 2) == "2"
    assert panel.statistics.text("δ mean", 1) == "–"
    assert panel.statistics.text("δ mean", 2).endswith("%")
    # The largest of the three intermediate axes (twice 10, 9 and 6 voxels) bounds all sizes.
    assert float(panel.sizes.text("D60", 1)) <= 205
    assert "µm" in panel.sizes.text("D60", 0)
    plots = window.stations.populations.dock
    assert plots.page_name == "distribution"
    bottom = plots.page.pdf.getAxis("bottom").labelText
    assert bottom.startswith("Volume V (")
    assert bottom.endswith("m³)")


def test_a_click_in_a_plot_chooses_the_grain_everywhere(measured, idle):
    window = measured
    window.stations.populations.dock.open_page("zingg")
    QCoreApplication.processEvents()
    plot = window.stations.populations.dock.page.plot
    before = window.viewport.picture()
    click(plot, 2)
    idle()
    assert window.workspace.selected == 2
    assert window.stations.grains.table.chosen_labels() == [2]
    assert len(plot.marked) == 2  # the grain and its avatar
    assert (window.viewport.picture() != before).any(axis=2).mean() > 0.01
    click(plot, 3, modifier=Qt.KeyboardModifier.ControlModifier)
    assert window.workspace.chosen == {2, 3}
    click(plot, 2, modifier=Qt.KeyboardModifier.ControlModifier)
    assert window.workspace.chosen == {3}
    place = plot.viewport().rect().bottomLeft() + QPoint(90, -90)
    QTest.mouseClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=place)
    assert window.workspace.chosen == frozenset()


def test_a_rectangle_and_a_lasso_choose_what_they_hold(measured, idle):
    window = measured
    window.stations.populations.dock.open_page("pairs")
    choose_factor(window.stations.populations.panel, "volume")
    QCoreApplication.processEvents()
    plot = window.stations.populations.dock.page.plot
    places = {label: plot.place_of(label).toPoint() for label in (1, 2, 3)}
    room = QPoint(12, 12)
    drag(plot, places[1] - room, places[1] + room)
    assert window.workspace.chosen == {1}
    window.stations.populations.dock.lasso.click()
    wide = QPoint(14, 0), QPoint(0, 14)
    drag(plot, places[3] - wide[0], places[3] - wide[1], places[3] + wide[0], places[3] + wide[1])
    assert window.workspace.chosen == {3}
    # A drag over the density takes a range of values, wherever it is drawn.
    window.stations.populations.dock.open_page("distribution")
    QCoreApplication.processEvents()
    density = window.stations.populations.dock.page.pdf
    xs = sorted(density.place_of(label).x() for label in (2, 3))
    drag(density, QPoint(round(xs[0]) - 6, 30), QPoint(round(xs[1]) + 6, 60))
    assert window.workspace.chosen == {2, 3}
    idle()
    assert sorted(window.stations.grains.table.chosen_labels()) == [2, 3]
    # Both are solid in the view: the one looked at, and the other cut out of the overview.
    assert window.view.scene.chosen == {2, 3}
    assert len(window.view.scene.layers.grains.actors) == 2


def test_the_table_and_the_view_bring_out_points(measured, idle):
    window = measured
    plot = window.stations.populations.dock.page.cdf
    table = window.stations.grains.table
    table.selectRow(table.labels_in_order().index(3))
    assert window.workspace.chosen == {3}
    (spot,) = plot.marked
    assert spot[1] == pytest.approx(1 / 3)  # the least round of three has a third at or below it
    table.selectAll()
    assert window.workspace.chosen == {1, 2, 3}
    assert len(plot.marked) == 5
    renderer = window.viewport.plotter.renderer
    window.workspace.select(None)
    idle()
    window.view.look_from("top")
    window.viewport.render_now()
    renderer.SetWorldPoint(*window.workspace.state.grains.grain(1).centroid, 1.0)
    renderer.WorldToDisplay()
    window.viewport.clicked.emit(*renderer.GetDisplayPoint()[:2])
    assert window.workspace.chosen == {1}
    assert len(plot.marked) == 2


def test_keys_go_from_grain_to_grain(measured):
    window = measured
    choose_factor(window.stations.populations.panel, "volume")
    plot = window.stations.populations.dock.page.cdf
    plot.setFocus()
    for expected in (3, 2, 1, 3):  # by rising volume, and round again
        QTest.keyClick(plot, Qt.Key.Key_Right)
        assert window.workspace.selected == expected
    QTest.keyClick(plot, Qt.Key.Key_Left)
    assert window.workspace.selected == 1


def test_it_is_kept_until_the_project_changes(measured, idle, sand):
    window = measured
    panel, work = window.stations.populations.panel, window.stations.populations.work
    first = work.measured
    assert work.is_current
    assert not panel.measure_button.isEnabled()
    window.workspace.select(2)
    window.enter("fit")
    window.enter("populations")
    idle()
    assert work.measured is first
    window.workspace.change("Take an avatar", fits={1: sand[0].fits[1]})
    assert not work.is_current
    assert "Out of date" in panel._hint.text()
    assert window.commands.run("populations.measure")
    idle()
    assert [len(p) for p in work.populations] == [3, 1]
    window.undo.undo()
    assert work.measured is first
    window.project_files.new_project()
    assert work.populations == []
    assert "Find them" in window.stations.populations.dock.words.text()


def test_measuring_is_cancelled(measured, idle, qtbot):
    window = measured
    window.stations.populations.panel.detail.setChecked(True)
    task = window.stations.populations.work.measure()
    qtbot.waitUntil(lambda: task.state == "running", timeout=PATIENCE)
    assert window.commands.run("work.cancel")
    idle()
    assert task.state == "cancelled"
    assert not window.stations.populations.work.is_current
    assert window.stations.populations.panel.measure_button.isEnabled()


def test_what_was_measured_before_it_was_cancelled_is_kept(opened, idle, qtbot):
    window, work = opened, opened.stations.populations.work
    known = window.studio.offers.known
    window.enter("populations")
    assert work.bodies_left == (5, 5)
    work.measure()
    qtbot.waitUntil(lambda: len(known) >= 1, timeout=PATIENCE)
    window.commands.run("work.cancel")
    idle()
    done = dict(known)
    assert done
    if work.measured is None:  # unless all five were measured meanwhile
        assert work.bodies_left == (5 - len(done), 5)
        told = window.stations.populations.panel._hint.text()
        assert told.startswith(f"{5 - len(done)} of 5 bodies are still to be measured: about ")
    work.measure()
    idle()
    assert [len(population) for population in work.populations] == [3, 2]
    assert all(known[key] is found for key, found in done.items())
    # Another fit of one grain is all that is to be measured then; so little begins by itself.
    window.workspace.change("Fit again", fits={**window.workspace.state.fits, 2: replace_fit(window)})
    assert work.bodies_left == (1, 5)
    work.measured = None
    window.enter("grains")
    window.enter("populations")
    assert work.run.is_running
    idle()
    window.project_files.new_project()
    assert not known


def test_what_is_measured_by_now_is_drawn_at_once_and_offered_to_nobody(opened, idle, monkeypatch):
    monkeypatch.setattr("mbstudio.ui.stations.populations.work._FRESH", 0.0)
    window, work, dock = opened, opened.stations.populations.work, opened.stations.populations.dock
    seen = []

    def look():
        drawn = dock._stack.currentWidget() is dock.page
        seen.append(([len(one) for one in work.shown], drawn, dock._legend.text()))
        assert not window.studio.offers.populations, "a part must not be taken for the whole"
        assert not window.commands.action("populations.save_figure").isEnabled()

    work.grown.connect(look)
    window.enter("populations")
    work.measure()
    idle()
    work.grown.disconnect(look)
    assert seen
    assert all(sum(counts) < 5 and drawn and "more is to come" in legend for counts, drawn, legend in seen)
    assert [len(one) for one in work.shown] == [3, 2]
    assert not work.is_growing
    assert "more is to come" not in dock._legend.text()
    assert window.commands.action("populations.save_figure").isEnabled()


def replace_fit(window):
    return fit(window.workspace.state.grains.grain(2), 5)


def test_clones_stand_beside_them_and_cannot_be_chosen(measured):
    window = measured
    grains = window.stations.populations.work.populations[0]
    clones = Population(
        "clones", "clones", grains.labels, {n: 1.1 * c for n, c in grains.factors.items()}, grains.unit,
        grains.axes, grains.surface, grains.reasons, grains.warnings,
    )  # fmt: skip
    window.studio.offers.compare([clones])
    panel = window.stations.populations.panel
    choose_factor(panel, "dn")
    assert panel.statistics.text("δ mean", 3) == "10.00 %"
    window.stations.populations.dock.open_page("pairs")
    QCoreApplication.processEvents()
    click(window.stations.populations.dock.page.plot, 1, group=2)
    assert window.workspace.selected is None


@pytest.mark.parametrize("choice", ["light", "dark"])
def test_every_page_shows_both_populations(measured, choice):
    window = measured
    window.commands.run(f"theme.{choice}")
    wanted = [window.theme.scene.grain, window.theme.scene.avatar]
    for name in window.stations.populations.dock.pages:
        window.stations.populations.dock.open_page(name)
        QCoreApplication.processEvents()
        image = window.stations.populations.dock.page.grab().toImage().convertToFormat(image_format())
        pixels = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
        pixels = pixels[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).astype(int)
        dark = pixels.mean() < 100
        assert dark == (choice == "dark"), name
        for colour in wanted:
            rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
            # Points are blended with what lies behind them.
            hue = (pixels - pixels[2, 2]) @ (rgb - pixels[2, 2]) / np.sum((rgb - pixels[2, 2]) ** 2)
            off = np.linalg.norm(pixels - pixels[2, 2] - hue[..., None] * (rgb - pixels[2, 2]), axis=2)
            assert ((hue > 0.35) & (off < 12)).sum() > 8, (name, colour)


def image_format():
    from PySide6.QtGui import QImage

    return QImage.Format.Format_RGB888


def test_figures_are_saved_and_copied(measured, idle, tmp_path):
    window = measured
    for name in window.stations.populations.dock.pages:
        window.stations.populations.dock.open_page(name)
        window.stations.populations.link.save_figure(tmp_path / name, "SVG drawing (*.svg)")
        idle()
        assert window.messages.level == "success", window.messages.text
        assert (tmp_path / f"{name}.svg").read_text().count("<path") > 10
    window.stations.populations.link.save_figure(tmp_path / "size.bmp")
    assert window.messages.level == "error"
    assert ".svg" in window.messages.text
    assert window.commands.run("populations.copy_figure")
    idle()
    assert QGuiApplication.clipboard().image().width() > 300


def test_the_report_is_written(measured, idle, tmp_path, monkeypatch):
    window = measured
    # All figures take seconds, and are drawn by the tests of the report.
    draw = population_report.Picture
    one = lambda shown, sieves, found: [draw(population_report.zingg_figure(shown), "Zingg")]  # noqa: E731
    monkeypatch.setattr(population_report, "_draw_figures", one)
    window.stations.populations.link.write_report(tmp_path / "sand.html")
    idle()
    assert window.messages.level == "success", window.messages.text
    text = (tmp_path / "sand.html").read_text(encoding="utf-8")
    HTMLParser().feed(text)
    assert text.count("<figure>") == 2, "and that of the specimen"
    assert "3 grains and 2 avatars" in text
    window.stations.populations.link.write_report(tmp_path / "missing" / "sand.html")
    idle()
    assert window.messages.level == "error"
    assert "sand.html" in window.messages.text


def test_sizes_outside_the_sieves_are_said(measured, idle, tmp_path, window):
    panel = window.stations.populations.panel
    grains = window.stations.populations.work.populations[0]
    factors = {name: column * 1e-3 for name, column in grains.factors.items()}
    tiny = Population(
        "dust", "grains", grains.labels, factors, "um", grains.axes, grains.surface, grains.reasons,
        grains.warnings,
    )  # fmt: skip
    window.studio.offers.compare([tiny])
    panel.sieves.setCurrentIndex(panel.sieves.findData("iso"))
    assert "outside the sieves" in panel._sizes_note.text()
    window.stations.populations.dock.open_page("size")
    assert "outside the sieves" in window.stations.populations.dock.page._note.text()


def test_points_inside_a_dented_outline():
    corners = np.array([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], dtype=float)  # an M upside down
    points = np.array([(2, 0.5), (2, 3), (0.5, 2), (3.5, 2), (5, 2), (-1, 0)], dtype=float)
    assert points_inside(points, corners).tolist() == [True, False, True, True, False, False]


def test_a_factor_that_is_added_to_the_table_can_be_chosen_and_drawn(opened, idle, qtbot, sand):
    added = Factor(
        name="specific_surface", title="Specific surface", symbol="S_V", formula="A / V", power=-1,
        meaning="Surface area over volume", derive=lambda area, volume: area / volume,
    )  # fmt: skip
    with FACTORS.extended(added):
        state, _ = sand
        found = measure_project(Project(state), [1, 2, 3])
        opened.stations.populations.work._keep_populations(
            Measured(opened.stations.populations.work.asked, state, found)
        )
        opened.stations.populations.work.changed.emit()
        opened.enter("populations")
        idle()
        factor = opened.stations.populations.panel.factor
        place = factor.findData("specific_surface")
        assert factor.itemText(place) == "Specific surface S_V"
        assert factor.itemData(place, Qt.ItemDataRole.ToolTipRole) == "Surface area over volume: A / V"
        choose_factor(opened.stations.populations.panel, "specific_surface")
        pdf = opened.stations.populations.dock.page.pdf
        assert pdf.getAxis("bottom").labelText.startswith("Specific surface S_V (")
        assert pdf.getAxis("bottom").labelText.endswith("⁻¹)")
        mean = opened.stations.populations.panel.statistics.text("Mean", 1)
        assert float(mean) > 0
        qtbot.waitUntil(lambda: opened.stations.populations.panel.is_certain, timeout=PATIENCE)


TABLE = "Maschenweite [mm];Siebdurchgang [%]\n0,1;0\n0,15;30\n0,2;80\n0,4;100\n"


@pytest.fixture
def many(window, idle, qtbot, sand):
    """The window with forty measured grains, and their intervals found."""
    rng = np.random.default_rng(1)
    own = sand[1].grains
    factors = {name: np.resize(column, 40) * rng.normal(1, 0.05, 40) for name, column in own.factors.items()}
    made = Population(
        "grains", "grains", np.arange(1, 41), factors, own.unit, own.axes, own.surface, ("",) * 40, ("",) * 40
    )
    window.workspace.replace_project(Project(sand[0]))
    work = window.stations.populations.work
    found = ProjectPopulations(made, None)
    work._keep_populations(Measured(work.asked, sand[0], found))
    work.changed.emit()
    window.enter("populations")
    idle()
    qtbot.waitUntil(lambda: window.stations.populations.panel.is_certain, timeout=PATIENCE)
    return window, made


def test_intervals_bands_and_needs_follow_the_choice(many, qtbot):
    window, made = many
    panel, dock = window.stations.populations.panel, window.stations.populations.dock
    for factor in ("sphericity", "elongation"):
        choose_factor(panel, factor)
        qtbot.waitUntil(lambda: panel.is_certain and panel.shown.certainty is not None, timeout=PATIENCE)
        found = Bootstrap(made, samples=400).mean(factor)
        low, high = (float(panel.statistics.text(row, 1)) for row in ("Mean from", "Mean to"))
        assert (low, high) == pytest.approx((found.low, found.high), rel=2e-3)
        bands = [item for plot, item in dock.page._drawn if isinstance(item, pg.FillBetweenItem)]
        assert len(bands) == 2
    needs = needed_bodies(made, 0.05, samples=400)
    assert panel.needs.text("D50", 2).removesuffix(" ✓") == str(needs[2].needed)
    panel.precision.setValue(20.0)
    qtbot.waitUntil(lambda: panel.is_certain and panel.shown.certainty is not None, timeout=PATIENCE)
    assert panel.needs.text("D50", 2).removesuffix(" ✓") == str(
        needed_bodies(made, 0.2, samples=400)[2].needed
    )


def test_few_bodies_show_dashes_and_no_band(measured, qtbot):
    panel, dock = measured.stations.populations.panel, measured.stations.populations.dock
    qtbot.waitUntil(lambda: panel.is_certain and panel.shown.certainty is not None, timeout=PATIENCE)
    assert panel.statistics.text("Mean from", 1) == "–"
    assert panel.needs.text("D50", 1) == "–"
    assert not any(isinstance(item, pg.FillBetweenItem) for _, item in dock.page._drawn)


def test_a_laboratorys_table_stands_beside_the_curve(many, tmp_path, idle):
    window, made = many
    link, dock = window.stations.populations.link, window.stations.populations.dock
    path = tmp_path / "sieb.csv"
    path.write_text(TABLE, encoding="utf-8")
    link.add_laboratory(path)
    assert dock.page_name == "size"
    gap, _ = largest_gap(read_laboratory_table(path).curve, size_distribution(made))
    assert f"{gap:+.1f} %" in dock.page._note.text()
    path.write_text(TABLE.replace("80", "8"), encoding="utf-8")
    link.add_laboratory(path)
    assert "must rise" in window.messages.text
    assert f"{gap:+.1f} %" in dock.page._note.text(), "the table before stays"
    sheet = tmp_path / "c.pdf"
    link.write_certificate(sheet)
    idle()
    assert window.messages.level == "success", window.messages.text
    assert sheet.read_bytes().startswith(b"%PDF")
    assert window.commands.run("populations.remove_laboratory")
    assert not link.has_laboratory


def test_the_porosity_is_told_and_drawn(opened, idle, tmp_path):
    assert opened.commands.run("populations.porosity")
    idle()
    labels = opened.workspace.state.grains.labels
    assert opened.messages.text.startswith(f"Porosity {1 - np.count_nonzero(labels) / labels.size:.3f}")
    opened.stations.populations.link.pores.save_figure(tmp_path / "pores.svg")
    idle()
    assert (tmp_path / "pores.svg").read_text("utf-8").count("<path") > 50
