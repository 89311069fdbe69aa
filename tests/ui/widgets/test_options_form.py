"""The form of a method's options: what it shows, takes and refuses."""

from __future__ import annotations

import pytest
from PySide6.QtTest import QTest

from mbstudio.ui.widgets.options_form import OptionsForm


@pytest.fixture
def form(qtbot):
    form = OptionsForm()
    qtbot.addWidget(form)
    form.show()
    form.show_options("paper", {"momentum": 0.25, "hull": "voxels"})
    form.taken = []
    form.changed.connect(form.taken.append)
    return form


def test_it_is_built_when_it_is_opened(form):
    assert form.fields == {}
    form.open_button.click()
    fields = form.fields
    assert fields["momentum"].text() == "0.25"
    assert fields["hull"].currentText() == "voxels"
    assert fields["generations"].value() == 1500
    assert fields["common_factor"].isChecked()
    assert "E_gs" in fields["generations"].toolTip()
    assert form.taken == []
    form.show_options("fast", {"working_side": 90})
    assert sorted(form.fields) == ["blocks_from", "cavities", "generations", "hull_points", "working_side"]
    assert form.fields["working_side"].value() == 90


def test_each_kind_of_field_tells_what_is_not_at_its_default(form):
    form.open_button.click()
    form.fields["generations"].setValue(200)
    form.fields["common_factor"].click()
    form.fields["hull"].setCurrentText("surface")
    line = form.fields["learning_rate"]
    line.clear()
    QTest.keyClicks(line, "2e-3")
    line.editingFinished.emit()
    assert form.taken[-1] == {
        "momentum": 0.25, "generations": 200, "common_factor": False, "learning_rate": 0.002,
    }  # fmt: skip


def test_what_cannot_be_taken_is_said_in_the_form(form):
    form.open_button.click()
    line = form.fields["beta1"]
    for text, words in (("much", "cannot be read"), ("2", "beta1 = 2.0")):
        line.setText(text)
        line.editingFinished.emit()
        assert words in form._refusal.text()
        assert form._refusal.isVisible()
    assert form.taken == []
    line.setText("0.8")
    line.editingFinished.emit()
    assert not form._refusal.isVisible()
    assert form.taken[-1]["beta1"] == 0.8


def test_the_window_fits_with_the_options(segmented, idle):
    window = segmented
    panel = window.stations.fit.panel
    label = window.workspace.state.grains.interior_labels[0]
    window.workspace.select(label)
    panel.method.setCurrentIndex(panel.method.findData("paper"))
    panel.n.setValue(6)
    panel.options.open_button.click()
    panel.options.fields["generations"].setValue(12)
    panel.options.fields["clustering"].setCurrentText("incremental")
    given = {"generations": 12, "clustering": "incremental"}
    assert window.workspace.state.fit_settings.options == given
    assert window.commands.run("fit.grain")
    idle()
    fit = window.workspace.state.fits[label]
    assert (fit.method, len(fit.history)) == ("paper", 13)
    assert dict(fit.options) == given
    window.undo.undo()  # the fit
    window.undo.undo()  # the settings, one step however many fields were changed
    assert window.workspace.state.fit_settings.options == {}
    assert panel.options.fields["generations"].value() == 60  # of the fast method again
    window.undo.redo()
    panel.method.setCurrentIndex(panel.method.findData("fast"))
    assert window.workspace.state.fit_settings.options == {}
