from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import MeasureError, MeshError
from mbstudio.core.judging.features import FEATURE_SETS, FEATURES, body_features
from mbstudio.core.judging.measuring import measure_features, surface_of
from mbstudio.core.metaball.avatar import Avatar
from tests.core.judging.bodies import features_of, rough_grain

NAMES = [kind.name for kind in FEATURES]
BANDS = [f"band_{degree}" for degree in range(2, 21)]


def turned(mesh: trimesh.Trimesh, seed: int = 1, size: float = 1.0) -> trimesh.Trimesh:
    found = mesh.copy()
    turn = Rotation.random(random_state=seed).as_matrix()
    found.vertices = size * np.asarray(mesh.vertices) @ turn.T + [3.0, -2.0, 5.0]
    return found


def ellipsoid(level: int) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=level)
    mesh.apply_scale([1.0, 0.8, 0.6])
    return mesh


def assert_alike(one, other, share: float = 0.02, angle: float = 1.0) -> None:
    for kind in FEATURES:
        room = {"edge angles": angle, "curvature": 0.1}.get(kind.group, 0.01)
        assert other[kind.name] == pytest.approx(one[kind.name], rel=share, abs=room), kind.name


def test_a_ball_is_known():
    found = features_of(trimesh.creation.icosphere(subdivisions=5))
    assert found["convexity"] == pytest.approx(1.0, abs=1e-9)
    assert found["il"] == pytest.approx(1.0, abs=1e-6)
    assert max(found[name] for name in BANDS) < 0.01
    # Of a ball of D_n = 1 all curvatures are 2, and normals 0.1 apart differ by 2 asin(0.1).
    assert found["curvature_mean"] == pytest.approx(2.0, rel=0.02)
    assert found["curvature_deviation"] < 0.15
    assert found["edge_angle_50"] == pytest.approx(np.degrees(2 * np.arcsin(0.1)), abs=0.5)
    assert found["roughness"] < 0.05
    assert found.is_star_shaped
    assert not found.notes


def test_form_and_bands_of_an_ellipsoid_are_known():
    found = features_of(ellipsoid(5))
    assert found["il"] == pytest.approx(0.8, abs=1e-3)
    assert found["si"] == pytest.approx(0.75, abs=1e-3)
    assert all(found[f"band_{degree}"] < 0.01 for degree in (3, 5, 7, 9))
    along = np.polynomial.legendre.leggauss(60)
    azimuth = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    z, w = np.repeat(along[0], 120), np.repeat(along[1], 120) / 240
    x, y = np.sqrt(1 - z**2) * np.tile(np.cos(azimuth), 60), np.sqrt(1 - z**2) * np.tile(np.sin(azimuth), 60)
    radii = ((x / 1.0) ** 2 + (y / 0.8) ** 2 + (z / 0.6) ** 2) ** -0.5 / (2 * 0.48 ** (1 / 3))
    ripple = w @ radii**2 - (w @ radii) ** 2
    assert sum(found[name] ** 2 for name in BANDS) == pytest.approx(1e4 * ripple, rel=0.01)


@pytest.mark.parametrize("levels", [(4, 5), (4, 6)])
def test_triangles_of_an_ellipsoid_do_not_count(levels):
    few, many = (features_of(turned(ellipsoid(level), level)) for level in levels)
    assert few.triangle_edge > 1.9 * many.triangle_edge
    assert_alike(few, many)


def test_triangles_of_a_polyhedron_do_not_count():
    coarse = trimesh.creation.box((1.0, 0.8, 0.6))
    other = trimesh.convex.convex_hull(np.concatenate([coarse.vertices, [[0.5, 0.1, 0.07]]]))
    fine = coarse.subdivide().subdivide().subdivide()
    one = features_of(coarse)
    for mesh in (other, fine):
        assert_alike(one, features_of(turned(mesh)))
    assert one["edge_angle_95"] > 70.0
    assert one["edge_angle_25"] == pytest.approx(0.0, abs=0.5)


def test_pose_and_size_do_not_count():
    mesh = rough_grain(np.random.default_rng(3))
    one, other = features_of(mesh), features_of(turned(mesh, 5, 1e-4))
    assert_alike(one, other)
    assert one.values == pytest.approx(features_of(mesh).values, rel=1e-12)  # and no chance is in it


def test_facets_of_an_avatar_do_not_count():
    rng = np.random.default_rng(0)
    avatar = Avatar(0.4 * rng.standard_normal((12, 3)), np.full(12, 0.05), unit="mm")
    coarse, fine = (avatar.mesh(cells) for cells in (48, 120))
    assert_alike(features_of(coarse), features_of(fine), 0.04, 1.5)


