"""Lengths and their units."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.errors import UnitError
from mbstudio.core.units import METRES_PER_UNIT, VoxelSize, conversion_factor, parse_unit

lengths = st.floats(1e-6, 1e6, allow_nan=False)
units = st.sampled_from(sorted(METRES_PER_UNIT))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("14 um", (14, 14, 14, "um")),
        ("14um", (14, 14, 14, "um")),
        ("14 µm", (14, 14, 14, "um")),
        ("0.014 mm", (0.014, 0.014, 0.014, "mm")),
        ("1.4e-2 millimetre", (0.014, 0.014, 0.014, "mm")),
        ("20 x 14 x 13 um", (20, 14, 13, "um")),
        ("20, 14, 13 um", (20, 14, 13, "um")),
    ],
)
def test_texts_of_a_voxel_size(text: str, expected: tuple[float, float, float, str]) -> None:
    size = VoxelSize.parse(text)
    assert (size.z, size.y, size.x, size.unit) == expected


@pytest.mark.parametrize(
    "bad", ["-14 um", "0 um", "nan um", "um", "", "14", "14 parsec", "14 x 14 um", "1 2 3 4 um", "14 um um"]
)
def test_impossible_voxel_sizes_are_refused(bad: str) -> None:
    with pytest.raises(UnitError):
        VoxelSize.parse(bad)


def test_numbers_need_a_unit() -> None:
    with pytest.raises(UnitError, match="no unit"):
        VoxelSize.parse(14.0)
    assert VoxelSize.parse([20, 14, 13], "um").zyx == (20, 14, 13)
    with pytest.raises(UnitError, match="impossible"):
        VoxelSize.parse(float("inf"), "um")


@given(lengths, lengths, lengths, units)
def test_a_printed_size_is_read_back(z: float, y: float, x: float, unit: str) -> None:
    size = VoxelSize.parse(f"{z!r} x {y!r} x {x!r} {unit}")
    assert (size.z, size.y, size.x, size.unit) == (z, y, x, unit)


@given(lengths, units, units)
def test_changing_the_unit_keeps_the_length(edge: float, first: str, second: str) -> None:
    size = VoxelSize(edge, edge, edge, first)
    there = size.to(second)
    assert there.x * METRES_PER_UNIT[second] == pytest.approx(edge * METRES_PER_UNIT[first], rel=1e-12)
    assert there.to(first).x == pytest.approx(edge, rel=1e-12)


def test_known_factors() -> None:
    assert conversion_factor("mm", "um") == pytest.approx(1000)
    assert conversion_factor("cm", "m") == pytest.approx(0.01)
    assert parse_unit("Micrometres") == "um"


def test_positions_turn_indices_into_points() -> None:
    size = VoxelSize(3, 2, 1, "mm")
    points = size.positions(np.array([[1, 10, 100]]), origin=(0.5, 0.0, -1.0))
    assert points.tolist() == [[100.5, 20.0, 2.0]]
    assert size.volume == 6
    assert not size.is_isotropic
