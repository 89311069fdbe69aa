"""The map of deviations: colours that stand for known distances, and what its scale says."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.scene import DARK, Scene
from mbstudio.scene.layers.colour_scale import diverging_colours, readable_unit, round_range
from mbstudio.scene.layers.deviation_map import DeviationSurface, deviation_surface


def ball_grain(radius):
    """Return a voxel ball of this radius in voxels of 10 µm about the origin."""
    side = int(2 * radius + 5)
    middle = side // 2
    z, y, x = np.ogrid[:side, :side, :side]
    mask = (z - middle) ** 2 + (y - middle) ** 2 + (x - middle) ** 2 <= radius**2
    return Grain.from_mask(mask, "10 um", origin=(-10.0 * middle,) * 3)


def one_ball(radius):
    """Return the avatar f = r² / |x|² = 1: a ball."""
    return Avatar(np.zeros((1, 3)), np.array([radius**2]), "um")


@pytest.fixture(scope="module")
def outside():
    return deviation_surface(one_ball(230.0), ball_grain(20), 40)


def test_an_avatar_larger_by_three_voxels_lies_thirty_outside_everywhere(outside):
    found = outside.deviation
    # Voxels of 10 µm: the smoothed surface of a voxel ball is a ball to a third of one.
    assert np.abs(found.distances - 30).max() < 5
    assert found.rms == pytest.approx(30, abs=1.0)


def test_the_colours_tell_outside_from_inside(plotter, outside):
    scene = Scene(plotter)
    scene.look_from("front")

    def middle():
        scene.fit()
        return scene.screenshot()[150, 200].astype(int)

    scene.layers.deviation.set(outside)
    red = middle()
    scene.layers.deviation.set(deviation_surface(one_ball(170.0), ball_grain(20), 40))
    blue = middle()
    assert red[0] > red[2] + 60
    assert blue[2] > blue[0] + 60
    scene.layers.deviation.set(None)
    assert not scene.layers.deviation.holds_something


def test_no_deviation_is_the_middle_of_the_scale(plotter, outside):
    scene = Scene(plotter, DARK)
    nothing = outside.deviation.__class__(np.zeros(len(outside.surface.points)), 0.0, 0.0, "um")
    nothing.distances[0] = 5.0  # far round the back, so that the scale reaches somewhere
    scene.layers.deviation.set(DeviationSurface(outside.surface, nothing))
    scene.look_from("front")
    colour = scene.screenshot()[150, 200].astype(int)
    assert np.ptp(colour) < 12, "a light grey without hue"


def test_the_scale_says_rms_and_largest_with_units(plotter, outside):
    scene = Scene(plotter)
    scene.layers.deviation.set(outside)
    scale = scene.layers.deviation.scale
    assert scale.heading.GetInput() == "Deviation (µm)"
    largest = np.abs(outside.deviation.distances).max()
    assert f"largest +{largest:.3g} µm" in scale.foot.GetInput()
    assert f"rms {outside.deviation.rms:.3g} µm" in scale.foot.GetInput()
    ticks = [text.GetInput() for text in scale.ticks]
    assert ticks[2] == "0"
    assert ticks[0] == ticks[4].replace("+", "\N{MINUS SIGN}")
    assert float(ticks[4]) == scene.layers.deviation.reach
    assert largest * 0.97 <= scene.layers.deviation.reach <= 1.34 * largest


def test_the_scale_is_there_with_the_map_only(plotter, outside):
    scene = Scene(plotter)
    scene.layers.deviation.set(outside)
    scene.show_layers({"deviation"})
    scene.look_from("front")
    # The strip of colours in the upper right corner holds its deepest blue and red.
    corner = scene.screenshot()[:240, 340:].astype(int).reshape(-1, 3)
    for end in diverging_colours()[[0, -1]]:
        assert (np.abs(corner - end).max(axis=1) < 12).any()
    scene.show_layers({"avatar"})
    corner = scene.screenshot()[:240, 340:].astype(int).reshape(-1, 3)
    assert not (np.abs(corner - diverging_colours()[-1]).max(axis=1) < 12).any()


def test_the_map_is_symmetric_and_light_in_the_middle():
    colours = diverging_colours(65).astype(float)
    lightness = colours @ [0.2126, 0.7152, 0.0722]
    assert np.argmax(lightness) == 32
    np.testing.assert_allclose(lightness, lightness[::-1], atol=45)
    assert (np.diff(lightness[:33]) > 0).all()
    assert (np.diff(lightness[32:]) < 0).all()
    assert colours[5, 2] > colours[5, 0] + 60
    assert colours[-6, 0] > colours[-6, 2] + 60


@pytest.mark.parametrize(("length", "expected"), [(0.0317, 0.04), (23.3, 24), (1.0, 1.0), (9.7, 10), (0, 1)])
def test_the_scale_ends_at_a_round_number(length, expected):
    assert round_range(length) == pytest.approx(expected)


def test_units_make_the_numbers_short():
    assert readable_unit(0.004, "mm") == (pytest.approx(1000), "µm")
    assert readable_unit(1200, "um") == (pytest.approx(1e-3), "mm")


def test_the_surface_that_is_coloured_is_the_avatars(outside):
    mesh = trimesh.Trimesh(outside.surface.points, outside.surface.triangles)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 230**3, rel=0.02)
