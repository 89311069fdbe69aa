"""Generating: repeatable, with conditions met or refused, each clone with a metaball near its surface."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.cloning.clone_maker import CloneOptions
from mbstudio.core.cloning.surface_generation import generate_surfaces
from mbstudio.core.cloning.surface_generation_file import (
    build_generation,
    generation_entries,
    generation_tensors,
)
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError


def test_each_clone_has_a_metaball_near_its_surface(fitted_style: SurfaceStyle) -> None:
    found = generate_surfaces(fitted_style, 3, 5)
    assert [clone.name for clone in found.clones] == ["clone_1", "clone_2", "clone_3"]
    parents = np.mean([entry.rms for entry in fitted_style.avatars])
    for clone, mesh, avatar in zip(found.clones, found.meshes(), found.avatars(), strict=True):
        assert clone.fitted is not None
        assert clone.fitted.valid
        assert clone.fitted.rms < 1.6 * parents
        assert abs(avatar.mesh(cells=64).volume / mesh.volume - 1) < 0.01
        assert mesh.units == "mm"
    assert found.factors.column("volume") == pytest.approx([mesh.volume for mesh in found.meshes()], rel=1e-6)
    assert found.candidates == 3


def test_neither_processes_nor_the_number_change_a_clone(fitted_style: SurfaceStyle) -> None:
    few, many = generate_surfaces(fitted_style, 2, 1), generate_surfaces(fitted_style, 3, 1, processes=2)
    for one, other in zip(few.clones, many.clones, strict=False):
        assert (one.surface.vertices == other.surface.vertices).all()
        assert one.fitted is not None
        assert other.fitted is not None
        assert (one.fitted.avatar.centers == other.fitted.avatar.centers).all()
    another = generate_surfaces(fitted_style, 2, 2, avatars=False)
    assert another.clones[0].recipe.diameter != few.clones[0].recipe.diameter


def test_conditions_are_met(style: SurfaceStyle) -> None:
    known = generate_surfaces(style, 12, avatars=False).factors.column("csf")
    low, high = np.quantile(known, [0.3, 0.7])
    found = generate_surfaces(style, 6, targets=[f"csf={low:.3f}..{high:.3f}"], avatars=False)
    column = found.factors.column("csf")
    assert len(found) == 6
    assert column.min() >= round(low, 3)
    assert column.max() <= round(high, 3)
    assert all(figure.is_met for figure in found.reached)
    assert found.candidates > 6


def test_what_no_warp_can_give_is_refused_with_the_range(style: SurfaceStyle) -> None:
    with pytest.raises(CloningError, match=r"cannot give 4 clones .* sphericity 0\.\d+ to 0\.\d+"):
        generate_surfaces(style, 4, targets=["sphericity=0.98..0.99"], avatars=False)


def test_avatars_need_those_of_the_parents(style: SurfaceStyle) -> None:
    with pytest.raises(CloningError, match="holds no avatars of its parents"):
        generate_surfaces(style, 1)
    with pytest.raises(CloningError, match="have no metaballs"):
        generate_surfaces(style, 1, avatars=False).avatars()
    with pytest.raises(CloningError, match="must be 1 or more"):
        generate_surfaces(style, 0)


def test_clones_of_earlier_files_were_stretched_whole(fitted_style: SurfaceStyle) -> None:
    made = generate_surfaces(fitted_style, 2, seed=1, options=CloneOptions(detail_stretch=0.25))
    entries, tensors = generation_entries(made), generation_tensors(made)
    found = build_generation(entries, tensors, made.factors)
    assert [clone.recipe.detail_stretch for clone in found.clones] == [0.25, 0.25]
    assert found.options == made.options
    del tensors["detail_stretches"], entries["options"]["detail_stretch"]
    old = build_generation(entries, tensors, made.factors)
    assert [clone.recipe.detail_stretch for clone in old.clones] == [1.0, 1.0]
    assert old.options.detail_stretch == 1.0
    with pytest.raises(ValueError, match="shares of stretch"):
        build_generation(entries, {**tensors, "detail_stretches": np.array([0.5, 2.0])}, made.factors)
