"""Kept grains in a project file."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from mbstudio.core.errors import ProjectError
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping.kept_grain import KeptGrain, select_style
from mbstudio.core.vae.shaping.latent_recipe import Operation, Recipe, style_digest
from tests.core.vae.boxes import boxes

STEPS = (
    Operation("begin", {"parent": "Korn µ"}, "Korn µ"),
    Operation("noise", {"sigma": 0.3, "seed": 5, "meanings": ["size"], "beyond": True}, "noise σ 0.30"),
)


def grain(name: str, latent: tuple[float, ...], style: str = "0f") -> KeptGrain:
    return KeptGrain(Recipe(name, latent, STEPS, style), (0.1 + 0.2, 0.7, 0.6, 0.9, 1 / 3), "mm")


def test_kept_grains_come_back_to_the_last_bit(tmp_path):
    kept = (grain("flat µ", (0.1 + 0.2, -1e-17, 5e300)), grain("kept 2", (1.0,)))
    write_project(tmp_path / "sand.mbs", ProjectState(kept=kept))
    assert read_project(tmp_path / "sand.mbs").kept == kept
    with h5py.File(tmp_path / "sand.mbs") as file:
        assert h5py.check_string_dtype(file["kept/entries"].dtype)
        assert file.attrs["schema"] == 3


def test_what_a_reopened_project_makes_is_the_same_bit_by_bit(tmp_path):
    learner = learn(boxes(8, np.random.default_rng(2)), "pca")
    latent = learner.latents[3] + 0.01
    kept = (grain("kept 1", tuple(latent.tolist()), style_digest(learner)),)
    with Project(ProjectState(style=learner, kept=kept)) as project:
        project.save(tmp_path / "sand.mbs")
    state = Project.open(tmp_path / "sand.mbs").state
    (again,) = select_style(state.kept, state.style)
    before, after = (
        made.decode(vector[None]).avatar(0)
        for made, vector in ((learner, latent), (state.style, again.recipe.vector))
    )
    np.testing.assert_array_equal(after.centers, before.centers)
    np.testing.assert_array_equal(after.weights, before.weights)


def test_a_project_without_kept_grains_is_written_and_read_as_before(tmp_path):
    write_project(tmp_path / "old.mbs", ProjectState(style=learn(boxes(8, np.random.default_rng(2)), "pca")))
    with h5py.File(tmp_path / "old.mbs") as file:
        assert file.attrs["schema"] == 2
        assert "kept" not in file
    assert read_project(tmp_path / "old.mbs").kept == ()


@pytest.mark.parametrize("damage", ['{"name": "kept 1"}', "no JSON", "[]"])
def test_a_damaged_grain_is_named_with_its_file(tmp_path, damage, edit_project):
    path = tmp_path / "sand.mbs"
    write_project(path, ProjectState(kept=(grain("kept 1", (1.0,)),)))
    with edit_project(path) as file:
        file["kept/entries"][0] = damage
    with pytest.raises(ProjectError, match=r"sand\.mbs"):
        read_project(path)
