"""Clones: form and size as asked, faces and edges as the parent's, nothing folded."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mbstudio.core.cloning.clone_maker import (
    CloneMap,
    CloneOptions,
    CloneRecipe,
    make_surface,
    stretches,
)
from mbstudio.core.cloning.recipe_drawing import draw_recipes
from mbstudio.core.cloning.solid_moments import principal_form, solid_moments
from mbstudio.core.cloning.surface_style import SurfaceStyle, learn_surfaces
from mbstudio.core.errors import CloningError


@given(st.integers(0, 10_000))
@settings(max_examples=25)
def test_form_and_size_are_those_of_the_recipe(style: SurfaceStyle, seed: int) -> None:
    (recipe,) = draw_recipes(style, 1, seed)
    surface = make_surface(style, recipe)
    moments = solid_moments(surface.vertices, surface.faces)
    assert moments.volume == pytest.approx(np.pi / 6 * recipe.diameter**3)
    assert moments.centre == pytest.approx(np.zeros(3), abs=1e-9 * recipe.diameter)
    semi_axes, _ = principal_form(moments)
    logs = np.log(semi_axes)
    assert logs - logs.mean() == pytest.approx(recipe.form, abs=1e-9)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent


def test_forms_and_sizes_are_spread_as_the_parents_are(style: SurfaceStyle) -> None:
    rng = np.random.default_rng(1)
    drawn = [style.draw_form_and_size(rng) for _ in range(4000)]
    forms = np.stack([form for form, _ in drawn])
    sizes = np.log([size for _, size in drawn])
    error = style.forms.std(axis=0, ddof=1) / np.sqrt(len(style.parents))
    assert (abs(forms.mean(axis=0) - style.forms.mean(axis=0)) < 0.5 * error + 0.01).all()
    assert forms.std(axis=0) == pytest.approx(style.forms.std(axis=0), rel=0.1)
    assert sizes.mean() == pytest.approx(style.log_diameters.mean(), abs=0.02)
    assert sizes.std() == pytest.approx(style.log_diameters.std(), rel=0.1)


def test_no_parent_is_stretched_more_than_allowed(style: SurfaceStyle) -> None:
    options = CloneOptions(stretch=1.25)
    found = np.stack([stretches(style, recipe) for recipe in draw_recipes(style, 60, 2, options)])
    assert np.prod(found, axis=1) == pytest.approx(np.ones(60))
    # Forms beyond what any parent reaches within the bound take the least stretch there is.
    assert np.mean(found[:, 0] <= 1.25 + 1e-12) > 0.9
    assert found.max() < 1.5


def test_without_warp_planes_stay_plane() -> None:
    """A linear map of a box is a box with slanted faces: still twelve triangles in six planes."""
    boxes = []
    for size in ((1.0, 1.2, 1.5), (1.1, 1.2, 1.3)):
        box = trimesh.creation.box(size)
        box = box.subdivide()
        box.units = "mm"
        boxes.append(box)
    style = learn_surfaces(boxes)
    (recipe,) = draw_recipes(style, 1, 0, CloneOptions(warping=0.0, detail_stretch=1.0))
    surface = make_surface(style, recipe)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    angles = mesh.face_adjacency_angles
    assert ((angles < 1e-6) | (angles > 0.5)).all()
    assert len({tuple(normal) for normal in mesh.face_normals.round(6)}) == 6


def test_details_are_turned_and_not_stretched(style: SurfaceStyle) -> None:
    """A parent with a bump, stretched to twice its length: across the bump it stays as wide as it was."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    direction = np.array([0.0, 0.0, 1.0])
    away = np.arccos(np.clip(ball.vertices @ direction, -1, 1))
    bumped = trimesh.Trimesh(ball.vertices * (1 + 0.1 * np.exp(-((away / 0.15) ** 2)))[:, None], ball.faces)
    bumped.units = "mm"
    learned = learn_surfaces([bumped, style.parents[1].mesh()])
    parent = learned.parents[0]
    peak = np.linalg.norm(parent.details, axis=1).argmax()
    form = np.log([2.0, 1.0, 0.5])
    recipes = {
        share: CloneRecipe(0, form, np.eye(3), np.zeros(len(learned.modes)), 1.0, share)
        for share in (0.0, 1.0)
    }
    heights = {}
    for share, recipe in recipes.items():
        vertices = make_surface(learned, recipe).vertices
        smooth = parent.vertices - parent.details
        scale = np.cbrt(np.prod(parent.semi_axes)) * np.exp(form)
        heights[share] = np.linalg.norm(vertices[peak] - smooth[peak] * scale)
    own = np.linalg.norm(parent.details[peak] * parent.semi_axes)
    assert heights[0.0] == pytest.approx(own, rel=0.15)
    assert abs(heights[1.0] / own - 1) > 0.3
    # Form and volume are exact either way.
    for recipe in recipes.values():
        moments = solid_moments(*make_surface(learned, recipe))
        axes, _ = principal_form(moments)
        assert np.log(axes / np.cbrt(np.prod(axes))) == pytest.approx(form, abs=1e-9)
        assert moments.volume == pytest.approx(np.pi / 6)


