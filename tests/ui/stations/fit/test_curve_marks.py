"""The convergence curve says where the number of control points was changed."""

from __future__ import annotations

from mbstudio.ui.widgets.plots import ConvergenceCurve


def test_a_line_stands_before_the_generation_that_has_another_n(window):
    curve = ConvergenceCurve(window.theme)
    curve.set_losses([1.0, 0.5, 0.3, 0.2])
    curve.mark_changes([(2, 60)])
    assert curve.marked_changes == [(1.5, "n = 60")]
    curve.mark_changes([(2, 60), (4, 30)])
    assert [place for place, _ in curve.marked_changes] == [1.5, 3.5]
    curve.mark_changes([])
    assert curve.marked_changes == []


def test_what_an_empty_curve_says_fits_into_it(qapp, theme):
    curve = ConvergenceCurve(theme)
    for width in (220, 700):
        curve.resize(width, 220)
        curve.show()
        qapp.processEvents()
        words = curve._words.textItem
        assert words.toPlainText()
        assert words.document().idealWidth() <= curve.getViewBox().width()
    curve.close()
