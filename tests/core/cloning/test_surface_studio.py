"""Grains shaped from surfaces: what is asked for is measured in what comes out, and nothing folds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mbstudio.core.cloning.clone_maker import make_surface
from mbstudio.core.cloning.kept_shapes import keep_shape
from mbstudio.core.cloning.recipe_drawing import draw_recipes
from mbstudio.core.cloning.solid_moments import principal_form, solid_moments
from mbstudio.core.cloning.surface_bands import Gains, Smoothing, combine
from mbstudio.core.cloning.surface_morph import lay_onto
from mbstudio.core.cloning.surface_studio import SHAPE_FACTORS, SurfaceStudio
from mbstudio.core.errors import CloningError
from tests.core.cloning.stone_styles import fitted_stones


@pytest.fixture(scope="module")
def studio() -> SurfaceStudio:
    return SurfaceStudio(fitted_stones())


def test_a_parent_comes_out_as_it_is(studio):
    parent = studio.style.parents[1]
    grain = studio.make(studio.begin(1))
    np.testing.assert_allclose(
        grain.surface.vertices, parent.body_vertices() * parent.diameter, atol=1e-9 * parent.diameter
    )
    assert grain.folded == 0.0
    assert set(grain.values) == set(SHAPE_FACTORS)


def test_a_clone_comes_out_as_it_is(studio):
    recipe = draw_recipes(studio.style, 2, 3)[1]
    grain = studio.make(studio.of_recipe(recipe))
    expected = make_surface(studio.style, recipe)
    np.testing.assert_allclose(grain.surface.vertices, expected.vertices, atol=1e-9 * recipe.diameter)
    np.testing.assert_array_equal(grain.surface.faces, expected.faces)


@pytest.mark.parametrize(
    ("factor", "wanted"), [("size", 7.5), ("elongation", 0.6), ("flatness", 0.45), ("csf", 0.5)]
)
def test_size_and_form_are_exact(studio, factor, wanted):
    shape, held = studio.reach(studio.begin(0), factor, wanted)
    grain = studio.make(shape)
    moments = solid_moments(*grain.surface)
    long, middle, short = principal_form(moments)[0]
    measured = {
        "size": np.cbrt(6 * moments.volume / np.pi),
        "elongation": middle / long,
        "flatness": short / middle,
        "csf": short / np.sqrt(long * middle),
    }
    assert not held
    assert measured[factor] == pytest.approx(wanted, rel=1e-9)
    assert measured == pytest.approx({name: grain.values[name] for name in measured}, rel=1e-9)
    assert grain.is_sound


@pytest.mark.parametrize(
    ("factor", "share"),
    [
        ("sphericity", 0.97), ("sphericity", 1.02), ("convexity", 0.97), ("convexity", 1.005),
        ("roughness", 0.4), ("roughness", 1.6),
    ],
)  # fmt: skip
def test_the_rest_is_reached_and_measured(studio, factor, share):
    begun = studio.begin(2)
    before = studio.make(begun).values
    wanted = share * before[factor]
    shape, held = studio.reach(begun, factor, wanted)
    grain = studio.make(shape)
    assert not held
    mesh = trimesh.Trimesh(*grain.surface, process=False)
    if factor == "sphericity":
        assert np.pi * grain.values["size"] ** 2 / mesh.area == pytest.approx(wanted, rel=1e-3)
    if factor == "convexity":
        assert mesh.volume / mesh.convex_hull.volume == pytest.approx(wanted, rel=1e-3)
    assert grain.values[factor] == pytest.approx(wanted, rel=1e-3)
    for name in ("size", "elongation", "flatness"):
        assert grain.values[name] == pytest.approx(before[name], rel=1e-9)
    assert mesh.is_watertight
    assert grain.is_sound


def test_what_cannot_be_reached_is_held(studio):
    shape, held = studio.reach(studio.begin(0), "sphericity", 0.2)
    assert held
    assert studio.make(shape).is_sound
    rough, held = studio.reach(studio.begin(0), "roughness", 0.9)
    assert held
    assert studio.make(rough).is_sound
    with pytest.raises(CloningError, match=r"flatness 1\.2"):
        studio.reach(studio.begin(0), "flatness", 1.2)
    with pytest.raises(CloningError, match="roundish"):
        studio.reach(studio.begin(0), "roundish", 0.5)
    with pytest.raises(CloningError, match="size -1"):
        studio.reach(studio.begin(0), "size", -1.0)


def test_a_blend_goes_from_one_parent_to_the_other(studio):
    one, other = studio.style.parents[0], studio.style.parents[3]
    ends = [studio.make(studio.blended(studio.begin(0), 3, share)[0]) for share in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(
        ends[0].surface.vertices, one.body_vertices() * one.diameter, atol=1e-9 * one.diameter
    )
    assert ends[2].values["flatness"] == pytest.approx(np.exp(other.log_form[2] - other.log_form[1]))
    assert ends[1].values["size"] == pytest.approx(np.sqrt(one.diameter * other.diameter))
    # The surface lies on the other one, to less than a hundredth of its size.
    assert lay_onto(one, other).misfit < 0.01
    # These are of 320 triangles: corners of the one do not lie where the other has edges.
    itself = studio.make(studio.begin(3)).values
    assert ends[2].values["convexity"] == pytest.approx(itself["convexity"], abs=0.04)
    assert all(grain.is_sound for grain in ends)


def test_warps_are_drawn_by_seed_and_never_fold(studio):
    shape = studio.begin(0)
    one, again = (studio.warped(shape, 0.3, 5)[0] for _ in range(2))
    np.testing.assert_array_equal(one.warp, again.warp)
    assert not np.array_equal(one.warp, studio.warped(shape, 0.3, 6)[0].warp)
    for seed in range(4):
        strong, _ = studio.warped(shape, 1.5, seed)
        assert studio.make(strong).is_sound


def test_bands_add_up(studio):
    parent = studio.style.parents[0]
    layers = Smoothing(parent.vertices, parent.faces).layers(parent.vertices)
    np.testing.assert_allclose(combine(layers, Gains()), parent.vertices, atol=1e-12)
    assert np.linalg.norm(combine(layers, Gains(0, 0, 0)), axis=1) == pytest.approx(1.0)


def test_a_metaball_is_fitted_to_what_was_shaped(studio):
    shape = studio.reach(studio.begin(0), "flatness", 0.6)[0]
    grain = studio.make(replace(shape, gains=Gains(1.1, 0.9, 1.0)))
    fitted = studio.fit(grain)
    assert fitted.avatar.n == len(studio.style.avatars[0].avatar.weights)
    assert fitted.rms < 0.03
    assert abs(fitted.volume_error) < 0.02


def test_a_shaped_grain_is_kept_among_clones(studio):
    grain = studio.make(studio.blended(studio.begin(0), 1, 0.25)[0])
    first = keep_shape(studio, grain, None)
    assert first.names == ("shaped_1",)
    both = keep_shape(studio, studio.make(studio.begin(2)), first)
    assert both.names == ("shaped_1", "shaped_2")
    assert "25 % of stone 1" in both.clones[0].shaped
    assert both.clones[1].shaped == "shaped by hand"
    assert len(both.factors) == 2
    assert both.factors.column("sphericity")[0] == pytest.approx(grain.values["sphericity"], rel=1e-3)
    assert len(both.avatars()) == 2


def test_a_coarse_stand_in_is_nearly_the_parent():
    fine, coarse = SurfaceStudio(fitted_stones()), SurfaceStudio(fitted_stones(), 200)
    one, other = (studio.make(studio.begin(0)) for studio in (fine, coarse))
    assert len(other.surface.faces) <= 200 < len(one.surface.faces)
    assert other.values["convexity"] == pytest.approx(one.values["convexity"], abs=0.02)
