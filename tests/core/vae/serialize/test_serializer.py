"""Bodies serialized: known answers, any n, and bad input."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbstudio.core.errors import Cancelled, SerializationError, SerializationWarning
from mbstudio.core.grains import Grain
from mbstudio.core.metaball.surface import volume_and_area
from mbstudio.core.vae.serialize.serialization import FLIPS
from mbstudio.core.vae.serialize.serializer import serialize
from tests.core.vae.bodies import ellipsoid, ellipsoid_template, some_ellipsoids, template_avatar

TURN = Rotation.from_euler("xyz", [0.4, 1.9, -0.6])


@pytest.mark.parametrize("n", [40, 41])
def test_the_template_itself_comes_back(n):
    template = ellipsoid_template(n)
    made = serialize([template_avatar(template, 250, TURN, (10, 20, -30))], template=template)
    assert made.unit == "um"
    assert made.diameters[0] == pytest.approx(250, rel=1e-3)
    assert made.rms[0] < 1e-3
    np.testing.assert_allclose(made.centers[0], template.centers, atol=5e-3)
    np.testing.assert_allclose(made.log_weights[0], template.log_weights, atol=0.03)


@pytest.mark.parametrize(("n", "roughest"), [(5, 0.03), (13, 0.012), (41, 0.004)])
def test_ellipsoids_at_any_number(n, roughest):
    bodies = some_ellipsoids(5)
    made = serialize(bodies, n)
    assert made.valid.all()
    assert made.template.n == n
    assert made.rms.max() < roughest
    for i, body in enumerate(bodies):
        dn = (6 * body.volume / np.pi) ** (1 / 3)
        assert made.diameters[i] == pytest.approx(dn, rel=1e-6)
        # Size is a feature of its own and the volume is kept to the digit.
        volume, _ = volume_and_area(made.avatar(i).control, 96)
        assert volume == pytest.approx(body.volume, rel=1e-3)
        # In the frame the long axis is x and the short one z.
        low, high = made.avatar(i).bounds()
        extent = high - low
        assert extent[0] > extent[1] > extent[2]


def test_every_flip_mirrors_the_avatar():
    made = serialize(some_ellipsoids(5), 13)
    points = np.random.default_rng(0).uniform(-60, 60, (40, 3))
    for flip, signs in enumerate(FLIPS):
        turned = made.flipped(np.full(5, flip))
        np.testing.assert_allclose(
            turned.avatar(2).field(points * signs), made.avatar(2).field(points), rtol=1e-10
        )


def test_voxels_mesh_and_avatar_of_one_body_agree():
    template = ellipsoid_template(40)
    mesh = ellipsoid((31, 25, 19), TURN)
    made = serialize([mesh, Grain.from_mesh(mesh, 26), template_avatar(template, 250)], template=template)
    assert made.names == ("body 0", "body 1", "template")
    # 26 voxels across: their surface is known to some tenths of a voxel, 4 % of D_n.
    assert made.diameters[1] == pytest.approx(made.diameters[0], rel=0.01)
    points = np.array([[0.55, 0, 0], [0, 0.45, 0], [0, 0, 0.35]]) * made.diameters[0]
    np.testing.assert_allclose(made.avatar(0).field(points), made.avatar(1).field(points), rtol=0.06)


def test_units_are_converted_and_shapes_kept():
    bodies = some_ellipsoids(2)
    small = bodies[0].copy()
    small.apply_scale(1e-3)
    small.units = "mm"
    template = ellipsoid_template(13)
    with pytest.warns(
        SerializationWarning, match=r"1 of 3 bodies have the same shape as another \('body 2'\)"
    ):
        made = serialize([*bodies, small], template=template)
    assert made.unit == "um"
    assert made.diameters[2] == pytest.approx(made.diameters[0], rel=1e-9)
    with pytest.warns(SerializationWarning):
        in_mm = serialize([*bodies, small], template=template, unit="mm")
    np.testing.assert_allclose(in_mm.diameters, made.diameters * 1e-3, rtol=1e-9)
    np.testing.assert_array_equal(in_mm.centers, made.centers)


def test_a_body_a_thousand_times_larger_is_told():
    bodies = some_ellipsoids(3)
    bodies[1].apply_scale(1000.0)
    with pytest.warns(SerializationWarning, match=r"'body 1'.* more than 30 times larger"):
        made = serialize(bodies, template=ellipsoid_template(13))
    assert made.diameters[1] / made.diameters[0] > 500
    assert made.rms[1] < 0.012  # its shape is as good as any


def test_too_few_bodies_and_bad_ones_are_named():
    bodies = some_ellipsoids(5)
    with pytest.raises(SerializationError, match="4 bodies are too few"):
        serialize(bodies[:4])
    with pytest.raises(SerializationError, match="no bodies"):
        serialize([], template=ellipsoid_template(13))
    with pytest.raises(SerializationError, match="n = 0"):
        serialize(bodies, 0)
    with pytest.raises(SerializationError, match="5 bodies have 1 names"):
        serialize(bodies, names=["a"])
    bodies[3].update_faces(np.arange(len(bodies[3].faces)) > 3)
    with pytest.raises(SerializationError, match=r"body 3.*not closed"):
        serialize(bodies, template=ellipsoid_template(13))


def test_processes_change_nothing():
    bodies, template = some_ellipsoids(3), ellipsoid_template(13)
    told: list[float] = []
    alone = serialize(bodies, template=template, on_progress=lambda share, text: told.append(share))
    together = serialize(bodies, template=template, processes=2)
    np.testing.assert_array_equal(alone.centers, together.centers)
    np.testing.assert_array_equal(alone.log_weights, together.log_weights)
    assert told == pytest.approx([1 / 3, 2 / 3, 1])
    bodies[2].update_faces(np.arange(len(bodies[2].faces)) > 3)
    with pytest.raises(SerializationError, match=r"body 0.*not closed"):
        serialize(bodies[2:], template=template, processes=2)


def test_what_progress_raises_ends_the_work():
    def stop(share: float, text: str) -> None:
        raise Cancelled("enough")

    before = threading.active_count()
    with pytest.raises(Cancelled):
        serialize(some_ellipsoids(3), template=ellipsoid_template(13), processes=2, on_progress=stop)
    assert threading.active_count() == before
