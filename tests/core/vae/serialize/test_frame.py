"""The common frame of bodies known by formula."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import SerializationError
from mbstudio.core.grains import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.vae.serialize.frame import body_name, principal_frame
from tests.core.vae.bodies import ellipsoid

TURN = Rotation.from_euler("xyz", [0.3, -0.8, 1.1])


def test_frame_of_a_turned_ellipsoid():
    frame = principal_frame(ellipsoid((30, 20, 10), TURN, (5, -7, 9)))
    np.testing.assert_allclose(frame.center, [5, -7, 9], atol=1e-6)
    assert frame.unit == "um"
    # D_n of an ellipsoid is twice the cube root of the product of its semi-axes.
    assert frame.diameter == pytest.approx(2 * 6000 ** (1 / 3), rel=3e-3)
    for column, axis in enumerate(TURN.as_matrix().T):  # long, middle, short
        assert abs(frame.axes[:, column] @ axis) == pytest.approx(1, abs=1e-9)
    assert np.linalg.det(frame.axes) == pytest.approx(1)


def test_points_go_to_the_frame_and_back():
    frame = principal_frame(ellipsoid((30, 20, 10), TURN, (5, -7, 9)))
    tip = TURN.apply([30.0, 0, 0]) + np.array([5, -7, 9])
    shape = frame.shape_points(tip[None])
    np.testing.assert_allclose(np.abs(shape), [[30 / frame.diameter, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(frame.body_points(shape), [tip], atol=1e-9)


def test_grain_mesh_and_avatar_have_one_frame():
    avatar = Avatar(np.array([[-3.0, 0, 0], [3, 0, 0], [0, 1.5, 0]]), np.array([9.0, 9, 6]), "mm")
    mesh = avatar.mesh(96)
    grain = Grain.from_mesh(mesh, 80)
    frames = [principal_frame(body) for body in (avatar, mesh, grain)]
    for other in frames[1:]:
        assert other.diameter == pytest.approx(frames[0].diameter, rel=2e-3)
        np.testing.assert_allclose(other.center, frames[0].center, atol=0.02)
        np.testing.assert_allclose(np.abs((other.axes * frames[0].axes).sum(axis=0)), 1, atol=1e-3)


def test_a_body_without_unit_or_volume_is_named():
    open_mesh = ellipsoid((3, 2, 1))
    open_mesh.update_faces(np.arange(len(open_mesh.faces)) > 3)
    with pytest.raises(SerializationError, match=r"stone 7 .*not closed"):
        principal_frame(open_mesh, name="stone 7")
    bare = trimesh.creation.box()
    with pytest.raises(SerializationError, match=r"stone 7 .*no length unit"):
        principal_frame(bare, name="stone 7")
    assert principal_frame(bare, unit="mm").unit == "mm"


def test_names():
    mesh = ellipsoid((3, 2, 1))
    assert body_name(mesh, 4) == "body 4"
    mesh.metadata["name"] = "pebble"
    assert body_name(mesh, 4) == "pebble"
    grain = Grain(np.ones((3, 3, 3), bool), voxel_size=Grain.from_mesh(mesh, 24).voxel_size, label=12)
    assert body_name(grain, 0) == "grain 12"
