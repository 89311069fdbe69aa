"""Sphere clumps: how well they fit, and that their own numbers are true."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.dem import sphere_clump
from mbstudio.core.errors import ExportError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import mass_properties


def test_the_stated_fit_is_that_of_a_plain_count(avatar):
    clump = sphere_clump(avatar, 20)
    assert len(clump.radii) == 20
    assert clump.radii.min() > 0
    low, high = avatar.bounds()
    points = np.random.default_rng(5).uniform(low - 0.1, high + 0.1, (200_000, 3))
    offsets = points[:, None] - clump.centers[None]
    in_clump = ((offsets**2).sum(axis=2) <= clump.radii**2).any(axis=1)
    in_avatar = avatar.contains(points)
    iou = np.count_nonzero(in_clump & in_avatar) / np.count_nonzero(in_clump | in_avatar)
    assert clump.iou == pytest.approx(iou, abs=0.005)
    assert iou > 0.97
    assert in_clump.sum() / in_avatar.sum() == pytest.approx(1, abs=0.005)
    assert points[in_clump].mean(axis=0) == pytest.approx(mass_properties(avatar, 1).com, abs=0.005)
    assert (clump.distance(points) <= 0).tolist() == in_clump.tolist()


@pytest.mark.parametrize("spheres", [10, 40])
def test_the_union_has_the_avatars_volume_and_inertia(spheres, avatar):
    clump = sphere_clump(avatar, spheres)
    low, high = avatar.bounds()
    step = (high - low).max() / 120
    axes = [np.arange(a - 6 * step, b + 6 * step, step) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = points[clump.distance(points) <= 0]
    offsets = inside - inside.mean(axis=0)
    second = offsets.T @ offsets * step**3
    wanted = mass_properties(avatar, 1)  # 1 kg/m3, lengths in mm: kg mm2 is 1e9 times mm5
    assert len(inside) * step**3 == pytest.approx(wanted.volume, rel=2e-3)
    tensor = (np.trace(second) * np.eye(3) - second) * 1e-9
    error = np.linalg.norm(tensor - wanted.inertia) / np.linalg.norm(wanted.inertia)
    assert error < 4e-3
    assert clump.inertia_error == pytest.approx(error, abs=3e-3)


def test_small_spheres_do_not_stand_out(avatar):
    few, many = sphere_clump(avatar, 40), sphere_clump(avatar, 200)
    assert many.hausdorff < few.hausdorff
    assert many.hausdorff < 8 * many.mean_distance


def test_more_spheres_fit_better(avatar):
    ious = [sphere_clump(avatar, spheres).iou for spheres in (3, 10, 40)]
    assert ious[0] < ious[1] < ious[2]
    assert ious[2] > 0.98


def test_a_ring_keeps_its_hole(ring):
    clump = sphere_clump(ring, 24)
    assert clump.distance(np.zeros((1, 3)))[0] > 1
    assert clump.iou > 0.9


def test_two_spheres_find_two_balls():
    avatar = Avatar([[-0.9, 0, 0], [0.9, 0, 0]], [0.6, 0.6], "mm")
    clump = sphere_clump(avatar, 2)
    order = np.argsort(clump.centers[:, 0])
    assert clump.centers[order][:, 0] == pytest.approx([-0.9, 0.9], abs=0.1)
    assert clump.centers[:, 1:] == pytest.approx(np.zeros((2, 2)), abs=0.05)


def test_unit_scale_and_repetition_do_not_matter(avatar):
    clump = sphere_clump(avatar, 10)
    again = sphere_clump(avatar, 10)
    assert np.array_equal(clump.centers, again.centers)
    larger = Avatar(avatar.centers * 1000, avatar.weights * 1e6, "um")
    scaled = sphere_clump(larger, 10)
    assert scaled.iou == pytest.approx(clump.iou, abs=0.005)
    assert clump.to("um").radii == pytest.approx(clump.radii * 1000)
    assert clump.to("um").unit == "um"


def test_one_sphere_is_no_clump(avatar):
    with pytest.raises(ExportError, match="at least 2"):
        sphere_clump(avatar, 1)
