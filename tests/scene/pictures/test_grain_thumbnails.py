"""Small pictures of grains: what they show of bodies whose outline is known."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.grains import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.scene.pictures.grain_thumbnails import grain_thumbnail
from mbstudio.scene.pictures.thumbnails import thumbnail

COLOUR = "#d0a060"


def ball(radius, spacing=(1.0, 1.0, 1.0)):
    half = [int(np.ceil(radius / step)) + 1 for step in spacing]
    z, y, x = np.ogrid[tuple(slice(-h, h + 1) for h in half)]
    mask = (z * spacing[0]) ** 2 + (y * spacing[1]) ** 2 + (x * spacing[2]) ** 2 <= radius**2
    return Grain.from_mask(mask, spacing, unit="um")


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (2.5, 1.0, 1.0)])
def test_a_ball_is_a_disc_that_fills_the_picture(spacing):
    cover = grain_thumbnail(ball(20, spacing), COLOUR, 96)[..., 3] / 255
    # The picture shows 1.12 times the radius to each side.
    assert cover.sum() == pytest.approx(np.pi * (48 / 1.12) ** 2, rel=0.06)
    rows, columns = np.nonzero(cover > 0.5)
    assert rows.mean() == pytest.approx(47.5, abs=0.6)
    assert columns.mean() == pytest.approx(47.5, abs=0.6)
    assert np.ptp(rows) == pytest.approx(np.ptp(columns), abs=2)


def test_a_ball_is_lit_as_the_avatar_of_a_ball_is():
    """One control point is a ball: its picture, made by rays, and that of the voxels agree."""
    avatar = thumbnail(Avatar(np.zeros((1, 3)), np.array([400.0]), "um"), COLOUR, 72).astype(float)
    grain = grain_thumbnail(ball(20), COLOUR, 72).astype(float)
    both = (avatar[..., 3] > 250) & (grain[..., 3] > 250)
    assert both.sum() > 0.9 * (avatar[..., 3] > 250).sum()
    assert np.abs(avatar - grain)[both][:, :3].mean() < 8


def test_a_rod_along_z_stands_upright():
    mask = np.ones((60, 8, 8), dtype=bool)
    picture = grain_thumbnail(Grain.from_mask(mask, 1.0, unit="um"), COLOUR, 72)
    rows, columns = np.nonzero(picture[..., 3] > 127)
    assert np.ptp(rows) > 3 * np.ptp(columns)


def test_a_large_grain_and_a_single_voxel_have_pictures():
    assert (grain_thumbnail(ball(120), COLOUR)[..., 3] > 250).mean() > 0.5
    voxel = Grain.from_mask(np.ones((1, 1, 1), dtype=bool), 1.0, unit="um")
    assert (grain_thumbnail(voxel, COLOUR)[..., 3] > 0).any()
