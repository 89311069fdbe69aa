"""Grains from masks: checked, cropped, and where they were; their surfaces keep the volume."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbstudio.core.errors import GrainError, GrainWarning, UnitError
from mbstudio.core.grains import Grain
from mbstudio.core.units import VoxelSize


def ball(radius: float, spacing: tuple[float, float, float] = (1, 1, 1), margin: int = 2) -> np.ndarray:
    """A ball as voxels of edges z, y, x, its centre on a voxel's centre."""
    half = [int(np.ceil(radius / edge)) + margin for edge in spacing]
    z, y, x = np.ogrid[tuple(slice(-count, count + 1) for count in half)]
    return (z * spacing[0]) ** 2 + (y * spacing[1]) ** 2 + (x * spacing[2]) ** 2 <= radius**2


@given(
    corner=st.tuples(*[st.integers(0, 6)] * 3),
    lengths=st.tuples(*[st.integers(1, 5)] * 3),
    edges=st.tuples(*[st.floats(0.1, 10)] * 3),
    origin=st.tuples(*[st.floats(-100, 100)] * 3),
)
@settings(max_examples=50)
def test_a_cropped_block_stays_where_it_was(
    corner: tuple[int, int, int],
    lengths: tuple[int, int, int],
    edges: tuple[float, float, float],
    origin: tuple[float, float, float],
) -> None:
    mask = np.zeros((12, 12, 12), dtype=bool)
    mask[tuple(slice(start, start + length) for start, length in zip(corner, lengths, strict=True))] = True
    size = VoxelSize(*edges, unit="um")
    grain = Grain.from_mask(mask, size, origin=origin)
    assert grain.mask.shape == lengths
    assert grain.mask.all()
    middle = np.array(corner) + (np.array(lengths) - 1) / 2
    expected = middle[::-1] * np.array(edges[::-1]) + np.array(origin)
    np.testing.assert_allclose(grain.centroid, expected, atol=1e-9)
    assert grain.volume == pytest.approx(np.prod(lengths) * np.prod(edges))


@pytest.mark.parametrize(
    ("mask", "says"),
    [
        (np.zeros((4, 4, 4), bool), "empty"),
        (np.zeros((4, 4), bool), "three axes"),
        (np.zeros((0, 4, 4), bool), "three axes"),
        (np.arange(27).reshape(3, 3, 3), "more than 0 and one other"),
        (np.full((3, 3, 3), np.nan), "not finite"),
        (np.full((3, 3, 3), "a"), "booleans"),
    ],
)
def test_masks_that_are_no_grain(mask: np.ndarray, says: str) -> None:
    with pytest.raises(GrainError, match=says):
        Grain.from_mask(mask, "14 um", name="bad")


def test_two_valued_numbers_and_a_full_box_are_masks() -> None:
    mask = np.zeros((3, 4, 5), np.uint8)
    mask[1, 1:3, 2] = 255
    assert Grain.from_mask(mask, "14 um").voxel_count == 2
    one = Grain.from_mask(np.ones((2, 3, 4), bool), "2 mm")
    assert one.mask.shape == (2, 3, 4)
    assert one.volume == 24 * 8
    with pytest.raises(UnitError):
        Grain.from_mask(mask, "14")


def test_several_pieces() -> None:
    mask = np.zeros((5, 5, 9), bool)
    mask[1:3, 1:3, 1:3] = True
    mask[1:4, 1:4, 5:8] = True
    with pytest.raises(GrainError, match="2 separate pieces"):
        Grain.from_mask(mask, "14 um")
    largest = Grain.from_mask(mask, "14 um", keep="largest")
    assert largest.voxel_count == 27
    assert largest.origin == (70, 14, 14)
    # Pieces that meet in a corner are one.
    corner = np.zeros((2, 2, 2), bool)
    corner[0, 0, 0] = corner[1, 1, 1] = True
    assert Grain.from_mask(corner, "14 um").voxel_count == 2


def test_cavities_are_filled_and_said() -> None:
    mask = np.ones((5, 5, 5), bool)
    mask[2, 2, 2] = False
    with pytest.warns(GrainWarning, match="cavities of 1 voxels"):
        assert Grain.from_mask(mask, "14 um").voxel_count == 125
    assert Grain.from_mask(mask, "14 um", fill_cavities=False).voxel_count == 124


def test_the_mask_is_a_read_only_copy() -> None:
    mask = np.ones((3, 3, 3), bool)
    grain = Grain.from_mask(mask, "14 um")
    mask[1, 1, 1] = False
    assert grain.mask.all()
    with pytest.raises(ValueError, match="read-only"):
        grain.mask[0, 0, 0] = False


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (2.0, 1.0, 1.0), (1.0, 1.5, 0.8)])
def test_surface_of_a_ball(spacing: tuple[float, float, float]) -> None:
    radius = 16.0
    grain = Grain.from_mask(ball(radius, spacing), VoxelSize(*spacing, unit="um"), origin=(5, 6, 7))
    mesh = grain.surface_mesh()
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume == pytest.approx(grain.volume, rel=1e-3)  # positive: it looks outwards
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.02)
    # Smoothing takes the staircase away, which would make the area half as large again.
    assert mesh.area == pytest.approx(4 * np.pi * radius**2, rel=0.02)
    np.testing.assert_allclose(mesh.center_mass, grain.centroid, atol=0.02)
    half = radius + 0.3
    assert np.abs(mesh.bounds - grain.centroid).max() <= half
    assert mesh.units == "um"


@pytest.mark.parametrize(
    "shape", [(1, 1, 1), (1, 2, 2), (1, 12, 12), (2, 20, 20), (1, 1, 15), (3, 3, 3)], ids=str
)
def test_thin_and_tiny_grains_do_not_vanish(shape: tuple[int, int, int]) -> None:
    grain = Grain.from_mask(np.ones(shape, bool), "10 um")
    mesh = grain.surface_mesh()
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.volume == pytest.approx(grain.volume, rel=0.02)


def test_a_voxel_that_hangs_on_by_a_corner_makes_no_second_body() -> None:
    mask = np.zeros((14, 14, 14), bool)
    mask[1:12, 1:12, 1:12] = True
    mask[12, 12, 12] = True
    mesh = Grain.from_mask(mask, "10 um").surface_mesh()
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.volume == pytest.approx(1332 * 1000, rel=0.01)
    assert mesh.units == "um"


def test_the_surface_may_be_changed_without_harm() -> None:
    grain = Grain.from_mask(ball(6), "10 um")
    grain.surface_mesh().apply_translation((1e6, 0, 0))
    assert grain.surface_mesh().bounds.max() < 1e3
