"""Distances and angles of known points, and that they are drawn over everything."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.scene import LIGHT, Scene
from mbstudio.scene.layers.picking import to_display
from mbstudio.scene.surfaces import surface_of
from mbstudio.scene.tools.measurements import Measurement


def ball(radius):
    return surface_of(trimesh.creation.icosphere(subdivisions=4, radius=radius))


def test_a_distance_is_in_the_unit_that_makes_it_short():
    measured = Measurement("distance", np.array([[0.0, 0, 0], [300, 400, 0]]))
    assert measured.value == 500
    assert measured.format_value("um") == "500 µm"
    assert Measurement("distance", measured.points * 10).format_value("um") == "5 mm"


@pytest.mark.parametrize(
    ("third", "angle"),
    [((0, 1, 0), 90.0), ((1, 1, 0), 45.0), ((-1, 0, 0), 180.0), ((5, 0, 0), 0.0), ((1, 1e-4, 0), 0.00573)],
)
def test_an_angle_is_that_at_the_second_point(third, angle):
    points = np.array([[1.0, 0, 0], [0, 0, 0], third]) * 7 + 3
    assert Measurement("angle", points).value == pytest.approx(angle, abs=1e-4)


def test_points_gather_until_a_measurement_is_complete(plotter):
    measurements = Scene(plotter).measurements
    assert measurements.add_point("angle", np.zeros(3)).format_value("um") == ""
    assert not measurements.add_point("angle", np.eye(3)[0]).is_complete
    # Another kind begins anew: what was not ended is forgotten.
    measurements.add_point("distance", np.zeros(3))
    measurements.add_point("distance", np.array([0.0, 0, 2]))
    measurements.add_point("distance", np.zeros(3))
    assert [(given.kind, len(given.points)) for given in measurements.measured] == [
        ("distance", 2),
        ("distance", 1),
    ]
    measurements.drop_unfinished()
    assert [given.format_value("mm") for given in measurements.measured] == ["2 mm"]


def test_a_measurement_through_a_body_is_to_be_seen_over_it(plotter):
    scene = Scene(plotter, LIGHT)
    scene.layers.grain.set(ball(100), "um")
    scene.layers.grain.set_opacity(1.0)
    scene.look_from("front")
    before = scene.screenshot().astype(int)
    for x in (-60.0, 60.0):
        scene.measurements.add_point("distance", np.array([x, 0.0, -20.0]))
    after = scene.screenshot().astype(int)
    # Along its line, deep inside the ball, the picture has the theme's ink.
    places = to_display(scene.plotter.renderer, np.array([[x, 0.0, -20.0] for x in (-40, -20, 10, 40)]))
    for x, y in places:
        row, column = 299 - round(y), round(x)
        changed = np.abs(after - before)[row - 2 : row + 3, column].max(axis=1)
        assert changed.max() > 60, (row, column)
    assert scene.measurements._texts[0].GetInput() == "120 µm"
    scene.measurements.clear()
    assert (scene.screenshot() == before).all()


def test_the_point_under_a_pixel_lies_on_the_surface_or_slice(plotter, rng):
    scene = Scene(plotter)
    scene.layers.grain.set(ball(100), "um")
    scene.look_from("top")
    scene.screenshot()
    x, y = to_display(scene.plotter.renderer, np.array([[30.0, 40.0, 0.0]]))[0]
    point = scene.pick(x, y).point
    np.testing.assert_allclose(point[:2], [30, 40], atol=0.5)
    assert point[2] == pytest.approx(np.sqrt(100**2 - 50**2), rel=0.01)
    assert scene.pick(3, 150) is None
    # A slice before the ball is nearer.
    grey = rng.integers(0, 255, (11, 31, 31)).astype(np.uint8)
    scene.set_scan(Scan(grey, VoxelSize(10, 10, 10, "um"), (-150.0, -150.0, 100.0)))
    np.testing.assert_allclose(scene.pick(x, y).point, [30, 40, 150], atol=0.5)
    scene.show_layers({"grain"})
    assert scene.pick(x, y).point[2] == pytest.approx(86.6, rel=0.01)
