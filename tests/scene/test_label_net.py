"""Surfaces around labels, against bodies whose size is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mbstudio.scene.label_net import label_net, vertex_normals


def ball_and_box():
    z, y, x = np.ogrid[:40, :40, :40]
    labels = np.zeros((40, 40, 40), dtype=np.int32)
    labels[(z - 12) ** 2 + (y - 15) ** 2 + (x - 20) ** 2 <= 100] = 3
    labels[25:, 5:30, 5:30] = 2  # touches the edge of the volume
    return labels


def body(net, label):
    mesh = trimesh.Trimesh(net.points, net.triangles[net.labels == label], process=False)
    mesh.remove_unreferenced_vertices()
    return mesh


def test_each_label_is_a_closed_body_in_its_place():
    net = label_net(ball_and_box())
    ball, box = body(net, 3), body(net, 2)
    assert ball.is_watertight
    assert box.is_watertight
    # Positive volume: the triangles look outward. Smoothing takes some of a ball of radius 10.
    assert ball.volume == pytest.approx(4 / 3 * np.pi * 10**3, rel=0.12)
    assert box.volume == pytest.approx(15 * 25 * 25, rel=0.08)
    np.testing.assert_allclose(ball.centroid, (20, 15, 12), atol=0.05)
    np.testing.assert_allclose(box.bounds.mean(axis=0), (17, 17, 32), atol=0.05)
    # A surface between the voxels at 39 and those outside lies at 39.5.
    assert box.bounds[1, 2] == pytest.approx(39.5, abs=0.01)


def test_touching_grains_have_no_surface_between_them():
    labels = np.zeros((10, 10, 20), dtype=np.int32)
    labels[2:8, 2:8, 2:10] = 1
    labels[2:8, 2:8, 10:18] = 2
    net = label_net(labels)
    both = trimesh.Trimesh(net.points, net.triangles, process=False)
    assert both.is_watertight
    assert both.body_count == 1


def test_no_label_is_no_surface():
    net = label_net(np.zeros((5, 5, 5), dtype=np.int32))
    assert len(net.triangles) == 0


def test_normals_of_a_ball_point_away_from_its_centre():
    net = label_net(ball_and_box())
    chosen = np.unique(net.triangles[net.labels == 3])
    normals = vertex_normals(net.points, net.triangles)[chosen]
    away = net.points[chosen] - (20, 15, 12)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    assert (normals * away).sum(axis=1).min() > 0.9
