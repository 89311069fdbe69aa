"""Labels over a slice: filled, outlined with a halo, some of them alone."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.scene.label_overlay import HALO, LabelLook, label_overlay, vivid
from mbstudio.scene.theme import label_colours


@pytest.fixture
def labels():
    """Two squares that touch, in void."""
    found = np.zeros((20, 30), np.int32)
    found[5:15, 5:15] = 1
    found[5:15, 15:25] = 2
    return found


def test_the_fill_has_the_colour_and_opacity_asked_for(labels):
    colours = label_colours(2)
    picture = label_overlay(labels, colours, LabelLook(opacity=0.4, outlines=False))
    assert (picture[labels == 1] == (*colours[1], 102)).all()
    assert (picture[labels == 2] == (*colours[2], 102)).all()
    assert (picture[labels == 0, 3] == 0).all()


def test_an_outline_lies_inside_its_grain_with_a_dark_halo_on_both_sides(labels):
    colours = label_colours(2)
    picture = label_overlay(labels, colours, LabelLook())
    rim = np.zeros_like(labels, dtype=bool)
    rim[5:15, 5:25] = True
    rim[6:14, 6:14] = rim[6:14, 16:24] = False
    line = picture[..., 3] == 255
    assert (line == rim).all()
    assert (picture[5, 8, :3] == vivid(colours)[1]).all()
    assert (picture[8, 14, :3] == vivid(colours)[1]).all()
    assert (picture[8, 15, :3] == vivid(colours)[2]).all()
    for inner, outer in (((6, 8), (4, 8)), ((8, 6), (8, 4))):
        assert (picture[inner][:3] == HALO).all()
        assert (picture[outer][:3] == HALO).all()
    assert (picture[10, 10] == 0).all()


def test_an_outline_differs_from_every_grey():
    """Contrast of the line against its halo, whatever lies below both."""
    colours = vivid(label_colours(16))[1:].astype(float)
    assert (colours.max(axis=1) > 120).all()
    assert max(HALO) < 20


def test_chosen_grains_are_bolder_and_others_may_be_left_out(labels):
    colours = label_colours(2)
    plain = label_overlay(labels, colours, LabelLook())
    bold = label_overlay(labels, colours, LabelLook(bold=frozenset({1})))
    assert ((bold[..., 3] == 255) & (labels == 1)).sum() > 1.5 * (
        (plain[..., 3] == 255) & (labels == 1)
    ).sum()
    assert (
        ((bold[..., 3] == 255) & (labels == 2))[:, 17:] == ((plain[..., 3] == 255) & (labels == 2))[:, 17:]
    ).all()
    alone = label_overlay(labels, colours, LabelLook(opacity=1.0, only=frozenset({2})))
    assert (alone[..., 3][labels == 1][:] != 255).all()
    assert (alone[..., 3][labels == 2] >= 190).all()
