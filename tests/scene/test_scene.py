"""What a scene shows: layers, slices where they belong, colours, the scale bar, the pick."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.grains import GrainSet
from mbstudio.core.metaball import Avatar
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.scene import DARK, LIGHT, Scene
from mbstudio.scene.layers.annotations import readable_length, round_length
from mbstudio.scene.layers.slices import cut, grey_window, slice_image
from mbstudio.scene.layers.volume import volume_voxels
from mbstudio.scene.surfaces import avatar_surface, avatars_surface, control_points, label_surface, surface_of
from mbstudio.scene.theme import rgb
from tests.scene.conftest import flatten

SIZE = VoxelSize(20, 10, 10, "um")


@pytest.fixture
def scan(rng):
    grey = rng.integers(50, 60, (24, 32, 40)).astype(np.uint8)
    grey[8:16, 10:22, 12:28] = 200
    return Scan(grey, SIZE, (100.0, 200.0, 300.0))


@pytest.fixture
def grains():
    import pandas as pd

    labels = np.zeros((24, 32, 40), dtype=np.int32)
    labels[4:20, 4:28, 3:18] = 4
    labels[4:20, 4:28, 22:37] = 9
    return GrainSet(labels, pd.DataFrame({"label": [4, 9]}), SIZE, (100.0, 200.0, 300.0))


def ball(radius, centre=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    mesh.apply_translation(centre)
    return surface_of(mesh)


def covered(picture, colour, background):
    far = np.abs(picture.astype(int) - rgb(background)).max(axis=2) > 60
    near = np.abs(picture.astype(int) - rgb(colour)).max(axis=2) < 40
    return far & near


def test_slices_stand_where_they_were_cut(plotter, scan):
    scene = Scene(plotter)
    scene.set_scan(scan)
    scene.layers.slices.planes.move("z", 20)
    scene.layers.slices.planes.move("x", 0)
    bounds = {axis: plane.GetBounds() for axis, plane in scene.layers.slices.planes._planes.items()}
    # Voxel size 20 x 10 x 10 (z, y, x), first voxel's centre at (100, 200, 300).
    assert bounds["z"][4:] == pytest.approx((700, 700))
    assert bounds["z"][:4] == pytest.approx((100, 490, 200, 510))
    assert bounds["x"][:2] == pytest.approx((100, 100))
    assert bounds["x"][4:] == pytest.approx((300, 760))


def test_a_slice_beyond_the_scan_is_its_last(plotter, scan):
    scene = Scene(plotter)
    scene.set_scan(scan)
    scene.layers.slices.planes.move("y", 999)
    assert scene.layers.slices.planes.index["y"] == 31


def test_the_picture_of_a_slice_obeys_the_window(scan):
    grey = cut(scan.voxels, "z", 10)
    image = slice_image(grey, (100.0, 150.0))
    assert image[15, 20].tolist() == [255, 255, 255]
    assert image[0, 0].tolist() == [0, 0, 0]
    assert cut(scan.voxels, "x", 5).shape == (24, 32)
    assert cut(scan.voxels, "y", 5).shape == (24, 40)


def test_grains_are_outlined_and_their_inside_stays_grey():
    labels = np.zeros((20, 20), dtype=np.int32)
    labels[5:15, 5:15] = 1
    image = slice_image(np.full((20, 20), 128, np.uint8), (0.0, 255.0), labels)
    grey = (image == image[..., :1]).all(axis=2)
    coloured = ~grey
    assert coloured.sum() == 4 * 9
    assert coloured[5, 5]
    assert not coloured[4, 4]
    assert not coloured[10, 10]


def test_the_window_ignores_the_empty_box_and_what_is_no_number():
    grey = np.zeros((12, 64, 64), dtype=np.float32)
    y, x = np.ogrid[:64, :64]
    inside = (y - 32) ** 2 + (x - 32) ** 2 < 25**2
    grey[:, inside] = np.linspace(1000, 2000, inside.sum())
    grey[5, 32, 32] = np.nan
    low, high = grey_window(Scan(grey, SIZE))
    assert 1000 <= low < 1020
    assert 1980 < high <= 2000


def test_layers_show_and_hide(plotter):
    scene = Scene(plotter, LIGHT)
    scene.layers.grain.set(ball(10), "um")
    scene.layers.avatar.set(ball(9))
    scene.layers.grain.set_opacity(1.0)
    scene.look_from("front")
    only_grain = scene.screenshot()
    middle = only_grain[150, 200].astype(int)
    assert np.abs(middle - rgb(LIGHT.grain)).max() < 60
    scene.show_layers({"avatar"})
    middle = scene.screenshot()[150, 200].astype(int)
    assert np.abs(middle - rgb(LIGHT.avatar)).max() < 60
    scene.show_layers(set())
    assert scene.screenshot().std() < 30


def test_the_avatar_is_seen_through_the_grain(plotter):
    scene = Scene(plotter, LIGHT)
    scene.layers.grain.set(ball(10), "um")
    scene.layers.grain.set_opacity(0.4)
    scene.look_from("front")
    without = scene.screenshot()[150, 200].astype(int)
    scene.layers.avatar.set(ball(8))
    through = scene.screenshot()[150, 200].astype(int)
    assert through[2] - through[0] > without[2] - without[0] + 30, "no blue shines through the sand colour"


def test_fit_brings_all_into_the_picture(plotter):
    scene = Scene(plotter)
    scene.layers.grain.set(ball(3, (1000, 2000, -500)), "um")
    scene.look_from("isometric")
    flatten(scene, "grain")
    mask = scene.screenshot().mean(axis=2) > 127
    rows, columns = np.nonzero(mask)
    # A ball fills 1 / 1.14 of the height and stands in the middle.
    assert np.ptp(rows) == pytest.approx(300 / 1.14, abs=4)
    assert rows.mean() == pytest.approx(150, abs=2)
    assert columns.mean() == pytest.approx(200, abs=2)
    assert mask.sum() == pytest.approx(np.pi / 4 * (300 / 1.14) ** 2, rel=0.03)


def test_views_look_from_where_they_say(plotter):
    scene = Scene(plotter)
    scene.layers.grain.set(ball(1), "um")
    camera = plotter.renderer.GetActiveCamera()
    for view, direction in (("top", (0, 0, -1)), ("front", (0, 1, 0)), ("left", (1, 0, 0))):
        scene.look_from(view)
        np.testing.assert_allclose(camera.GetDirectionOfProjection(), direction, atol=1e-9)


def test_the_grain_under_a_pixel_has_its_label(plotter, grains):
    scene = Scene(plotter)
    scene.layers.grains.set(label_surface(grains), "um")
    scene.look_from("top")
    scene.screenshot()
    assert scene.label_at(130, 150) == 4
    assert scene.label_at(270, 150) == 9
    assert scene.label_at(2, 2) is None
    assert scene.label_at(200, 150) is None, "between the two"


def test_the_overview_lies_over_the_scan(grains):
    surface = label_surface(grains)
    four = surface.points[np.unique(surface.triangles[surface.labels == 4])]
    # Voxels 3..17 along x of 10 µm from 100; 4..19 along z of 20 µm from 300.
    assert four[:, 0].min() == pytest.approx(100 + 2.5 * 10, abs=4)
    assert four[:, 0].max() == pytest.approx(100 + 17.5 * 10, abs=4)
    assert four[:, 2].max() == pytest.approx(300 + 19.5 * 20, abs=8)


def test_choosing_a_grain_greys_the_others(plotter, grains):
    scene = Scene(plotter)
    scene.layers.grains.set(label_surface(grains), "um")
    mesh = scene.layers.grains.actors[0].mapper.dataset
    scene.select(9)
    colours, labels = np.asarray(mesh.cell_data["colour"]), np.asarray(mesh.cell_data["label"])
    assert (colours[labels == 9] == rgb(LIGHT.grain)).all()
    assert np.ptp(colours[labels == 4][0].astype(int)) < 40
    scene.select(None)
    assert np.ptp(np.asarray(mesh.cell_data["colour"])[labels == 4][0].astype(int)) > 40


def test_many_chosen_grains_stand_solid_among_glass(plotter, grains):
    scene = Scene(plotter)
    scene.layers.grains.set(label_surface(grains), "um")
    scene.select(4, {9})
    assert scene.chosen == {4, 9}
    scene.look_from("top")
    glass = scene.screenshot()[150, 270].astype(int)
    scene.layers.grains.set_chosen(label_surface(grains, only={9}))
    solid = scene.screenshot()[150, 270].astype(int)
    assert np.ptp(solid) > 2 * np.ptp(glass)
    scene.layers.grains.set_chosen(None)
    assert (scene.screenshot()[150, 270] == glass).all()


def test_a_grain_cut_out_is_closed_where_it_touches_another(grains):
    import trimesh

    labels = grains.labels.copy()
    labels[4:20, 4:28, 18:22] = 4  # now they touch
    grains = GrainSet(labels, grains.table, grains.voxel_size, grains.origin)
    alone = label_surface(grains, only={9})
    assert set(alone.labels) == {9}
    mesh = trimesh.Trimesh(alone.points, alone.triangles)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(16 * 24 * 15 * 2000, rel=0.06)


def test_an_overview_that_was_never_drawn_is_coloured(plotter, grains):
    import gc

    scene = Scene(plotter)
    scene.show_layers({"slices"})
    scene.layers.grains.set(label_surface(grains), "um")
    gc.collect()
    scene.select(9)
    scene.show_layers({"grains"})
    scene.look_from("top")
    picture = scene.screenshot().astype(int)
    # The chosen one has the grains' sand colour, the other hardly any.
    assert np.ptp(picture[150, 270]) > np.ptp(picture[150, 130]) + 10


def test_the_theme_changes_background_and_surfaces(plotter):
    scene = Scene(plotter, LIGHT)
    scene.layers.avatar.set(ball(1), "um")
    scene.look_from("front")
    assert scene.screenshot()[3, 3].mean() > 200
    scene.set_theme(DARK)
    assert scene.screenshot()[3, 3].mean() < 60
    assert scene.layers.avatar.actors[0].prop.color.hex_rgb == DARK.avatar


def test_the_scale_bar_is_a_round_length_and_as_long_as_it_says(plotter):
    scene = Scene(plotter, LIGHT)
    scene.layers.grain.set(ball(100), "um")
    scene.look_from("front")
    scene.screenshot()
    bar = scene._bar
    assert bar.length == 50
    ends = [bar._points.GetPoint(index)[0] for index in (0, 1)]
    camera = plotter.renderer.GetActiveCamera()
    per_pixel = 2 * camera.GetParallelScale() / 300
    assert (ends[1] - ends[0]) * per_pixel == pytest.approx(50)
    assert bar._text.GetInput() == "50 µm"


@pytest.mark.parametrize(("length", "expected"), [(1.0, 1.0), (1.9, 1), (4.99, 2), (0.07, 0.05), (730, 500)])
def test_round_lengths(length, expected):
    assert round_length(length) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("length", "unit", "text"),
    [(2000, "um", "2 mm"), (0.5, "mm", "500 µm"), (3.2, "mm", "3.2 mm"), (2, "m", "2 m")],
)
def test_readable_lengths(length, unit, text):
    assert readable_length(length, unit) == text


def test_one_control_point_is_a_ball_with_normals_outward():
    # f = k / r² = 1 at r = sqrt(k) = 5.
    avatar = Avatar(np.array([[10.0, 20.0, 30.0]]), np.array([25.0]), "um", label=6)
    surface = avatar_surface(avatar, 40)
    away = surface.points - np.array([10, 20, 30])
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 5, rtol=0.01)
    np.testing.assert_allclose(surface.normals, away / np.linalg.norm(away, axis=1, keepdims=True), atol=0.01)
    both = avatars_surface([avatar, avatar], 16)
    assert set(both.labels.tolist()) == {6}
    assert both.triangles.max() == len(both.points) - 1


def test_control_points_are_balls_at_their_places():
    centers = np.array([[0.0, 0, 0], [10, 0, 0]])
    surface = control_points(Avatar(centers, np.array([4.0, 4.0]), "um"))
    halves = surface.points.reshape(2, -1, 3)
    np.testing.assert_allclose((halves.min(axis=1) + halves.max(axis=1)) / 2, centers, atol=1e-5)
    mesh = trimesh.Trimesh(surface.points, surface.triangles)
    assert mesh.volume > 0


def test_the_volume_is_thinned_to_the_limit(scan):
    voxels = volume_voxels(scan, longest=16)
    assert voxels.grey.shape == (8, 11, 14)
    assert voxels.spacing == (30, 30, 60)
    assert voxels.grey[4, 5, 6] == 200


def test_the_volume_is_to_be_seen(plotter, scan):
    scene = Scene(plotter, LIGHT)
    scene.set_scan(scan)
    scene.look_from("isometric")
    scene.show_layers(set())
    before = scene.screenshot()
    scene.show_layers({"volume"})
    scene.layers.volume.set(volume_voxels(scan))
    assert (np.abs(scene.screenshot().astype(int) - before).max(axis=2) > 30).mean() > 0.02


def test_taking_the_scan_away_leaves_nothing(plotter, scan):
    scene = Scene(plotter, LIGHT)
    nothing = scene.screenshot()
    scene.set_scan(scan)
    scene.look_from("isometric")
    assert scene.screenshot().std() > nothing.std() + 5
    scene.set_scan(None)
    scene.look_from("front")
    assert np.abs(scene.screenshot()[20:150].astype(int) - nothing[20:150]).max() < 5
