from __future__ import annotations

from mbstudio.cli import measuring
from mbstudio.core.project import Project


def test_processes_change_neither_order_nor_values(fitted_project, monkeypatch):
    monkeypatch.setattr(measuring, "FEWEST_FOR_PROCESSES", 2)
    project = Project.open(fitted_project)
    labels = sorted(project.fits, reverse=True)
    alone = measuring.measure_grains(project, labels, workers=1)
    together = measuring.measure_grains(project, labels, workers=2)
    assert [row["label"] for row in together[0]] == labels
    assert alone == together


def test_one_grain_that_cannot_be_measured_does_not_stop_the_others(fitted_project, monkeypatch):
    from mbstudio.core import metrics
    from mbstudio.core.errors import MeasureError

    project = Project.open(fitted_project)
    labels = sorted(project.fits)
    measure = metrics.measure

    def fail_for_one(body, *, unit=None):
        if body.label == labels[1]:
            raise MeasureError("the grain is flat")
        return measure(body, unit=unit)

    monkeypatch.setattr(metrics, "measure", fail_for_one)
    rows, failures = measuring.measure_grains(project, labels, workers=1)
    assert [row["label"] for row in rows] == [labels[0], labels[2]]
    assert failures == {labels[1]: "the grain is flat"}