def test_a_mirrored_parent_is_wound_outwards(style: SurfaceStyle) -> None:
    shares = np.zeros(len(style.modes))
    recipe = CloneRecipe(0, style.parents[0].log_form, np.diag([1.0, 1.0, -1.0]), shares, 2.0)
    surface = make_surface(style, recipe)
    assert solid_moments(surface.vertices, surface.faces).volume > 0
    wanted = style.parents[0].body_vertices() * [1, 1, -1] * 2.0
    assert surface.vertices == pytest.approx(wanted, abs=1e-9)


def test_control_points_and_surface_go_the_same_way(style: SurfaceStyle) -> None:
    (recipe,) = draw_recipes(style, 1, 3, CloneOptions(detail_stretch=1.0))
    clone_map = CloneMap(style, recipe)
    vertices = style.parents[recipe.parent].vertices
    assert clone_map(vertices) == pytest.approx(clone_map.surface.vertices, abs=1e-9)
    points, step = 0.3 * vertices[:5], 1e-5
    slopes = np.stack(
        [(clone_map(points + step * e) - clone_map(points - step * e)) / (2 * step) for e in np.eye(3)],
        axis=2,
    )
    assert clone_map.scale_at(points) == pytest.approx(np.cbrt(abs(np.linalg.det(slopes))), rel=1e-6)


def test_warps_that_fold_every_parent_are_refused(style: SurfaceStyle) -> None:
    options = CloneOptions(warping=1.5, local_stretch=1.001)
    with pytest.raises(CloningError, match="ask for less warping"):
        draw_recipes(style, 1, 0, options)


def test_one_parent_is_too_few(style: SurfaceStyle) -> None:
    with pytest.raises(CloningError, match="1 parent is too few"):
        SurfaceStyle(style.parents[:1], style.modes, 0.0)


def test_each_parent_has_its_turn_in_every_round(style: SurfaceStyle) -> None:
    parents = len(style.parents)
    recipes = draw_recipes(style, 3 * parents, 6)
    for start in range(0, 3 * parents, parents):
        assert sorted(recipe.parent for recipe in recipes[start : start + parents]) == list(range(parents))
    few = draw_recipes(style, parents + 3, 6)
    for one, other in zip(few, recipes, strict=False):
        assert (one.turn == other.turn).all()
        assert (one.warp == other.warp).all()
        assert one.diameter == other.diameter


def test_no_clone_is_a_copy(style: SurfaceStyle) -> None:
    found = np.stack([stretches(style, recipe) for recipe in draw_recipes(style, 60, 7)])
    needed = np.maximum(found[:, 0], 1 / found[:, 2])
    assert np.mean(needed >= 1.08) > 0.8
