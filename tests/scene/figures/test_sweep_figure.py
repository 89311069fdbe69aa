"""The figure of a sweep shows its curves."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from xml.etree import ElementTree

import imageio.v3 as imageio
import numpy as np
import pytest

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.sweep import SweepRow
from mbstudio.core.metrics import CORE_FACTORS, FACTORS, Factor
from mbstudio.scene.figures.sweep_figure import save_sweep_figure, sweep_figure


def rows(grains=3, numbers=(10, 40, 160)):
    return [
        SweepRow(
            g, f"grain {g}", n, "fast", 0, loss=(1 + g) / n, rms=0.1 / n, volume_error=1e-4, iou=1 - 1 / n,
            hausdorff=(1 + g) / n, errors=dict.fromkeys(CORE_FACTORS, (-1) ** g * (g + 1) / n),
            valid=True, seconds=0.01 * n,
        )
        for g in range(grains)
        for n in numbers
    ]  # fmt: skip


def test_lines_are_medians_and_bands_quartiles():
    figure = sweep_figure(rows())
    assert len(figure.axes) == 8
    loss, factors = figure.axes[0], figure.axes[3]
    np.testing.assert_allclose(loss.lines[0].get_xydata(), [[10, 0.2], [40, 0.05], [160, 0.0125]])
    # Three grains of 1/n, 2/n, 3/n: quartiles half way between.
    band = loss.collections[0].get_paths()[0].vertices
    assert band[:, 1].min() == pytest.approx(1.5 / 160)
    assert band[:, 1].max() == pytest.approx(2.5 / 10)
    # Relative errors in percent, without sign.
    np.testing.assert_allclose(factors.lines[0].get_ydata(), [20, 5, 1.25])
    assert factors.get_legend().get_texts()[0].get_text() == "Sphericity ψ"
    assert all(axes.get_xscale() == axes.get_yscale() == "log" for axes in figure.axes)


def test_every_factor_has_a_line():
    figure = sweep_figure(rows(1))
    # The factors, three distances, loss and cost; one grain has no bands.
    assert sum(len(axes.lines) for axes in figure.axes) == len(CORE_FACTORS) + 5
    assert not any(axes.collections for axes in figure.axes)


@pytest.mark.parametrize("numbers", [(10,), (1, 2, 3), (10, 11, 12, 13, 14, 15, 100, 400)])
def test_numbers_do_not_run_into_each_other(numbers):
    figure = sweep_figure(rows(2, numbers))
    figure.canvas.draw()
    axes = figure.axes[0]
    boxes = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
    boxes.sort(key=lambda box: box.x0)
    assert boxes
    assert all(left.x1 <= right.x0 for left, right in pairwise(boxes))


def test_it_is_written_by_its_ending(tmp_path):
    save_sweep_figure(tmp_path / "a.png", rows())
    save_sweep_figure(tmp_path / "a.SVG", rows())
    assert imageio.imread(tmp_path / "a.png").std() > 5
    assert ElementTree.parse(tmp_path / "a.SVG").getroot().tag.endswith("svg")
    with pytest.raises(FitError, match="not have the ending of a figure"):
        save_sweep_figure(tmp_path / "a.xyz", rows())


def test_factors_that_are_unknown_leave_their_panel_empty():
    figure = sweep_figure([SweepRow(1, "a", 10, "fast", 0, loss=0.1)])
    assert [bool(axes.lines) for axes in figure.axes] == [True] + 7 * [False]
    with pytest.raises(FitError, match="no fit to draw"):
        sweep_figure([SweepRow(1, "a", 10, "fast", 0, error="too small")])


def test_a_factor_that_is_added_to_the_table_is_drawn_among_those_of_shape():
    added = Factor(
        name="squareness", title="Squareness", meaning="", derive=lambda sphericity: 1 - sphericity
    )  # fmt: skip
    with FACTORS.extended(added):
        given = [replace(row, errors={**row.errors, "squareness": 0.1}) for row in rows(1)]
        shape = sweep_figure(given).axes[3]
    assert [text.get_text() for text in shape.get_legend().get_texts()][-1] == "Squareness"
    np.testing.assert_allclose(shape.lines[-1].get_ydata(), 10.0)
