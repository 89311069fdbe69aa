"""Voxels of solids with known answers, in random rotation and sub-voxel shift."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.known_solids import ALL_KINDS, KINDS, box, ellipsoid, polyhedron, solid
from mbstudio.core.grains import Grain
from mbstudio.core.metrics import mass_properties, measure
from mbstudio.core.metrics.crofton import block_shares, corrected_crofton_area, crofton_area
from mbstudio.core.metrics.voxel_surface import voxel_outline
from mbstudio.core.units import VoxelSize

UNIT = VoxelSize(1, 1, 1, "um")


@pytest.mark.parametrize("radius", [15, 20])
@pytest.mark.parametrize("kind", KINDS)
def test_round_and_sharp_solids_alike(kind, radius):
    volumes, areas, moments = [], [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        body = solid(kind, radius, rng)
        mask = body.voxels(rng)
        volumes.append(np.count_nonzero(mask) / body.volume)
        areas.append(corrected_crofton_area(mask, UNIT) / body.area)
        found = mass_properties(Grain(mask, UNIT), 1e18)
        moments.append(found.principal / found.mass / body.moments)
    assert np.mean(volumes) == pytest.approx(1, abs=3e-3)
    # Means over a few poses scatter by about 0.2 %.
    assert np.mean(areas) == pytest.approx(1, abs=5e-3)
    sphericities = np.array(volumes) ** (2 / 3) / np.array(areas)
    assert np.mean(sphericities) == pytest.approx(1, abs=5e-3)
    assert np.mean(moments, axis=0) == pytest.approx(np.ones(3), abs=0.01)


def test_edges_that_the_smoothed_surface_and_plain_lines_lose_are_kept():
    plain = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        body = solid("cube", 15, rng)
        grain = Grain.from_mask(body.voxels(rng), "1 um")
        plain.append(crofton_area(grain.mask, UNIT) / body.area)
    assert np.mean(plain) < 0.985
    assert measure(grain, surface="smoothed").area < 0.96 * body.area
    found = measure(grain)
    assert found.area == pytest.approx(body.area, rel=0.01)
    assert found.surface == "crofton voxels"
    assert measure(grain, surface="smoothed").surface == "smoothed voxels"


def test_long_voxels():
    edges = (2.0, 1.0, 1.0)
    for kind in ("ellipsoid", "cube"):
        found = []
        for seed in range(6):
            rng = np.random.default_rng(seed)
            body = solid(kind, 25, rng)
            found.append(corrected_crofton_area(body.voxels(rng, edges), VoxelSize(*edges, "um")) / body.area)
        assert np.mean(found) == pytest.approx(1, abs=0.01), kind


def test_a_gap_between_two_arms_is_no_solid():
    mask = np.zeros((24, 24, 24), dtype=bool)
    mask[2:22, 2:22, 2:6] = mask[2:22, 2:22, 9:13] = mask[2:6, 2:22, 2:13] = True
    # A channel section: outside 20 x 20 x 11 with a slot of 16 x 20 x 3 cut in.
    area = 2 * (20 * 20 + 20 * 11 + 20 * 11) - 2 * 16 * 3 - 20 * 3 + 2 * 16 * 20 + 20 * 3
    found = corrected_crofton_area(mask, UNIT)
    assert found == pytest.approx(area, rel=0.06), "aligned with the grid: the worst case for counting"


def test_a_large_grain_is_measured_in_blocks_alike():
    body = ellipsoid(np.array([90.0, 70.0, 60.0]))
    found = measure(Grain.from_mask(body.voxels(np.random.default_rng(5)), "2 um", origin=(5.0, 6.0, 7.0)))
    assert found.volume == pytest.approx(8 * body.volume, rel=2e-3)
    assert found.area == pytest.approx(4 * body.area, rel=3e-3)
    assert found.ds == pytest.approx(2 * body.ds, rel=4e-3)
    assert found.circularity == pytest.approx(body.circularity, rel=8e-3)
    assert found.longest == pytest.approx(2 * body.lengths[2], rel=0.03)


def test_block_shares_keep_volume_and_place():
    mask = np.zeros((7, 10, 5), dtype=bool)
    mask[1:6, 2:9, 1:4] = True
    share, edges = block_shares(mask, (1.0, 1.0, 2.0), 5)
    assert edges == (2.0, 2.0, 4.0)
    assert share.shape == (4, 5, 3)
    assert share.sum() * 8 == mask.sum()
    assert share[0, 1, 0] == 0.25
    same, unchanged = block_shares(mask, (1.0, 1.0, 2.0), 10)
    assert np.array_equal(same, mask)
    assert unchanged == (1.0, 1.0, 2.0)


@settings(max_examples=6)
@given(seed=st.integers(0, 10**6), axes=st.permutations([0, 1, 2]), flips=st.tuples(*[st.booleans()] * 3))
def test_turning_and_mirroring_the_grid_changes_nothing(seed, axes, flips):
    rng = np.random.default_rng(seed)
    mask = solid("dumb-bell", 9, rng).voxels(rng)
    other = mask.transpose(axes)[tuple(slice(None, None, -1 if flip else 1) for flip in flips)]
    still, found = (measure(Grain.from_mask(each, "1 um", keep="largest")) for each in (mask, other))
    assert found.volume == still.volume
    assert found.area == pytest.approx(still.area, rel=1e-4)
    # Marching cubes splits its quadrilaterals otherwise in the turned grid.
    assert found.ds == pytest.approx(still.ds, rel=5e-3)
    assert found.longest == pytest.approx(still.longest, rel=0.02)


@pytest.mark.parametrize("axes", ["obb", "feret", "inertia"])
def test_axis_conventions_of_an_ellipsoid_and_a_box(axes):
    import trimesh

    from tests.core.metrics.solids import turned

    ellipsoid_mesh = trimesh.creation.icosphere(4)
    ellipsoid_mesh.apply_scale([3, 2, 1])
    found = measure(turned(ellipsoid_mesh, 4), axes=axes)
    assert found.axes == axes
    assert found.lengths == pytest.approx((2, 4, 6), rel=8e-3)
    assert found.krumbein == pytest.approx((2 * 4 / 36) ** (1 / 3), rel=8e-3)
    assert found.sneed_folk == pytest.approx((4 / 24) ** (1 / 3), rel=8e-3)
    assert (found.elongation, found.flatness) == pytest.approx((2 / 3, 1 / 2), rel=8e-3)
    box = measure(turned(trimesh.creation.box((1, 2, 5)), 4), axes=axes)
    expected = {
        "obb": (1, 2, 5),
        "feret": (1, None, 30**0.5),
        # A box has a**2 / 12 where an ellipsoid has (axis / 2)**2 / 5.
        "inertia": tuple(edge * (5 / 3) ** 0.5 for edge in (1, 2, 5)),
    }[axes]
    for length, known in zip(box.lengths, expected, strict=True):
        assert known is None or length == pytest.approx(known, rel=2e-3)


def long_ellipsoid(edge, seed):
    body = ellipsoid(np.array([1.0, 0.5, 0.25]) * 24)
    mask = body.voxels(np.random.default_rng(seed), (edge, 1.0, 1.0))
    return body, Grain.from_mask(mask, (edge, 1.0, 1.0), unit="um", keep="largest")


def test_the_surface_between_long_voxels_is_no_staircase():
    errors = []
    for seed in range(3):
        body, grain = long_ellipsoid(4.0, seed)
        found = measure(grain, surface="smoothed")
        errors.append([found.area / body.area - 1, found.circularity / body.circularity - 1])
        volume = np.linalg.det(np.asarray(voxel_outline(grain)[0])[voxel_outline(grain)[1]]).sum() / 6
        assert volume == pytest.approx(grain.volume, rel=1e-3)
    # A surface that follows the steps of the voxels has 5 % too much area, and 2.3 % too little circularity.
    assert abs(np.mean(errors, axis=0)) == pytest.approx(np.zeros(2), abs=0.015)


def test_whichever_axis_is_long_gives_the_same():
    _, grain = long_ellipsoid(4.0, 1)
    turned = Grain(
        np.ascontiguousarray(np.moveaxis(grain.mask, 0, 2)),
        VoxelSize(1.0, 1.0, 4.0, "um"),
        origin=(3.0, 2.0, 1.0),
    )
    one, two = measure(grain, surface="smoothed"), measure(turned, surface="smoothed")
    assert two.area == pytest.approx(one.area, rel=1e-3)
    assert two.ds == pytest.approx(one.ds, rel=1e-3)


@pytest.mark.parametrize("edge", [1.0, 4.0])
def test_a_grain_of_few_voxels_says_how_far_it_is_off(edge):
    body = ellipsoid(np.array([1.0, 0.5, 0.25]) * 12)
    mask = body.voxels(np.random.default_rng(2), (edge, 1.0, 1.0))
    found = measure(Grain.from_mask(mask, (edge, 1.0, 1.0), unit="um", keep="largest"))
    assert found.csf > 1.05 * body.csf
    assert ("longest voxel edges thick" if edge == 1 else "voxels thick everywhere") in found.warning
    assert measure(long_ellipsoid(1.0, 1)[1]).warning == ""


def test_twenty_solids_count_to_their_volume():
    assert len(set(ALL_KINDS)) == 20
    for kind in ALL_KINDS:
        body = solid(kind, 24)
        mask = body.voxels(np.random.default_rng(7))
        assert np.count_nonzero(mask) == pytest.approx(body.volume, rel=0.01), kind
        found = mass_properties(Grain(mask, UNIT), 1e18)
        assert found.principal / found.mass == pytest.approx(body.moments, rel=0.02), kind
        assert body.shadow[1] ** 2 / (4 * np.pi * body.shadow[0]) - 1 + 1e-9 > 0, kind


def test_polyhedra_from_their_corners_are_those_in_closed_form():
    edge = np.sqrt(2)
    octahedron = solid("octahedron", 1.0)
    assert octahedron.volume == pytest.approx(np.sqrt(2) / 3 * edge**3)
    assert octahedron.area == pytest.approx(2 * np.sqrt(3) * edge**2)
    assert octahedron.moments == pytest.approx(np.full(3, edge**2 / 10))
    assert octahedron.shadow == pytest.approx((edge**2, 4 * edge))
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    made, known = polyhedron(cube, "cube"), box(np.ones(3))
    assert made.shadow == pytest.approx(known.shadow)
    assert made.moments == pytest.approx(known.moments)
