"""Populations measured of bodies: rows, reasons, processes."""

from __future__ import annotations

import threading
import warnings

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from mbstudio.core.batch import pool
from mbstudio.core.errors import Cancelled, GrainError, GrainWarning, MeasureError
from mbstudio.core.grains import Grain, load_labels
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import CORE_FACTORS, DETAILED_FACTORS, FACTORS, measure
from mbstudio.core.populations import Population, measure_population
from mbstudio.core.populations.measuring import Bodies, given_body, measure_together, measured_so_far
from mbstudio.core.units import VoxelSize


def box(x, y, z, unit="mm") -> trimesh.Trimesh:
    mesh = trimesh.creation.box((x, y, z))
    mesh.units = unit
    return mesh


def plate() -> Grain:
    return Grain(np.ones((1, 5, 5), dtype=bool), VoxelSize(1, 1, 1, "mm"), label=77)


def test_one_bad_body_has_a_row_that_says_why():
    open_mesh = box(1, 1, 1)
    open_mesh.update_faces(np.arange(len(open_mesh.faces)) > 0)
    found = measure_population([box(1, 2, 3), plate(), open_mesh, box(2, 2, 2)], workers=0)
    np.testing.assert_allclose(found.column("volume"), [6, np.nan, np.nan, 8])
    np.testing.assert_allclose(found.column("csf"), [1 / np.sqrt(6), np.nan, np.nan, 1], rtol=1e-6)
    assert found.labels.tolist() == [0, 77, 2, 3]
    assert found.measured.tolist() == [True, False, False, True]
    assert "one voxel" in found.failures[77]
    assert set(found.failures) == {77, 2}
    assert (found.unit, found.axes, found.surface) == ("mm", "obb", "mesh")
    table = found.table()
    assert table["not_measured"].tolist() == list(found.reasons)
    np.testing.assert_allclose(table["volume_mm3"], found.column("volume"))


def test_roughness_of_a_label_volume_is_no_area():
    """A ball whose outline is noisy, as a segmentation leaves it: Crofton's formula counts the noise."""
    z, y, x = np.mgrid[-15:16, -15:16, -15:16]
    noise = ndimage.gaussian_filter(np.random.default_rng(1).standard_normal(z.shape), 0.6)
    labels = (np.sqrt(x**2 + y**2 + z**2) + 2.0 * noise < 12).astype(np.int32)
    labels = np.where(ndimage.label(labels)[0] == ndimage.label(labels)[0][15, 15, 15], 1, 0)
    grains = load_labels(labels, voxel_size="1 mm")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrainWarning)
        found = measure_population(grains, workers=0)
        by_lines = measure_population(grains, workers=0, surface="crofton")
        alone = measure_population([Grain(grains[0].mask, grains[0].voxel_size)], workers=0)
        cut_out = measure_population([grains[0]], workers=1)
    true = 4 * np.pi * 12**2
    assert found.surface == cut_out.surface == "smoothed voxels"
    assert alone.surface == by_lines.surface == "crofton voxels"
    assert found.column("area")[0] == pytest.approx(true, rel=0.06)
    assert by_lines.column("area")[0] > 1.12 * true


def test_processes_change_nothing():
    z, y, x = np.mgrid[-9:10, -9:10, -9:10]
    grain = Grain((x / 8) ** 2 + (y / 7) ** 2 + (z / 6) ** 2 <= 1, VoxelSize(2, 1, 1, "mm"), label=4)
    avatar = Avatar(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([1.0, 1.0]), "mm", label=9)
    bodies = [grain, avatar, plate(), box(1, 2, 3)]
    reports = []
    together = measure_population(
        bodies, workers=2, detail=True, progress=lambda share, _message: reports.append(share)
    )
    alone = measure_population(bodies, workers=0, detail=True)
    assert together.labels.tolist() == alone.labels.tolist() == [4, 9, 77, 3]
    assert together.reasons == alone.reasons
    assert reports == [0.25, 0.5, 0.75, 1.0]
    assert set(CORE_FACTORS) | set(DETAILED_FACTORS) < set(together.factors)
    for name, column in alone.factors.items():
        # The children reckon on one thread: sums may round otherwise.
        np.testing.assert_allclose(together.column(name), column, rtol=1e-12, err_msg=name)


def test_a_process_that_dies_costs_its_body_only(monkeypatch):
    ask = pool.Child.ask

    def ask_or_die(self, message, on_report):
        if message[0]["body"]["body"] == "grain":
            self.kill()
        return ask(self, message, on_report)

    monkeypatch.setattr(pool.Child, "ask", ask_or_die)
    found = measure_population([box(1, 1, 1), plate(), box(2, 2, 2)], workers=1)
    np.testing.assert_allclose(found.column("volume"), [1, np.nan, 8])
    assert "ended with code" in found.failures[77]


