from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.metaball import Avatar
from mbstudio.scene.pictures.thumbnails import thumbnail


def test_a_ball_is_a_shaded_disc() -> None:
    ball = Avatar(np.array([[5.0, 0.0, 0.0]]), np.array([4.0]), "mm")
    picture = thumbnail(ball, "#c08040", 64, reach=4.0)
    # Half the width shown is 4 mm and a margin of 12 %, the ball's radius 2 mm.
    share = (picture[..., 3] / 255).mean()
    assert share == pytest.approx(np.pi * (2.0 / (2 * 4.0 * 1.12)) ** 2, rel=0.03)
    inside = picture[..., 3] == 255
    assert picture[inside][:, 0].std() > 10  # shaded
    assert (picture[inside][:, 0] >= picture[inside][:, 2]).all()  # of its colour
    rows, columns = np.nonzero(inside)
    assert abs(rows.mean() - 31.5) < 1
    assert abs(columns.mean() - 31.5) < 1


def test_a_larger_grain_fills_more_of_the_same_frame() -> None:
    small, large = (Avatar(np.zeros((1, 3)), np.array([k]), "mm") for k in (1.0, 4.0))
    cover = [(thumbnail(grain, "#808080", 48, reach=3.0)[..., 3] > 0).sum() for grain in (small, large)]
    assert cover[1] == pytest.approx(4 * cover[0], rel=0.1)
