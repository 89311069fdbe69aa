"""The coarsest mesh within a distance of its avatar."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.core.dem import export
from mbstudio.core.dem.body import prepare_bodies
from mbstudio.core.dem.shapes import mesh_target
from mbstudio.core.dem.shapes.mesh_target import MeshErrors, mesh_of
from mbstudio.core.metaball import Avatar

RADIUS = 2.0


def body_of(avatar):
    (body,) = prepare_bodies([avatar], ["grain"], "mm", None)
    return body


@pytest.fixture
def ball() -> Avatar:
    return Avatar([[0.0, 0.0, 0.0]], [RADIUS**2], "mm", name="ball")


def farthest_from_the_sphere(mesh: trimesh.Trimesh) -> float:
    """Of many points of each triangle, by the definition of the sphere."""
    corners = np.asarray(mesh.triangles)
    shares = [(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]
    points = np.einsum("sc,fcx->fsx", np.array(shares) / 12, corners)
    return float(np.abs(np.linalg.norm(points, axis=2) - RADIUS).max())


@pytest.mark.parametrize("subdivisions", [1, 2, 3])
def test_the_error_is_the_farthest_that_a_triangle_lies_off(ball, subdivisions):
    mesh = trimesh.creation.icosphere(subdivisions, RADIUS)
    error = MeshErrors(ball, 2 * RADIUS).measure((np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    assert error * 2 * RADIUS == pytest.approx(farthest_from_the_sphere(mesh), rel=0.02)


def test_what_a_mesh_leaves_out_counts_too():
    pair = Avatar([[-1.5, 0, 0], [1.5, 0, 0]], [1.3, 1.3], "mm")
    whole = pair.mesh(48)
    half = trimesh.intersections.slice_mesh_plane(whole, [-1, 0, 0], [0, 0, 0])
    cap = (np.asarray(half.vertices), np.asarray(half.faces))
    reach = float(np.asarray(whole.vertices)[:, 0].max())
    # The farthest point of the half that is not there sees the rim of the one that is.
    assert MeshErrors(pair, 1.0).measure(cap) > 0.9 * reach


@pytest.mark.parametrize("error", [0.03, 0.004])
def test_the_mesh_is_as_near_as_was_asked_and_hardly_a_coarser_one_is(avatar, error):
    body = body_of(avatar)
    found = mesh_of(body, 32, error)
    assert found.error <= error
    assert not found.warning
    assert found.mesh.is_watertight
    if found.cells > mesh_target.FEWEST_CELLS:
        assert mesh_of(body, int(0.9 * found.cells)).error > error


def test_a_distance_out_of_reach_is_told_and_the_nearest_mesh_taken(avatar, monkeypatch):
    monkeypatch.setattr(mesh_target, "MOST_CELLS", 30)
    found = mesh_of(body_of(avatar), 32, 1e-5)
    assert found.cells == 30
    assert "30 edges" in found.warning
    assert "0.001 % asked" in found.warning


def test_the_search_for_a_distance_can_be_given_up_between_two_meshes(avatar, tmp_path):
    tried = []

    def tell(cells):
        tried.append(cells)
        if len(tried) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mesh_of(body_of(avatar), 32, 0.004, tell)
    assert tried[0] != tried[1]

    def progress(fraction, message):
        if "cells across" in message:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(avatar, "stl", tmp_path / "out", error=0.4, progress=progress)
    assert not (tmp_path / "out").exists()


def test_an_export_by_error_states_what_it_reached(avatars, tmp_path):
    report = export(avatars[:2], "ply", tmp_path / "out", error=1.0)
    for item, path in zip(report.items, report.files[:2], strict=True):
        details = item["details"]
        assert 0 < details["hausdorff_over_Dn"] <= 0.01
        assert len(trimesh.load_mesh(path).faces) == details["triangles"]
    finer = export(avatars[:2], "ply", tmp_path / "finer", error=0.3)
    assert all(
        a["details"]["triangles"] > b["details"]["triangles"]
        for a, b in zip(finer.items, report.items, strict=True)
    )
    assert not finer.warnings
