"""The public interface: the names and results that scripts rely on."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import mbstudio as mb

# Semi-axes in voxels of the whole grains in the fixture small_scan_file.
WHOLE_GRAINS = ((12, 10, 9), (11, 9, 12), (8, 11, 9))
VOXEL = 14.0


@pytest.fixture(scope="module")
def grains(small_scan_file):
    return mb.segment(mb.open_scan(small_scan_file, voxel_size="14 um"))


@pytest.fixture(scope="module")
def result(grains):
    return mb.fit(grains[0], n=12, method="fast", seed=0)


def test_open_scan(small_scan_file):
    scan = mb.open_scan(small_scan_file, voxel_size="14 um")
    assert scan.shape == (56, 56, 56)
    assert scan.voxel_size.zyx == (VOXEL, VOXEL, VOXEL)
    assert scan.unit == "um"


def test_segment_finds_the_grains_and_their_volumes(grains):
    assert len(grains) == len(grains.table) == 4
    assert grains.labels.shape == (56, 56, 56)
    assert set(np.unique(grains.labels)) == {0, *grains.table["label"]}
    assert {"label", "voxels", "volume", "touches_border"} <= set(grains.table.columns)
    whole = grains.table[~grains.table["touches_border"]]
    true = sorted(4 / 3 * np.pi * np.prod(axes) * VOXEL**3 for axes in WHOLE_GRAINS)
    np.testing.assert_allclose(sorted(whole["volume"]), true, rtol=0.05)
    assert isinstance(grains[0], mb.Grain)
    assert grains.interior_labels == list(whole["label"])


def test_grain_from_mesh_and_from_mask(tmp_path):
    trimesh.creation.icosphere(subdivisions=4, radius=3.0).export(tmp_path / "stone.ply")
    grain = mb.Grain.from_mesh(tmp_path / "stone.ply", resolution=60, unit="mm")
    assert grain.unit == "mm"
    assert grain.volume == pytest.approx(4 / 3 * np.pi * 27, rel=0.02)
    again = mb.Grain.from_mask(grain.mask, voxel_size="14 um")
    assert again.volume == pytest.approx(np.count_nonzero(grain.mask) * VOXEL**3)


def test_fit(grains, result):
    avatar = result.avatar
    assert isinstance(avatar, mb.Avatar)
    assert isinstance(result, mb.FitResult)
    assert avatar.centers.shape == (len(avatar.weights), 3)
    assert 1 <= avatar.n <= 12
    assert avatar.unit == "um"
    assert result.history[-1] <= result.history[0]
    assert result.verdict.valid
    assert (result.verdict.pieces, result.verdict.voids) == (1, 0)
    mesh = avatar.mesh()
    assert isinstance(mesh, trimesh.Trimesh)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(grains[0].volume, rel=0.05)


def test_the_field_of_an_avatar_is_that_of_the_paper(result):
    avatar = result.avatar
    points = avatar.centers.mean(axis=0) + np.array([[7.0, -20.0, 11.0], [400.0, 0.0, 3.0]])
    by_hand = [
        sum(k / np.sum((p - c) ** 2) for c, k in zip(avatar.centers, avatar.weights, strict=True))
        for p in points
    ]
    np.testing.assert_allclose(avatar.field(points), by_hand, rtol=1e-6)


def test_start_fit_yields_steps(grains):
    run = mb.start_fit(grains[1], n=6)
    step = next(run)
    assert step.phase in ("clustering", "search")
    assert [later.generation for later in run][-1] > 0
    assert run.result().avatar.n <= 6


def test_measure_takes_grains_avatars_and_meshes(grains, result):
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=2.0)
    factors = mb.measure(sphere)
    assert isinstance(factors, mb.ShapeFactors)
    assert factors.volume == pytest.approx(4 / 3 * np.pi * 8, rel=0.005)
    assert factors.area == pytest.approx(4 * np.pi * 4, rel=0.005)
    for name in ("sphericity", "circularity", "csf", "dns"):
        assert getattr(factors, name) == pytest.approx(1.0, abs=0.005)
    assert factors.dn == pytest.approx(4.0, rel=0.005)
    assert factors.ds == pytest.approx(4.0, rel=0.005)
    assert mb.measure(grains[0]).volume == pytest.approx(grains[0].volume)
    assert mb.measure(result.avatar).volume == pytest.approx(grains[0].volume, rel=0.05)


def test_export_and_project(tmp_path, small_scan_file, grains, result):
    report = mb.export([result.avatar], "liggghts", tmp_path / "out", density=2650, unit="mm")
    assert all(path.is_file() for path in report.files)

    project = mb.Project.new(mb.open_scan(small_scan_file, voxel_size="14 um"))
    project.change("Find grains", grains=grains)
    project.add_fits({grains[0].label: result})
    project.save(tmp_path / "sand.mbs")
    with mb.Project.open(tmp_path / "sand.mbs") as opened:
        np.testing.assert_array_equal(opened.avatars[0].centers, result.avatar.centers)
        np.testing.assert_array_equal(opened.grains.labels, grains.labels)


def test_bodies_become_a_style_and_the_style_new_grains(tmp_path):
    rng = np.random.default_rng(3)
    bodies = []
    for _ in range(6):
        body = trimesh.creation.icosphere(3)
        body.apply_scale(np.exp(0.2 * rng.normal(size=3)))
        body.units = "mm"
        bodies.append(body)
    parents = mb.serialize(bodies, 8)
    assert parents.unit == "mm"
    assert np.median(parents.rms) < 0.01
    mb.learn(parents, preset="pca").save(tmp_path / "style")
    clones = mb.generate(mb.load_style_learner(tmp_path / "style"), 5, seed=1)
    assert len(clones.avatars()) == 5
    assert clones.factors.unit == "mm"
    volumes = [body.volume for body in bodies]
    assert (clones.factors.column("volume") < 3 * max(volumes)).all()
    assert (clones.factors.column("volume") > min(volumes) / 3).all()


def test_every_public_name_is_there():
    for name in mb.__all__:
        assert getattr(mb, name) is not None
