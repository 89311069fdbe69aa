"""Porosity: against specimens whose pores can be counted on paper."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains import GrainSet
from mbstudio.core.porosity import Specimen, porosity_profiles, representative_volume, size_profiles
from mbstudio.core.units import VoxelSize
from tests.core.populations.made import population


def specimen(labels, edges=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0), table=None):
    frame = pd.DataFrame(table or {"label": [1], "touches_border": [False]})
    return GrainSet(labels.astype(np.int32), frame, VoxelSize(*edges, "mm"), origin)


def test_layers_are_found_where_they_lie():
    labels = np.zeros((40, 20, 30))
    labels[10:20] = 1
    labels[20:, :5] = 1
    found = porosity_profiles(specimen(labels, (2.0, 1.0, 1.0), (5.0, 6.0, 7.0)))
    assert set(found) == {"x", "y", "z"}
    z = found["z"]
    assert z.places[[0, -1]] == pytest.approx([7.0, 7.0 + 2 * 39])
    assert z.porosity[:10] == pytest.approx(np.ones(10))
    assert z.porosity[10:20] == pytest.approx(np.zeros(10))
    assert z.solid_fraction[20:] == pytest.approx(np.full(20, 0.25))
    assert found["y"].porosity[:5] == pytest.approx(np.full(5, 0.25))
    assert found["y"].porosity[5:] == pytest.approx(np.full(15, 0.75))
    whole = 1 - np.count_nonzero(labels) / labels.size
    for profile in found.values():
        assert profile.mean == pytest.approx(whole)


def test_a_core_and_its_wall_in_rings():
    y, x = np.mgrid[:60, :60] - 29.5
    disc = np.hypot(x, y) <= 15
    labels = np.broadcast_to(disc, (12, 60, 60)).copy()
    grains = specimen(labels)
    round_one = Specimen.cylinder(grains, 58.0)
    found = porosity_profiles(grains, round_one)
    radius = found["radius"]
    assert radius.porosity[radius.places < 13] == pytest.approx(0.0)
    assert radius.porosity[radius.places > 17] == pytest.approx(1.0)
    assert found["z"].mean == pytest.approx(1 - (15 / 29) ** 2, abs=0.01)
    assert radius.mean == pytest.approx(found["z"].mean)
    part = porosity_profiles(grains, Specimen.cylinder(grains, 20.0, height=(2.0, 7.0)))
    assert part["z"].places == pytest.approx(np.arange(2.0, 8.0))
    assert part["z"].mean == 0.0


def test_a_specimen_that_does_not_fit_is_refused():
    grains = specimen(np.ones((10, 20, 20)))
    for options in ({"diameter": 21.0}, {"diameter": -1.0}, {"diameter": 10.0, "centre": (2.0, 10.0)}):
        with pytest.raises(MeasureError, match="does not lie within"):
            Specimen.cylinder(grains, **options)
    with pytest.raises(MeasureError, match="do not lie within"):
        Specimen.cylinder(grains, 10.0, height=(3.0, 30.0))


def test_the_representative_box_grows_with_the_grains():
    """A lattice of cubes: boxes of whole periods are alike, smaller ones are not."""
    rng = np.random.default_rng(1)
    edges = []
    for coarse in (2, 6):
        cells = rng.random((96 // coarse,) * 3) < 0.6
        labels = cells.repeat(coarse, 0).repeat(coarse, 1).repeat(coarse, 2)
        found = representative_volume(specimen(labels), tolerance=0.1, seed=2)
        assert found.mean[-1] == pytest.approx(0.4, abs=0.03)
        # Independent cells: the deviation falls with the root of the number of cells in a box.
        cells_in = (found.edges / coarse) ** 3
        large = cells_in > 20
        expected = np.sqrt(0.4 * 0.6 / cells_in[large])
        assert found.deviation[large][:3] == pytest.approx(expected[:3], rel=0.35)
        edges.append(found.edge)
    assert edges[0] < edges[1]
    same = representative_volume(specimen(labels), tolerance=0.1, seed=2)
    assert same.deviation == pytest.approx(found.deviation)


def test_a_scan_too_small_for_its_grains_has_no_representative_box():
    labels = np.zeros((32, 32, 32))
    labels[:16] = 1
    assert representative_volume(specimen(labels)).edge is None
    with pytest.raises(MeasureError, match="less than eight"):
        representative_volume(specimen(np.ones((4, 4, 4))))
    with pytest.raises(MeasureError, match="between 0 and 1"):
        representative_volume(specimen(labels), tolerance=2.0)


def test_sizes_that_rise_with_height_are_found_and_others_not():
    rng = np.random.default_rng(3)
    count = 120
    heights = rng.uniform(0, 50, count)
    table = {
        "label": list(range(1, count + 1)), "touches_border": [False] * count,
        "x": rng.uniform(0, 30, count), "y": rng.uniform(0, 30, count), "z": heights,
    }  # fmt: skip
    grains = specimen(np.zeros((50, 30, 30)), table=table)
    sizes = 1 + heights / 50 + rng.normal(0, 0.1, count)
    found = size_profiles(population(intermediate=sizes, volume=sizes**3), grains)
    assert found["height"].rank_correlation > 0.8
    assert found["height"].p < 1e-6
    assert found["radius"].p > 0.05
    assert np.diff(found["height"].mean).min() > 0
    assert found["height"].numbers.sum() == count
    with pytest.raises(MeasureError, match="needs ten"):
        size_profiles(population(intermediate=[1.0, 2.0], volume=[1.0, 8.0]), grains)
