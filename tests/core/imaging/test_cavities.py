"""Cavities inside a grain: filled with a warning, or kept on request."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.batch.many_fits import fit_many
from mbstudio.core.errors import FitError, GrainWarning
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit, start_fit
from mbstudio.core.imaging.preprocess import prepare
from mbstudio.core.metaball.topology import topology

OUTER, INNER = 13.0, 6.0
SHELL = 4 / 3 * np.pi * (OUTER**3 - INNER**3)
BALL = 4 / 3 * np.pi * OUTER**3


def hollow() -> np.ndarray:
    z, y, x = np.indices((31, 31, 31)) - 15
    distance = np.sqrt((x - 0.3) ** 2 + (y - 0.1) ** 2 + (z + 0.2) ** 2)
    return (distance < OUTER) & (distance > INNER)


@pytest.fixture(scope="module")
def shell() -> Grain:
    return Grain.from_mask(hollow(), "1 um", fill_cavities=False)


def test_a_cavity_is_filled_and_the_verdict_says_so(shell: Grain) -> None:
    steps = []
    result = fit(shell, 20, on_step=steps.append)
    assert result.verdict.valid
    assert result.verdict.voids == 0
    assert abs(result.verdict.volume_error) < 0.01  # of the filled grain
    assert result.avatar.mesh(96).volume == pytest.approx(BALL, rel=0.01)
    (told,) = result.verdict.warnings
    assert "were filled" in told
    assert "cavities='keep'" in told
    filled = round(BALL - SHELL)
    assert abs(int(told.split("of ")[1].split()[0]) - filled) < 0.06 * filled
    assert "were filled" in steps[0].note


def test_a_cavity_is_kept_on_request(shell: Grain) -> None:
    result = fit(shell, 60, cavities="keep")
    assert result.verdict.valid, result.verdict.reasons
    assert result.verdict.voids == 1
    assert topology(result.avatar.control, cells=128).voids == 1
    assert "kept as requested" in result.verdict.warnings[0]
    # The surface has an inner part that bounds nothing solid; the signed volume of both is the shell's.
    assert result.avatar.mesh(128).volume == pytest.approx(SHELL, rel=0.02)
    assert result.avatar.field(np.array([shell.centroid]))[0] < 1


def test_kept_cavities_are_counted() -> None:
    mask = np.ones((13, 13, 25), dtype=bool)
    mask[4:9, 4:9, 4:9] = mask[4:9, 4:9, 14:19] = False
    grain = Grain.from_mask(mask, "1 um", fill_cavities=False)
    kept, filled = prepare(grain, cavities="keep"), prepare(grain)
    assert (kept.cavities, kept.filled_voxels) == (2, 0)
    assert (filled.cavities, filled.filled_voxels) == (0, 250)


def test_a_mask_filled_when_the_grain_was_made_is_told_of_by_the_fit(shell: Grain) -> None:
    with pytest.warns(GrainWarning, match="cavities='keep'"):
        grain = Grain.from_mask(hollow(), "1 um")
    assert grain.filled_voxels == grain.voxel_count - shell.voxel_count
    result = fit(grain, 10)
    assert result.verdict.valid
    assert str(grain.filled_voxels) in result.verdict.warnings[0]
    (item,) = fit_many([grain], n=10, workers=1)
    assert item.result is not None
    assert item.result.verdict.warnings == result.verdict.warnings


def test_a_grain_without_cavities_warns_of_nothing(ellipsoid_grain: Grain) -> None:
    assert fit(ellipsoid_grain, 5, cavities="keep").verdict.warnings == ()


def test_an_unknown_way_with_cavities_is_named(shell: Grain) -> None:
    for method in ("fast", "paper"):
        with pytest.raises(FitError, match=r"'leave'.*'fill'.*'keep'"):
            start_fit(shell, 10, method, cavities="leave")  # type: ignore[arg-type]
