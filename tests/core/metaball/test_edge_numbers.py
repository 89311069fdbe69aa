"""Numbers at the edge: a verdict or a refusal by name, never another exception nor a silent wrong number.

What is expected is known without mbstudio: one sphere has the volume 4/3 pi k**1.5, spheres far apart the sum
of theirs, and a body that is scaled has the same factors.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mbstudio.core.errors import AvatarError, MbstudioError, MeasureError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metaball.apart import solid_boxes
from mbstudio.core.metaball.field import solid_bounds
from mbstudio.core.metaball.surface import volume_and_area, volume_and_area_of_thin
from mbstudio.core.metaball.topology import topology
from mbstudio.core.metaball.validity import check
from mbstudio.core.metrics import mass_properties, measure, measure_detail

CENTERS = np.random.default_rng(3).normal(size=(12, 3)) * 0.3
WEIGHTS = np.random.default_rng(4).uniform(0.02, 0.1, 12)
BALL = 4 / 3 * np.pi
SIZES = (1e-9, 1e-4, 1e9)
powers = st.integers(-300, 300).map(lambda power: float(f"1e{power}"))


def body(scale: float = 1.0) -> Avatar:
    return Avatar(CENTERS * scale, WEIGHTS * scale**2, "m", name="pebble")


@pytest.fixture(scope="module")
def unscaled() -> dict[str, float]:
    return numbers_of(body())


def numbers_of(avatar: Avatar, scale: float = 1.0) -> dict[str, float]:
    """Everything that is measured, in lengths of `scale`."""
    core, detail, verdict = measure(avatar), measure_detail(avatar), check(avatar)
    volume, area = volume_and_area_of_thin(avatar.control)
    mesh = avatar.mesh(32)
    mass = mass_properties(avatar, 1.0)
    return {
        "volume": core.volume / scale**3, "area": core.area / scale**2, "sphericity": core.sphericity,
        "circularity": core.circularity, "csf": core.csf, "ds": core.ds / scale,
        "longest": core.longest / scale, "enclosing": detail.enclosing / scale,
        "convexity": detail.convexity, "inscribed": detail.inscribed / scale,
        "feret": detail.feret_mid / scale, "roundness": detail.roundness, "roughness": detail.roughness,
        "verdict": float(verdict.valid), "neck": verdict.smallest_neck / scale, "genus": float(verdict.genus),
        "by quadrature": volume / scale**3, "area by quadrature": area / scale**2,
        "of mesh": mesh.volume / scale**3, "moment": mass.principal[1] / scale**5,
    }  # fmt: skip


@pytest.mark.parametrize("scale", SIZES)
def test_a_body_of_any_size_has_the_same_factors(scale: float, unscaled: dict[str, float]) -> None:
    found = numbers_of(body(scale), scale)
    for name, value in unscaled.items():
        assert found[name] == pytest.approx(value, rel=2e-5), name
    # Volumes and lengths that no grid in single precision takes part in, to rounding.
    for name in ("volume", "ds", "longest", "of mesh", "moment"):
        assert found[name] == pytest.approx(unscaled[name], rel=1e-6), name


def test_a_power_of_two_changes_no_digit(unscaled: dict[str, float]) -> None:
    found = numbers_of(body(2.0**-30), 2.0**-30)
    assert {name: value for name, value in found.items() if name != "neck"} == {
        name: value for name, value in unscaled.items() if name != "neck"
    }


@pytest.mark.parametrize("k", [1e-30, 1e-9, 1e30])
def test_one_sphere_of_any_size(k: float) -> None:
    sphere = Avatar([[0.0, 0, 0]], [k], "m")
    truth = BALL * k**1.5
    assert check(sphere).valid
    assert check(sphere).smallest_neck == pytest.approx(2 * np.sqrt(k), rel=1e-6)
    assert measure(sphere).volume == pytest.approx(truth, rel=1e-5)
    assert volume_and_area(sphere.control)[0] == pytest.approx(truth, rel=1e-4)
    assert sphere.mesh().volume == pytest.approx(truth, rel=1e-3)


@pytest.mark.parametrize("distance", [1e2, 1e4, 1e9])
def test_two_bodies_far_apart_have_both_volumes(distance: float) -> None:
    avatar = Avatar([[0.0, 0, 0], [distance, 0, 0]], [1.0, 0.25], "mm", name="pair")
    verdict = check(avatar)
    assert (verdict.pieces, verdict.voids, verdict.valid) == (2, 0, False)
    assert "2 pieces" in verdict.reasons[0]
    truth = BALL * (1 + 0.125)
    assert volume_and_area_of_thin(avatar.control)[0] == pytest.approx(truth, rel=1e-3)
    assert sorted(topology(avatar.control).volumes / BALL) == pytest.approx([0.125, 1], rel=0.02)
    mesh = avatar.mesh()
    for middle, radius in ((0.0, 1.0), (distance, 0.5)):
        part = mesh.vertices[abs(mesh.vertices[:, 0] - middle) < 2]
        assert np.linalg.norm(part - [middle, 0, 0], axis=1) == pytest.approx(radius, rel=0.01)
    with pytest.raises(MeasureError, match="'pair' is in 2 pieces"):
        measure(avatar)
    with pytest.raises(MeasureError, match="'pair' is in 2 pieces"):
        mass_properties(avatar, 2650)


def test_an_island_that_no_grid_sees_is_not_measured_away() -> None:
    avatar = Avatar([[0.0, 0, 0], [2.5, 0, 0]], [1.0, 1e-9], "mm", name="speck")
    with pytest.raises(MeasureError, match="'speck' is in 2 pieces"):
        measure_detail(avatar)


def test_one_piece_has_the_box_that_it_had() -> None:
    (box,) = solid_boxes(body().control)
    assert (box == solid_bounds(body().control)).all()


def test_bodies_on_a_lattice_are_told_apart() -> None:
    places = np.indices((3, 3, 3)).reshape(3, -1).T * 20.0
    avatar = Avatar(places, np.ones(27), "mm")
    boxes = solid_boxes(avatar.control)
    assert len(boxes) == 27
    for box in boxes:
        inside = ((places >= box[0]) & (places <= box[1])).all(axis=1)
        assert inside.sum() == 1
        assert (box[1] - box[0]).max() < 3
    near = (1.0 + sum(1.0 / max(float(((places[13] - p) ** 2).sum()), 400.0) for p in places)) ** 1.5
    assert volume_and_area(avatar.control)[0] == pytest.approx(27 * BALL * near, rel=0.02)


@pytest.mark.parametrize(
    ("centers", "weights", "told"),
    [
        ([[0, 0, 0.0]], [1e-300], "largest k of 1e-300"),
        ([[0, 0, 0.0]], [1e300], "largest k of 1e\\+300"),
        ([[1e300, 0, 0.0]], [1.0], "1e\\+300 from the origin"),
        ([[1e-200, 0, 0.0]], [1e-320], "Check the unit"),
        ([[1e15, 0, 0.0]], [1.0], "1e\\+15 from the origin and is only about 1 thick"),
        ([[0, 0, 0.0], [1e15, 0, 0]], [1.0, 1.0], "nearer to the origin and to each other"),
    ],
)
def test_lengths_that_cannot_be_computed_with_are_refused_by_name(
    centers: list[list[float]], weights: list[float], told: str
) -> None:
    with pytest.raises(AvatarError, match=f"^Avatar 'pebble' .*{told}"):
        Avatar(centers, weights, "mm", name="pebble")


def refused(work: Callable[[], Any]) -> tuple[Any, str]:
    """Return what work yields, and the words of its refusal, which name the avatar in one line."""
    try:
        return work(), ""
    except MbstudioError as error:
        told = str(error)
    assert told.startswith("Avatar 'any' ")
    assert "\n" not in told
    return None, told


@given(
    apart=powers,
    weights=st.lists(powers, min_size=1, max_size=4),
    seed=st.integers(0, 5),
)
@example(apart=1e9, weights=[1.0, 1.0], seed=0)
@example(apart=1e4, weights=[1e-300, 1.0], seed=0)
@example(apart=1.0, weights=[1e-300, 1e20, 1.0], seed=1)
@settings(max_examples=25)
def test_any_numbers_make_a_verdict_or_a_refusal(apart: float, weights: list[float], seed: int) -> None:
    places = np.random.default_rng(seed).normal(size=(len(weights), 3)) * apart
    avatar, refusal = refused(lambda: Avatar(places, weights, "mm", name="any"))
    if refusal:
        return
    verdict = check(avatar)
    assert verdict.pieces >= 1
    assert verdict.valid == (not verdict.reasons)
    assert verdict.valid == (verdict.pieces == 1 and verdict.voids == 0)
    volume, area = volume_and_area_of_thin(avatar.control)
    largest = BALL * max(weights) ** 1.5
    assert 0.99 * largest < volume <= 1.01 * BALL * sum(np.sqrt(weights)) ** 3 * len(weights) ** 1.5
    assert area > 0
    assert len(avatar.mesh(16).faces)
    found, refusal = refused(lambda: measure(avatar))
    if not refusal:
        assert verdict.pieces == 1
        assert found.volume == pytest.approx(volume, rel=0.02)
