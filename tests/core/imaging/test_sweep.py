"""Sweeps: their order, that they can be cut short and gone on with, and what is read from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core import metrics
from mbstudio.core.errors import Cancelled, FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit
from mbstudio.core.imaging.sweep import (
    Sweep,
    SweepRow,
    joined,
    quantiles_of,
    read_sweep,
    smallest_numbers,
    write_sweep,
)
from mbstudio.core.metrics import bodies, measuring
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import cut_box, ellipsoid, grain_where

VOXEL = VoxelSize(1, 1, 1, "um")
QUICK = {"generations": 6}


@pytest.fixture(scope="module")
def grains() -> list[Grain]:
    return [
        grain_where(cut_box, 20, VoxelSize(2, 2, 2, "um"), label=9, name="angular"),
        grain_where(ellipsoid(9.3, 7.2, 6.1), 12, VOXEL, label=4, name="egg"),
    ]


@pytest.fixture(scope="module")
def rows(grains: list[Grain]) -> list[SweepRow]:
    return list(Sweep(grains, [8, 3, 3], **QUICK))


def test_grain_by_grain_with_rising_n(rows: list[SweepRow]) -> None:
    assert [(row.label, row.name, row.n) for row in rows] == [
        (9, "angular", 3), (9, "angular", 8), (4, "egg", 3), (4, "egg", 8)
    ]  # fmt: skip
    assert all(not row.error for row in rows)


def test_a_row_tells_of_the_fit_and_the_factors(grains: list[Grain], rows: list[SweepRow]) -> None:
    row, result = rows[1], fit(grains[0], 8, **QUICK)
    assert row.loss == result.history[-1]
    assert row.rms * grains[0].nominal_diameter == pytest.approx(result.verdict.rms)
    assert row.volume_error == result.verdict.volume_error
    assert (row.valid, row.method, row.seed) == (result.verdict.valid, "fast", 0)
    box = metrics.bounding_box(grains[0])
    true, ours = metrics.measure(grains[0]), metrics.measure(result.avatar, along=box.directions)
    assert set(row.errors) == set(metrics.CORE_FACTORS)
    assert row.errors["csf"] == pytest.approx(ours.csf / true.csf - 1)
    assert row.error_of("csf") == abs(row.errors["csf"])
    assert row.seconds > 0
    # More control points are truer, by every measure of the whole surface.
    for fewer, more in ((rows[0], rows[1]), (rows[2], rows[3])):
        assert more.loss < fewer.loss
        assert more.hausdorff < fewer.hausdorff
        assert more.iou > fewer.iou


def test_a_grain_is_measured_once(grains: list[Grain], monkeypatch) -> None:
    measured: list[object] = []
    prepare_measured_body = bodies.prepare_measured_body

    def counting(body, *options):
        measured.append(body)
        return prepare_measured_body(body, *options)

    # One for grains, whose outline serves their factors and their box, and one for avatars.
    monkeypatch.setattr(bodies, "prepare_measured_body", counting)
    monkeypatch.setattr(measuring, "prepare_measured_body", counting)
    list(Sweep(grains[1:], [2, 3, 4], **QUICK))
    assert sum(isinstance(body, Grain) for body in measured) == 1
    assert len(measured) == 4


def test_a_cancelled_sweep_goes_on_with_the_fit_that_was_cut_short(grains, rows) -> None:
    steps = []

    def stop_in_the_second_fit(step) -> None:
        steps.append(step)
        if step.phase == "search" and len(sweep.rows) == 1 and sweep.on_step is stop_in_the_second_fit:
            sweep.on_step = None
            raise Cancelled("enough")

    sweep = Sweep(iter(grains), [3, 8], on_step=stop_in_the_second_fit, **QUICK)
    first = next(sweep)
    with pytest.raises(Cancelled):
        next(sweep)
    assert sweep.rows == [first]
    assert [(row.label, row.n) for row in sweep] == [(9, 8), (4, 3), (4, 8)]
    assert [row.loss for row in sweep.rows] == [row.loss for row in rows]
    assert sweep.latest.avatar.label == 4


def test_what_was_done_is_not_done_again(grains: list[Grain], rows: list[SweepRow]) -> None:
    done = [rows[0], rows[3], replace(rows[1], seed=5), replace(rows[2], options={"generations": 7})]
    sweep = Sweep(grains, [3, 8], done=done, **QUICK)
    assert [(row.label, row.n) for row in sweep] == [(9, 8), (4, 3)]
    assert sweep.rows[0] is rows[0]
    assert [(row.label, row.n) for row in sweep.rows] == [(9, 3), (9, 8), (4, 8), (4, 3)]


def test_a_grain_too_small_does_not_end_the_sweep(grains: list[Grain]) -> None:
    speck = Grain(np.ones((2, 2, 2), bool), VOXEL, label=1)
    rows = list(Sweep([speck, grains[1]], [2, 9], **QUICK))
    assert [(row.label, row.n, bool(row.error)) for row in rows] == [
        (1, 2, False), (1, 9, True), (4, 2, False), (4, 9, False)
    ]  # fmt: skip
    assert "cannot hold n = 9" in rows[1].error
    assert np.isnan(rows[1].loss)


@pytest.mark.parametrize(("numbers", "message"), [([], "at least one"), ([10, 0], "n = 0"), ([2.5], "2.5")])
def test_numbers_that_make_no_sweep(grains: list[Grain], numbers: list, message: str) -> None:
    with pytest.raises(FitError, match=message):
        Sweep(grains, numbers)


def made(label: int, n: int, csf: float, iou: float = 0.5) -> SweepRow:
    return SweepRow(label, f"grain {label}", n, "fast", 0, loss=1 / n, iou=iou, errors={"csf": csf})


def test_the_smallest_n_that_meets_an_error() -> None:
    made_rows = [
        *(made(1, n, csf) for n, csf in ((10, -0.005), (20, 0.03), (40, 0.009), (80, -0.010))),
        *(made(2, n, csf) for n, csf in ((10, 0.2), (20, 0.1), (40, 0.02), (80, 0.001))),
    ]
    # At n = 10 the first grain's error is small by chance: at 20 it is not.
    assert smallest_numbers(made_rows[:4], 0.01)["csf"] == 40
    assert smallest_numbers(made_rows, 0.01, share=0.5)["csf"] == 40
    assert smallest_numbers(made_rows, 0.01, share=1)["csf"] == 80
    assert smallest_numbers(made_rows, 1e-4)["csf"] is None
    assert smallest_numbers(made_rows, 0.5, share=1)["overlap_error"] == 10
    assert smallest_numbers(made_rows, 0.5)["hausdorff"] is None  # not known
    for error, share in ((0, 1), (0.1, 0), (0.1, 1.5)):
        with pytest.raises(FitError):
            smallest_numbers(made_rows, error, share)


def test_quantiles_over_the_grains() -> None:
    found = quantiles_of(
        [made(1, 20, 0.1), made(2, 20, 0.2), made(3, 20, 0.6), made(1, 10, float("nan"))],
        lambda row: row.error_of("csf"),
        (0.0, 0.5, 1.0),
    )
    assert found == {20: pytest.approx((0.1, 0.2, 0.6))}


def test_the_table_comes_back(tmp_path: Path, rows: list[SweepRow]) -> None:
    strange = replace(rows[0], n=77, errors={}, error='no factors: "flat", thin', loss=float("nan"))
    write_sweep(tmp_path / "a.csv", [*rows, strange])
    again = read_sweep(tmp_path / "a.csv")
    assert len(again) == 5
    for one, other in zip([*rows, strange], again, strict=True):
        for name in ("label", "name", "n", "seed", "rms", "iou", "valid", "error", "options", "errors"):
            assert getattr(one, name) == getattr(other, name)
    assert again[0].loss == rows[0].loss
    assert np.isnan(again[4].loss)


def test_tables_are_joined(rows: list[SweepRow]) -> None:
    earlier = [replace(rows[0], loss=9.0), replace(rows[0], n=99)]
    assert joined(rows, earlier) == [*rows, earlier[1]]


@pytest.mark.parametrize("text", ["a,b\n1,2\n", "label,n\nx,3\n", "\x00"])
def test_what_is_no_table_of_a_sweep(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    if text == "\x00":
        path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FitError, match="not the table of a sweep"):
        read_sweep(path)
