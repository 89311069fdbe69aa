"""Grains that are asked for by several factors: measured anew, they have them; what is impossible is told."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mbstudio.core.cloning.shapes_file import read_shapes, write_shapes
from mbstudio.core.cloning.solid_moments import principal_form, solid_moments
from mbstudio.core.cloning.surface_design import (
    ParentFactors,
    add_difference,
    design,
    move_by,
    reach_all,
)
from mbstudio.core.cloning.surface_studio import SHAPE_FACTORS, SurfaceStudio
from mbstudio.core.errors import CloningError
from tests.core.cloning.stone_styles import fitted_stones


@pytest.fixture(scope="module")
def studio() -> SurfaceStudio:
    return SurfaceStudio(fitted_stones())


@pytest.fixture(scope="module")
def known(studio) -> ParentFactors:
    return ParentFactors.measure(studio)


def independent(surface) -> dict[str, float]:
    """Return factors by trimesh and the moments of the solid."""
    mesh = trimesh.Trimesh(*surface, process=False)
    long, middle, short = principal_form(solid_moments(*surface))[0]
    return {
        "size": float(np.cbrt(6 * mesh.volume / np.pi)),
        "elongation": middle / long,
        "flatness": short / middle,
        "csf": short / np.sqrt(long * middle),
        "sphericity": float(np.cbrt(np.pi * 36 * mesh.volume**2) / mesh.area),
        "convexity": float(mesh.volume / mesh.convex_hull.volume),
    }


def test_a_design_has_what_was_asked_for(studio, known):
    targets = {"size": 3.0, "csf": 0.6, "sphericity": 0.85, "roughness": 0.004}
    found = design(studio, known, targets)
    assert found.missed == ()
    measured = independent(found.grain.surface)
    for name in ("size", "csf", "sphericity"):
        assert measured[name] == pytest.approx(targets[name], rel=0.005)
    assert found.grain.is_sound


@given(st.integers(0, 3), st.floats(0.3, 0.95), st.floats(0.5, 0.95))
@settings(max_examples=20)
def test_form_is_exact_whatever_else_is_asked_for(parent, flatness, elongation):
    studio = SurfaceStudio(fitted_stones())
    here = studio.begin(parent)
    rough = 1.1 * studio.make(here).values["roughness"]
    wanted = {"elongation": elongation, "csf": float(np.sqrt(elongation)) * flatness, "roughness": rough}
    found = reach_all(studio, here, wanted)
    measured = independent(found.grain.surface)
    assert measured["flatness"] == pytest.approx(flatness, rel=1e-6)
    assert measured["elongation"] == pytest.approx(elongation, rel=1e-6)
    assert measured["size"] == pytest.approx(here.diameter, rel=1e-6)


def test_what_these_surfaces_cannot_have_is_named(studio, known):
    found = design(studio, known, {"sphericity": 0.99, "csf": 0.4})
    assert found.missed == ("sphericity",)
    assert found.errors["sphericity"] < -0.1
    assert found.errors["csf"] == pytest.approx(0, abs=1e-9)


def test_steps_are_standard_deviations_of_the_parents(studio, known):
    here = studio.begin(0)
    before = studio.make(here).values
    moved = move_by(studio, known, here, {"csf": -1.0, "size": 0.5})
    spread = np.std([studio.make(studio.begin(row)).values["csf"] for row in range(4)], ddof=1)
    assert moved.grain.values["csf"] == pytest.approx(before["csf"] - spread, rel=1e-6)
    assert moved.grain.values["size"] == pytest.approx(before["size"] + 0.5 * known.deviations["size"])


def test_a_difference_that_is_added_to_its_own_minuend_gives_the_other(studio):
    a, b = studio.begin(0), studio.begin(2)
    found = add_difference(studio, b, a, b)
    wanted = studio.make(a).values
    for name in SHAPE_FACTORS:
        if name not in found.missed:
            assert found.grain.values[name] == pytest.approx(wanted[name], rel=0.006), name
    assert {"size", "elongation", "flatness"}.isdisjoint(found.missed)
    nothing = add_difference(studio, b, a, a)
    assert nothing.missed == ()


@pytest.mark.parametrize(
    ("targets", "words"),
    [
        ({}, "needs a factor"),
        ({"colour": 1.0}, "'colour' is no factor of shape"),
        ({"sphericity": 1.2}, "it is 1 at most"),
        ({"size": -1.0}, "ask for a positive number"),
        ({"csf": float("nan")}, "ask for a positive number"),
        ({"elongation": 0.8, "flatness": 0.5, "csf": 0.9}, "leave one of them out"),
        ({"elongation": 0.3, "csf": 0.9}, "No grain has flatness"),
    ],
)
def test_impossible_wishes_are_refused(studio, known, targets, words):
    with pytest.raises(CloningError, match=words):
        design(studio, known, targets)


def test_shapes_come_back_from_their_file(studio, tmp_path):
    style = studio.style
    warped, _ = studio.warped(studio.begin(1), 0.2, 5)
    shapes = {"one": warped, "two": studio.blended(studio.begin(0), 3, 0.25)[0], "three": studio.draw(7)}
    shapes["four"] = studio.reach(studio.begin(2), "roughness", 0.005)[0]
    path = tmp_path / "shapes.json"
    path.write_text(write_shapes(shapes, style), encoding="utf-8")
    found = read_shapes(path, style)
    assert list(found) == list(shapes)
    for name, shape in shapes.items():
        np.testing.assert_array_equal(
            studio.make(found[name]).surface.vertices, studio.make(shape).surface.vertices
        )


def test_a_file_of_shapes_that_is_none_is_refused(studio, tmp_path):
    text = write_shapes({"one": studio.begin(0)}, studio.style)
    path = tmp_path / "shapes.json"

    def refusal(content: str, style=studio.style) -> str:
        path.write_text(content, encoding="utf-8")
        with pytest.raises(CloningError) as caught:
            read_shapes(path, style)
        return str(caught.value)

    record = json.loads(text)
    assert "another style" in refusal(text, fitted_stones(3))
    assert "holds no shapes" in refusal("[]")
    assert "cannot be read" in refusal("{")
    assert "version 7" in refusal(json.dumps({**record, "version": 7}))
    for wrong in (
        {"parent": 99},
        {"diameter": -1},
        {"share": 2},
        {"form": [1, 2]},
        {"turn": [[1, 0, 0]] * 3},
    ):
        shapes = [{**record["shapes"][0], **wrong}]
        assert "damaged" in refusal(json.dumps({**record, "shapes": shapes})), wrong
