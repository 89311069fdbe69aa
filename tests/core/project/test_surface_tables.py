"""Styles of surfaces and their clones in a project."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

from mbstudio.core.cloning.surface_generation import SurfaceGeneration, generate_surfaces
from mbstudio.core.cloning.surface_generation_file import (
    build_generation,
    generation_entries,
    generation_tensors,
)
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import ProjectError
from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.project.merging import merge_states
from mbstudio.core.units import VoxelSize
from tests.core.cloning.stone_styles import fitted_stones
from tests.core.project.test_voxel_size import project_of


@pytest.fixture(scope="module")
def style() -> SurfaceStyle:
    return fitted_stones()


@pytest.fixture(scope="module")
def clones(style) -> SurfaceGeneration:
    return generate_surfaces(style, 3, seed=5)


def test_surfaces_and_their_clones_come_back(tmp_path, style, clones):
    path = tmp_path / "stones.mbs"
    write_project(path, ProjectState(surfaces=style, surface_clones=clones))
    with h5py.File(path) as file:
        assert file.attrs["schema"] == 8
    found = read_project(path)
    assert found.style is None
    assert found.new_grains is found.surface_clones
    for before, after in zip(style.parents, found.surfaces.parents, strict=True):
        assert (before.name, before.diameter, before.unit) == (after.name, after.diameter, after.unit)
        np.testing.assert_array_equal(before.vertices, after.vertices)
    np.testing.assert_array_equal(style.modes, found.surfaces.modes)
    assert found.surface_clones.names == clones.names
    assert found.surface_clones.options == clones.options
    for before, after in zip(clones.clones, found.surface_clones.clones, strict=True):
        np.testing.assert_array_equal(before.surface.vertices, after.surface.vertices)
        np.testing.assert_array_equal(before.surface.faces, after.surface.faces)
        np.testing.assert_array_equal(before.recipe.warp, after.recipe.warp)
        np.testing.assert_array_equal(before.fitted.avatar.centers, after.fitted.avatar.centers)
        assert (before.parent, before.fitted.rms) == (after.parent, after.fitted.rms)
    np.testing.assert_array_equal(
        clones.factors.column("sphericity"), found.surface_clones.factors.column("sphericity")
    )
    # The same style makes the same clones after it was read.
    again = generate_surfaces(found.surfaces, 3, seed=5)
    np.testing.assert_allclose(
        again.clones[0].surface.vertices, clones.clones[0].surface.vertices, atol=1e-12
    )


def test_clones_without_metaballs_come_back(tmp_path, style):
    path = tmp_path / "stones.mbs"
    made = generate_surfaces(style, 2, avatars=False)
    write_project(path, ProjectState(surfaces=style, surface_clones=made))
    assert [clone.fitted for clone in read_project(path).surface_clones.clones] == [None, None]


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("faces", lambda faces: faces - 1),
        ("faces", lambda faces: faces[:, ::-1]),
        ("counts", lambda counts: counts + 1),
        ("diameters", lambda diameters: -diameters),
        ("rows", lambda rows: rows[:1]),
        ("turns", lambda turns: turns[:, 0]),
        ("warps", lambda warps: warps[:2]),
    ],
)
def test_damaged_clones_are_refused(clones, name, damage):
    tensors = generation_tensors(clones)
    tensors[name] = damage(tensors[name])
    with pytest.raises(ValueError, match=r"clone|shape|triangles|closed|row"):
        build_generation(generation_entries(clones), tensors, clones.factors)


def test_surfaces_of_the_grains_follow_a_corrected_voxel_size(style, clones):
    project = project_of(VoxelSize(2.0, 2.0, 2.0, "mm"))
    table = project.grains.table
    own = nominal_diameters(table["volume"].to_numpy(float))
    parents = tuple(
        replace(parent, name=f"grain {label}", diameter=float(diameter))
        for parent, label, diameter in zip(style.parents, table["label"], own, strict=False)
    )
    of_grains = replace(style, parents=parents, avatars=style.avatars[: len(parents)])
    project.change("Learn", surfaces=of_grains, surface_clones=clones)
    assert project.correct_voxel_size("5 mm").notes == ()
    found = project.state
    assert found.surfaces.parents[0].diameter == pytest.approx(2.5 * parents[0].diameter)
    np.testing.assert_allclose(
        found.surface_clones.factors.column("volume"), 2.5**3 * clones.factors.column("volume")
    )
    before, after = clones.clones[0], found.surface_clones.clones[0]
    np.testing.assert_allclose(after.surface.vertices, 2.5 * before.surface.vertices)
    np.testing.assert_allclose(after.fitted.avatar.weights, 2.5**2 * before.fitted.avatar.weights)
    project.undo()
    project.change("Learn", surfaces=style)
    assert "was not learned from these grains" in project.correct_voxel_size("5 mm").notes[0]
    assert project.state.surfaces is style


def test_surfaces_of_grains_of_another_form_go(style):
    project = project_of(VoxelSize(2.0, 2.0, 2.0, "mm"))
    table = project.grains.table
    own = nominal_diameters(table["volume"].to_numpy(float))
    parents = tuple(
        replace(parent, name=f"grain {label}", diameter=float(diameter))
        for parent, label, diameter in zip(style.parents, table["label"], own, strict=False)
    )
    project.change("Learn", surfaces=replace(style, parents=parents, avatars=()))
    notes = project.correct_voxel_size("5 2 2 mm").notes
    assert any("go too" in note for note in notes)
    assert project.state.surfaces is None


def test_surfaces_are_merged_as_other_styles_are(style, clones):
    base = ProjectState()
    ours, theirs = replace(base, surfaces=style), replace(base)
    assert merge_states(base, ours, theirs).state.surfaces is style
    assert merge_states(base, base, replace(base, surfaces=style)).state.surfaces is style
    other = replace(style, modes=0.5 * style.modes)
    with pytest.raises(ProjectError, match="another style"):
        merge_states(base, replace(base, surfaces=style), replace(base, surfaces=other))


def test_undo_brings_surfaces_back(style):
    project = Project.new()
    project.history.push(replace(project.state, surfaces=style), "Learn style")
    assert project.history.undo().surfaces is None
    assert project.history.redo().surfaces is style
