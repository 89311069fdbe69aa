"""Numbers and masks that make no fit: a named error or a documented verdict for each."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import FitError, GrainError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit, start_fit
from mbstudio.core.units import VoxelSize

UM = VoxelSize(1, 1, 1, "um")
BALL = ((np.indices((13, 13, 13)) - 6) ** 2).sum(axis=0) < 30


@pytest.mark.parametrize("n", [0, -3, 2.5, float("nan"), float("inf"), "x", None, True])
@pytest.mark.parametrize("method", ["fast", "paper"])
def test_n_is_a_whole_number_from_one_on(n: object, method) -> None:
    with pytest.raises(FitError, match=r"n = .* is not possible for grain 'grain'"):
        start_fit(Grain(BALL, UM), n, method)  # type: ignore[arg-type]


def test_one_control_point_is_a_ball() -> None:
    result = fit(Grain(BALL, UM), 1)
    assert result.verdict.valid
    # One control point at distance r of f = k / r**2 = 1.
    assert 4 / 3 * np.pi * result.avatar.weights[0] ** 1.5 == pytest.approx(BALL.sum(), rel=0.01)


@pytest.mark.parametrize(("shape", "n"), [((1, 1, 1), 2), ((1, 1, 2), 3), ((3, 3, 3), 28)])
def test_more_control_points_than_voxels_name_the_greatest_number(
    shape: tuple[int, int, int], n: int
) -> None:
    with pytest.raises(FitError, match=r"cannot hold n = \d+ control points: ask for n = \d+ or fewer"):
        fit(Grain(np.ones(shape, dtype=bool), UM), n)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 2)])
def test_one_or_two_voxels_are_flagged(shape: tuple[int, int, int]) -> None:
    result = fit(Grain(np.ones(shape, dtype=bool), UM), 1)
    assert not result.verdict.valid
    assert "voxels are too few" in result.verdict.reasons[0]


def test_two_pieces_are_refused() -> None:
    mask = np.zeros((5, 5, 20), dtype=bool)
    mask[:, :, :5] = mask[:, :, 10:] = True
    with pytest.raises(GrainError, match="2 separate pieces"):
        Grain.from_mask(mask, "1 um")
    with pytest.raises(FitError, match=r"'split'.*2 separate pieces"):
        fit(Grain(mask, UM, name="split"), 5)
    assert fit(Grain.from_mask(mask, "1 um", keep="largest"), 8).verdict.volume_error == pytest.approx(
        0, abs=0.01
    )


def test_a_mask_that_fills_its_box_keeps_its_volume() -> None:
    result = fit(Grain(np.ones((12, 14, 16), dtype=bool), UM), 20)
    assert result.verdict.valid
    mesh = result.avatar.mesh(96)
    assert mesh.volume == pytest.approx(12 * 14 * 16, rel=0.01)
    # Faces lie half a voxel beyond the centres of the outermost voxels.
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), [7.5, 6.5, 5.5], atol=0.3)
    np.testing.assert_allclose(mesh.extents, [16, 14, 12], atol=1.5)


@pytest.mark.parametrize("mask", [BALL.astype(np.int32), BALL.astype(np.uint8) * 255, BALL.astype(float)])
def test_masks_of_two_values_are_taken_as_booleans(mask: np.ndarray) -> None:
    expected, result = fit(Grain.from_mask(BALL, "1 um"), 4), fit(Grain.from_mask(mask, "1 um"), 4)
    np.testing.assert_array_equal(result.avatar.weights, expected.avatar.weights)


def test_masks_of_shares_or_nan_are_refused() -> None:
    shares = BALL * 0.5 + (np.indices(BALL.shape).sum(axis=0) % 2) * 0.25
    with pytest.raises(GrainError, match="grey > threshold"):
        Grain.from_mask(shares, "1 um")
    broken = BALL.astype(float)
    broken[6, 6, 6] = np.nan
    with pytest.raises(GrainError, match="not finite"):
        Grain.from_mask(broken, "1 um")
    # Also past the checks of from_mask.
    with pytest.raises(FitError, match="3 axes of float64"):
        fit(Grain(broken, UM), 4)
    with pytest.raises(FitError, match="2 axes of bool"):
        fit(Grain(BALL[6], UM), 4)
