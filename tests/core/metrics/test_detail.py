"""Detailed factors of bodies with known ones, and what must hold for any body."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from benchmarks.known_solids import solid
from mbstudio.core.errors import MeasureError
from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import CORE_FACTORS, DETAILED_FACTORS, measure, measure_detail
from mbstudio.core.metrics.harmonics import band_energies
from tests.core.metrics.solids import turned

LENGTHS = ("inscribed", "enclosing", "feret_min", "feret_mid", "feret_max")


def test_a_cube():
    found = measure_detail(turned(trimesh.creation.box((2, 2, 2)), 1), unit="mm")
    assert found.convexity == pytest.approx(1)
    assert found.inscribed == pytest.approx(2, rel=1e-3)
    assert found.enclosing == pytest.approx(2 * math.sqrt(3))
    assert found.sheppard == pytest.approx(2 / (48 / math.pi) ** (1 / 3), rel=1e-3)
    assert found.feret_min == pytest.approx(2, rel=1e-4)
    assert found.feret_mid == pytest.approx(math.sqrt(32 / 3))
    assert found.feret_max == pytest.approx(2 * math.sqrt(3))
    # Cubic symmetry leaves no band 1, 2, 3 or 5.
    assert np.array(found.bands)[[1, 2, 3, 5]] == pytest.approx([0, 0, 0, 0], abs=1e-6)
    assert found.bands[4] > 0.01
    assert (found.unit, found.surface) == ("mm", "mesh")
    assert measure_detail(trimesh.creation.box((2, 2, 2)), unit="mm").roughness > 0.01


def test_a_torus_is_neither_convex_nor_star_shaped():
    major, minor = 2.0, 0.6
    found = measure_detail(
        turned(trimesh.creation.torus(major, minor, major_sections=128, minor_sections=64), 2)
    )
    # Pappus: the hull is a disc of thickness 2 r with a half torus around it.
    hull = math.pi * major**2 * 2 * minor + math.pi**2 * minor**2 * (major + 4 * minor / (3 * math.pi))
    assert found.convexity == pytest.approx(2 * math.pi**2 * major * minor**2 / hull, rel=3e-3)
    assert found.bands is None
    assert found.as_dict()["band_2"] is None
    assert found.inscribed == pytest.approx(2 * minor, rel=5e-3)
    assert found.enclosing == pytest.approx(2 * (major + minor), rel=1e-3)


def test_roughness_sees_waves_finer_than_its_scale_and_not_the_form():
    ball = trimesh.creation.icosphere(5)
    direction = np.asarray(ball.vertices)
    amplitude = 0.01
    waves = np.cos(16 * np.arctan2(direction[:, 1], direction[:, 0])) * (1 - direction[:, 2] ** 2)
    rough = trimesh.Trimesh(direction * (1 + amplitude * waves)[:, None], ball.faces, process=False)
    found = measure_detail(rough).roughness
    # Root mean square of cos * sin**2 over the sphere is sqrt(4/15); D_n is 2.
    assert found == pytest.approx(amplitude * math.sqrt(4 / 15) / 2, rel=0.15)
    stretched = ball.copy()
    stretched.apply_scale([1.3, 1, 1])
    assert measure_detail(stretched).roughness < 0.6 * found


def test_band_energies_of_a_known_radius():
    ball = trimesh.creation.icosphere(5)
    z = np.asarray(ball.vertices)[:, 2]
    epsilon = 0.1
    radius = 1 + epsilon * (1.5 * z**2 - 0.5)
    found = band_energies(np.asarray(ball.vertices) * radius[:, None], np.asarray(ball.faces), np.zeros(3))
    # P_2 has the mean square 1/5.
    assert found[2] == pytest.approx(epsilon**2 / 5, rel=5e-3)
    assert np.delete(found, [0, 2]) == pytest.approx(np.zeros(11), abs=1e-6)
    assert found[0] == 1


def test_a_grain_an_avatar_and_a_mesh_of_one_ball():
    mesh = trimesh.creation.icosphere(4, 15.0)
    mesh.units = "um"
    grain = Grain.from_mask(solid("sphere", 15).voxels(np.random.default_rng(3)), "1 um")
    avatar = Avatar([[0, 0, 0]], [225.0], "um")
    for body, rel in ((mesh, 5e-3), (avatar, 5e-3), (grain, 0.03)):
        found = measure_detail(body)
        for name in LENGTHS:
            assert getattr(found, name) == pytest.approx(30, rel=rel), name
        assert found.convexity == pytest.approx(1, rel=0.006)
        assert found.sheppard == pytest.approx(1, rel=rel)
        assert found.roundness == pytest.approx(1, abs=0.12 if body is grain else 0.05)
        assert max(found.bands[1:]) < 1e-4
    assert measure_detail(avatar, unit="mm").enclosing == pytest.approx(0.03, rel=3e-3)


@settings(max_examples=3, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(seed=st.integers(0, 10**6), scale=st.floats(1e-3, 1e3))
def test_pose_mirror_and_scale_change_nothing_that_they_should_not(seed, scale):
    rng = np.random.default_rng(seed)
    body = trimesh.convex.convex_hull(rng.normal(size=(30, 3)) * [1, 1.3, 1.7])
    mirrored = body.copy()
    mirrored.apply_scale([1, 1, -1])
    still = measure_detail(body)
    for other in (turned(body, seed), mirrored):
        other.apply_scale(scale)
        found = measure_detail(other)
        for name in DETAILED_FACTORS:
            factor = scale if name in LENGTHS else 1
            rel = 0.03 if name == "roughness" else 1e-3
            slack = 0.03 if name == "roundness" else None  # read at two scales on a grid
            value = getattr(still, name) * factor
            assert getattr(found, name) == pytest.approx(value, rel=rel, abs=slack), name
        assert found.bands == pytest.approx(still.bands, rel=0.02, abs=1e-4)


@settings(max_examples=3, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(seed=st.integers(0, 10**6))
def test_bounds(seed):
    rng = np.random.default_rng(seed)
    avatar = Avatar(rng.normal(size=(5, 3)) * 0.4, rng.uniform(0.3, 0.6, 5), "mm")
    found, core = measure_detail(avatar), measure(avatar)
    assert 0 < found.convexity <= 1
    assert 0 <= found.roundness <= 1
    assert 0 < found.sheppard <= 1
    assert found.inscribed <= found.feret_min * (1 + 1e-4)
    assert found.inscribed <= core.dn <= found.enclosing
    assert found.feret_min <= found.feret_mid <= found.feret_max <= found.enclosing * (1 + 1e-6)
    assert found.enclosing <= found.feret_max * math.sqrt(3 / 2) * (1 + 1e-6), "Jung's theorem"
    assert core.longest <= found.feret_max * (1 + 1e-3)


def test_a_thread_is_refused():
    with pytest.raises(MeasureError, match="thread"):
        measure_detail(turned(trimesh.creation.box((0.001, 0.001, 1.0)), 3))


def test_the_documentation_defines_every_factor(repository):
    text = (repository / "docs" / "shape-factors.md").read_text(encoding="utf-8")
    for name in (*CORE_FACTORS, *DETAILED_FACTORS, "bands"):
        assert f"`{name}`" in text, name


def test_records_list_every_number_for_tables():
    cube = trimesh.creation.box()
    core, detailed = measure(cube).as_dict(), measure_detail(cube).as_dict()
    assert set(core) == {*CORE_FACTORS, "unit", "axes", "surface", "warning"}
    bands = {f"band_{degree}" for degree in range(1, 13)}
    assert set(detailed) == {*DETAILED_FACTORS, *bands, "unit", "surface", "warning"}
