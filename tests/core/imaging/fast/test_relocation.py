"""Relocating control points, and the area row, on bodies whose corners and area are known."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit
from mbstudio.core.imaging.depths import least_depths
from mbstudio.core.imaging.fast import relocation
from mbstudio.core.imaging.fast.levenberg_marquardt import curvature_of_rows
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings
from mbstudio.core.imaging.fast.relocation import relocate
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.metaball.surface import mesh_area
from mbstudio.core.units import VoxelSize
from tests.core.imaging.imaging_shapes import CENTER, ellipsoid, grain_where

HALF = 32.4


@pytest.fixture(scope="module")
def cube() -> Grain:
    # Turned, so that no face lies along the voxels.
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]

    def inside(x, y, z):
        x, y, z = np.broadcast_arrays(x, y, z)
        local = np.stack([x, y, z], axis=-1) @ turn
        return (np.abs(local) <= HALF).all(axis=-1)

    return grain_where(inside, 57, VoxelSize(1, 1, 1, "um"))


def test_curvature_of_one_sphere_is_two_over_the_distance() -> None:
    control = np.array([[0.5], [0.0], [0.0], [0.25]], dtype=np.float32)
    points = np.array([[1.5, 0.5, 0.5], [0.0, 2.0, 0.0], [0.0, 0.0, -4.0]], dtype=np.float32)
    found = np.empty(3, dtype=np.float32)
    curvature_of_rows(np.ascontiguousarray(points), control, found)
    np.testing.assert_allclose(found, [2.0, 1.0, 0.5], rtol=1e-5)


def test_area_by_triangles_is_that_of_the_sphere() -> None:
    assert mesh_area(np.array([[0.0], [0.0], [0.0], [4.0]])) == pytest.approx(16 * np.pi, rel=2e-3)


def test_least_depths_go_by_the_scan_not_by_the_blocks_it_is_averaged_in() -> None:
    grain = grain_where(ellipsoid(40, 30, 24), 42, VoxelSize(0.5, 0.5, 0.5, "um"))
    prepared = prepare(grain, working_side=80)
    soft, hard = least_depths(prepared, 120)
    # Two voxels of the scan are 1 um, two blocks would be 2 um; 4 % of the RMS radius lie between.
    assert soft == pytest.approx(0.04)
    assert 1.0 < soft * prepared.scale < 2.0
    assert hard == pytest.approx(0.02)


def test_useless_control_points_move_to_the_corners(cube: Grain) -> None:
    prepared = prepare(cube)
    # One large sphere, and eleven idle points heaped up at its centre.
    rng = np.random.default_rng(0)
    control = np.vstack([rng.normal(size=(3, 12)) * 0.03, np.full(12, 0.6 / 12)])
    search = Refinement(prepared, control, RefineSettings())
    for _ in range(5):
        search.advance()
    before = search.rms()
    relocate(search, 4, np.random.default_rng(1))
    assert search.control.shape == (4, 12)
    assert (search.control[3] > 0).all()
    new = search.control[:, -4:]
    # Below edges and corners, farther from the middle than any face is.
    assert (np.linalg.norm(new[:3], axis=0) * prepared.scale > HALF).all()
    assert (search.depth_of(new[:3]) > 0).all()
    for _ in range(5):
        search.advance()
    assert search.rms() < before


def test_a_place_on_the_surface_is_never_taken(cube: Grain, monkeypatch) -> None:
    prepared = prepare(cube)
    control = np.vstack([np.random.default_rng(0).normal(size=(3, 12)) * 0.03, np.full(12, 0.6 / 12)])
    search = Refinement(prepared, control, RefineSettings())
    given = relocation.candidates

    def with_some_on_the_surface(search, points, residual, most, rng):
        return np.hstack([points[:, :40].astype(float), given(search, points, residual, most, rng)])

    monkeypatch.setattr(relocation, "candidates", with_some_on_the_surface)
    points = search.surface_rows_at(control)[0]
    relocate(search, 4, np.random.default_rng(1))
    assert np.isfinite(search.control).all()
    new = search.control[:3, -4:]
    assert np.linalg.norm(new[:, :, None] - points[:, None, :], axis=0).min() > 1e-3


def test_a_cube_keeps_its_area(cube: Grain) -> None:
    result = fit(cube, 60)
    assert result.verdict.valid
    mesh = result.avatar.mesh(128)
    assert mesh.area == pytest.approx(6 * (2 * HALF) ** 2, rel=0.025)
    assert mesh.volume == pytest.approx((2 * HALF) ** 3, rel=0.005)


def test_the_area_of_the_hull_is_known_where_voxels_are_many_and_even(cube: Grain) -> None:
    prepared = prepare(cube)
    assert prepared.area * prepared.scale**2 == pytest.approx(6 * (2 * HALF) ** 2, rel=0.025)
    few = prepare(grain_where(ellipsoid(9, 9, 9), 12, VoxelSize(1, 1, 1, "um")))
    long = prepare(grain_where(ellipsoid(22, 22, 22), 24, VoxelSize(1, 1, 2, "um")))
    assert np.isnan(few.area)
    assert np.isnan(long.area)


def test_a_smooth_grain_is_truer_where_the_last_steps_ask_at_more_points() -> None:
    axes = np.array([54.0, 41.0, 33.0])
    grain = grain_where(ellipsoid(*axes), 56, VoxelSize(1, 1, 1, "um"))

    def error(points_at_end: int) -> float:
        result = fit(grain, 40, refine=RefineSettings(points_at_end=points_at_end))
        surface = np.asarray(result.avatar.mesh(64).vertices) - CENTER
        # Distance along the ray from the middle, which for these axes is close to that to the surface.
        away = np.linalg.norm(surface, axis=1)
        return float(np.mean(np.abs(away - away / np.linalg.norm(surface / axes, axis=1))))

    assert error(8000) < 0.9 * error(0)


def test_a_grain_of_few_voxels_has_no_more_points_to_ask_at() -> None:
    few = prepare(grain_where(ellipsoid(9, 9, 9), 12, VoxelSize(1, 1, 1, "um")))
    control = np.array([[0.0], [0.0], [0.0], [1.0]])
    assert not Refinement(few, control).take_more_points()
    long = prepare(grain_where(ellipsoid(50, 50, 50), 52, VoxelSize(1, 1, 2, "um")))
    assert long.hull.shape[0] > 10_000
    assert not Refinement(long, control).take_more_points()
    many = prepare(grain_where(ellipsoid(50, 50, 50), 52, VoxelSize(1, 1, 1, "um")))
    search = Refinement(many, control)
    before = search.surface.points.shape[1]
    assert search.take_more_points()
    assert search.surface.points.shape[1] >= 3 * before


@pytest.mark.parametrize(("half", "n", "are_many"), [(50, 79, False), (50, 80, True), (9, 80, False)])
def test_many_control_points_get_fresh_surface_points_sooner_but_on_few_voxels(half, n, are_many) -> None:
    prepared = prepare(grain_where(ellipsoid(half, half, half), half + 2, VoxelSize(1, 1, 1, "um")))
    rng = np.random.default_rng(0)
    search = Refinement(prepared, np.vstack([0.2 * rng.normal(size=(3, n)), np.full(n, 1 / n)]))
    first = search.surface
    for _ in range(4):
        search.advance()
    assert (search.surface is not first) == are_many
    if are_many:
        assert first.points.shape[1] >= search.settings.points_per_many * n


def test_the_area_row_stays_or_rests_once_the_area_is_right(cube: Grain) -> None:
    # The ball of the cube's volume has too little area until its wanted area is below its own.
    prepared = prepare(cube)
    ball = np.array([[0.0], [0.0], [0.0], [(3 * prepared.volume / (4 * np.pi)) ** (2 / 3)]])
    for stays in (True, False):
        search = Refinement(prepared, ball, RefineSettings(area_stays=stays))
        assert search.strive_for_area()
        assert search.solid.area_weight > 0
        search._wanted_area = 0.9 * mesh_area(ball)
        search.measure_solid()
        assert (search.solid.area_weight > 0) == stays


@pytest.mark.parametrize(
    ("n", "working_side", "strives"), [(79, 120, False), (80, 120, True), (80, 60, False)]
)
def test_many_control_points_strive_for_more_of_the_area_but_not_on_averaged_blocks(
    n: int, working_side: int, strives: bool
) -> None:
    ball = grain_where(ellipsoid(50, 50, 50), 52, VoxelSize(1, 1, 1, "um"))
    prepared = prepare(ball, working_side=working_side)
    control = np.vstack([np.zeros((3, n)), np.full(n, 1 / n)])
    control[3] *= 0.997 * prepared.area / mesh_area(control, 64)
    assert Refinement(prepared, control, RefineSettings(area_noise=0.0)).strive_for_area() == strives