@pytest.mark.parametrize("workers", [0, 1])
def test_what_the_progress_raises_ends_the_work(workers):
    measured = []

    def stop(share, _message):
        measured.append(share)
        if len(measured) == 2:
            raise Cancelled("enough")

    with pytest.raises(Cancelled):
        measure_population([box(1, 1, 1)] * 5, workers=workers, progress=stop)
    assert len(measured) == 2
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("pool-")]


def test_conventions_reach_the_measurement():
    body = box(1, 2, 3)
    found = measure_population([body], axes="inertia", unit="um", workers=0)
    assert found.column("longest") == pytest.approx(measure(body, axes="inertia").longest * 1000)
    assert (found.unit, found.axes) == ("um", "inertia")


@pytest.mark.parametrize(
    ("options", "named"),
    [({"axes": "best"}, "axes='best'"), ({"surface": "x"}, "surface='x'"), ({"workers": -1}, "not -1"),
     ({"labels": [1, 2]}, "2 labels")],
)  # fmt: skip
def test_what_cannot_be_asked(options, named):
    with pytest.raises(MeasureError, match=named):
        measure_population([box(1, 1, 1)], **options)


def test_bodies_with_and_without_a_unit_do_not_mix():
    with pytest.raises(MeasureError, match="has no unit although"):
        measure_population([box(1, 1, 1), trimesh.creation.box((1, 1, 1))])
    mixed = measure_population([box(1, 1, 1), trimesh.creation.box((1, 1, 1))], unit="mm", workers=0)
    np.testing.assert_allclose(mixed.column("volume"), 1)
    with pytest.raises(MeasureError, match="no bodies"):
        measure_population([])


def test_labels_choose_among_the_rows():
    found = measure_population([box(1, 1, 1), box(1, 1, 2)], labels=[5, 6], workers=0)
    assert found.rows([6]).column("volume") == pytest.approx([2.0])
    with pytest.raises(MeasureError, match="no body 9"):
        found.rows([6, 9])


def test_a_label_that_is_not_there(tmp_path):
    from mbstudio.core.grains.labelling import build_grain_set

    labels = np.zeros((8, 8, 8), dtype=np.int32)
    labels[2:6, 2:6, 2:6] = 1
    grains = build_grain_set(labels, VoxelSize(1, 1, 1, "mm"))
    assert measure_population(grains, workers=0).column("volume") == pytest.approx([64.0])
    with pytest.raises(GrainError, match="no grain 3"):
        measure_population(grains, [1, 3], workers=0)


def test_every_factor_has_the_power_that_a_change_of_unit_gives_it():
    body = box(1, 2, 3)
    mm, um = (measure_population([body], unit=unit, detail=True, workers=0) for unit in ("mm", "um"))
    assert set(mm.factors) == set(FACTORS)
    for name in mm.factors:
        if mm.column(name)[0]:
            ratio = um.column(name)[0] / mm.column(name)[0]
            assert ratio == pytest.approx(1000.0 ** FACTORS[name].power, rel=1e-6), name
    assert [FACTORS[name].column("um") for name in ("volume", "area", "dn", "csf")] == [
        "volume_um3", "area_um2", "dn_um", "csf",
    ]  # fmt: skip
    assert FACTORS["area"].heading("um") == "Surface area A (µm²)"


def test_another_unit_changes_lengths_areas_and_volumes():
    columns = {"volume": [2.0], "area": [3.0], "dn": [5.0], "sphericity": [0.7]}
    small = Population("c", "clones", [1], columns, "mm", "obb", "avatar", ("",), ("",)).in_unit("um")
    assert small.unit == "um"
    found = {name: float(small.column(name)[0]) for name in columns}
    assert found == pytest.approx({"volume": 2e9, "area": 3e6, "dn": 5e3, "sphericity": 0.7})


def test_what_is_measured_by_now_is_a_part_of_the_whole():
    bodies = [box(1, 2, edge) for edge in (3, 4, 5)]
    groups = [
        Bodies("some", "grains", [4, 5], [given_body(body) for body in bodies[:2]], bodies[:2]),
        Bodies("last", "avatars", [6], [given_body(bodies[2])], bodies[2:]),
    ]
    known, parts = {}, []
    assert measured_so_far(groups, known, unit="mm") == []
    whole = measure_together(
        groups, unit="mm", workers=0, known=known,
        progress=lambda *_: parts.append(measured_so_far(groups, known, unit="mm")),
    )  # fmt: skip
    assert [[one.labels.tolist() for one in part] for part in parts] == [[[4]], [[4, 5]], [[4, 5], [6]]]
    for part in parts:
        for one, all_of_it in zip(part, whole, strict=False):
            for factor, values in one.factors.items():
                np.testing.assert_array_equal(values, all_of_it.factors[factor][: len(values)])
    assert measured_so_far(groups, known, unit="mm", axes="feret") == [], "measured in another way"
