"""Bodies arrive in another process as they were sent."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh

from mbstudio.core.batch.body_messages import body_from, body_message
from mbstudio.core.batch.messages import receive, send
from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.units import VoxelSize


def there_and_back(body):
    pipe = io.BytesIO()
    send(pipe, *body_message(body))
    pipe.seek(0)
    return body_from(*receive(pipe))


def test_a_grain(rng):
    grain = Grain(
        rng.random((3, 4, 5)) > 0.5, VoxelSize(3, 2, 1, "um"), (1.0, 2.0, 3.0), label=7, touches_border=True,
        name="seven", filled_voxels=2,
    )  # fmt: skip
    back = there_and_back(grain)
    np.testing.assert_array_equal(back.mask, grain.mask)
    for name in ("voxel_size", "origin", "label", "touches_border", "name", "filled_voxels"):
        assert getattr(back, name) == getattr(grain, name), name


def test_an_avatar(rng):
    avatar = Avatar(rng.normal(size=(5, 3)), rng.random(5), "mm", label=3, name="three")
    back = there_and_back(avatar)
    np.testing.assert_array_equal(back.centers, avatar.centers)
    np.testing.assert_array_equal(back.weights, avatar.weights)
    assert (back.unit, back.label, back.name) == ("mm", 3, "three")


@pytest.mark.parametrize("unit", ["mm", None])
def test_a_mesh_with_its_faults(unit):
    # Twice the same corner and an open side: for the measurement to find, not for the message to mend.
    mesh = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]], [[0, 1, 2], [3, 1, 2]], process=False
    )
    if unit:
        mesh.units = unit
    back = there_and_back(mesh)
    np.testing.assert_array_equal(back.vertices, mesh.vertices)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    assert back.units == unit