def test_rougher_is_told():
    smooth, rough = (features_of(rough_grain(np.random.default_rng(3), bumps)) for bumps in (0.0, 0.3))
    assert rough["curvature_deviation"] > 1.1 * smooth["curvature_deviation"]
    assert rough["convexity"] < smooth["convexity"]
    assert rough["curvature_concave"] > smooth["curvature_concave"]


def lying_letter_c() -> trimesh.Trimesh:
    """Return a torus with a gap: its centre of volume lies outside of it."""
    turn = np.linspace(0.0, 1.6 * np.pi, 60)
    around = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    rows = [
        ring[i] + 0.25 * (np.cos(a) * ring[i] + np.sin(a) * np.array([0, 0, 1.0]))
        for i in range(60) for a in around
    ]  # fmt: skip
    vertices = np.array([*rows, ring[0], ring[-1]])
    faces = []
    for i in range(59):
        for k in range(24):
            a, b = i * 24 + k, i * 24 + (k + 1) % 24
            faces += [(a, a + 24, b), (b, a + 24, b + 24)]
    for k in range(24):
        faces += [(1440, k, (k + 1) % 24), (1441, 59 * 24 + (k + 1) % 24, 59 * 24 + k)]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if mesh.volume < 0:
        mesh.invert()
    assert mesh.is_watertight
    return mesh


def test_a_body_that_does_not_hold_its_centre_has_no_bands():
    found = features_of(lying_letter_c())
    assert np.isnan([found[name] for name in BANDS]).all()
    assert np.isfinite([found[name] for name in NAMES if name not in BANDS]).all()
    assert not found.is_star_shaped
    assert any("centre of volume" in note for note in found.notes)


def test_outermost_radii_stand_for_a_body_that_is_not_star_shaped():
    mesh = trimesh.creation.icosphere(subdivisions=4)
    points = np.asarray(mesh.vertices)
    # Two clubs joined by a thin neck, behind whose ends rays enter again.
    waist = 0.1 + 2.0 * points[:, :1] ** 2
    mesh.vertices = points * np.concatenate([np.full_like(waist, 1.6), waist, waist], axis=1)
    found = features_of(mesh)
    assert not found.is_star_shaped
    assert np.isfinite(found.values).all()
    assert any("outermost" in note for note in found.notes)


def test_sets_hold_what_they_are_called():
    assert [NAMES[place] for place in FEATURE_SETS["bands 2-12"]] == BANDS[:11]
    assert [NAMES[place] for place in FEATURE_SETS["bands 2-20"]] == BANDS
    assert [NAMES[place] for place in FEATURE_SETS["form"]] == ["il", "si"]
    named = {place for name, places in FEATURE_SETS.items() if name != "all" for place in places}
    assert named == set(FEATURE_SETS["all"]) == set(range(len(FEATURES)))


def test_bad_surfaces_are_refused():
    ball = trimesh.creation.icosphere(subdivisions=2)
    vertices, faces = np.array(ball.vertices), np.array(ball.faces)
    with pytest.raises(MeshError, match="3 open edges"):
        body_features(vertices, faces[1:])
    with pytest.raises(MeshError, match="inwards"):
        body_features(vertices, faces[:, ::-1])
    with pytest.raises(MeshError, match="disagree"):
        body_features(vertices, np.concatenate([faces[:1, ::-1], faces[1:]]))
    with pytest.raises(MeshError, match="2 pieces"):
        body_features(
            np.concatenate([vertices, vertices + 5]), np.concatenate([faces, faces + len(vertices)])
        )
    with pytest.raises(MeshError, match="not finite"):
        body_features(np.where(np.arange(len(vertices))[:, None] == 3, np.nan, vertices), faces)
    with pytest.raises(MeshError, match="no triangles"):
        body_features(vertices, faces[:0])
    with pytest.raises(MeshError, match="not there"):
        body_features(vertices, faces + 1)
    with pytest.raises(MeasureError, match="thinner"):
        body_features(vertices * [1, 1, 0.003], faces)


def test_bodies_of_all_kinds_are_measured_and_failures_told():
    ball = trimesh.creation.icosphere(subdivisions=3)
    holed = trimesh.Trimesh(ball.vertices, ball.faces[1:], process=False)
    avatar = Avatar(np.zeros((1, 3)), np.ones(1), unit="mm")
    told = []
    found = measure_features(
        [ball, holed, avatar], workers=0, progress=lambda share, _words: told.append(share)
    )
    assert isinstance(found[1], str)
    assert "not closed" in found[1]
    assert found[0].values == pytest.approx(features_of(ball).values)
    assert found[2]["curvature_mean"] == pytest.approx(2.0, rel=0.02)
    assert surface_of(avatar)[0].shape[1] == 3
    assert told == [pytest.approx(1 / 3), pytest.approx(2 / 3), 1.0]
