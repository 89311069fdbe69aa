"""Styles and clones in a project file."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from mbstudio.core.errors import ProjectError
from mbstudio.core.populations import Population
from mbstudio.core.project import ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.vae.generate.conditions import Reached
from mbstudio.core.vae.generate.generation import Counts, Generation
from mbstudio.core.vae.models.training import learn
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module", params=["pca", "aligned"])
def learner(request):
    options = {"steps": 4, "record_every": 2} if request.param == "aligned" else {}
    return learn(boxes(8, np.random.default_rng(2)), request.param, **options)


@pytest.fixture
def clones():
    shapes = boxes(3, np.random.default_rng(3))
    factors = Population(
        "clones", "clones", [1, 2, 3], {"volume": [1.0, 2.0, np.nan], "sphericity": [0.7, 0.8, np.nan]}, "mm",
        "obb", "avatar", ("", "", "in two pieces"), ("", "coarse", ""),
    )  # fmt: skip
    return Generation(
        shapes, np.arange(6.0).reshape(3, 2), np.array([4, -1, 0]), factors,
        Counts(20, 15, 3, {"pieces": 2}, 1, 0), "means and deviations", 7.5,
        (Reached("mean sphericity", 0.75, 0.751, np.bool_(True)),), 11,
    )  # fmt: skip


def test_style_and_clones_come_back(tmp_path, learner, clones):
    path = tmp_path / "sand.mbs"
    write_project(path, ProjectState(style=learner, clones=clones))
    found = read_project(path)
    style, made = found.style, found.clones
    assert style.card == learner.card
    assert style.preset == learner.preset
    np.testing.assert_array_equal(style.latents, learner.latents)
    # Not only the numbers: the model that they make encodes and decodes alike.
    others = boxes(4, np.random.default_rng(5))
    others = type(others)(**{**vars(others), "template": learner.template})
    np.testing.assert_allclose(style.encode(others), learner.encode(others), atol=1e-12)
    np.testing.assert_allclose(
        style.sample(3, 1).serialization.centers, learner.sample(3, 1).serialization.centers, atol=1e-12
    )
    assert made.clones.names == ("box 0", "box 1", "box 2")
    np.testing.assert_array_equal(made.clones.centers, clones.clones.centers)
    np.testing.assert_array_equal(made.latents, [[0, 1], [2, 3], [4, 5]])
    np.testing.assert_array_equal(made.parents, [4, -1, 0])
    assert made.counts == clones.counts
    assert made.reached == clones.reached
    assert (made.how, made.effective, made.seed) == ("means and deviations", 7.5, 11)
    assert made.factors.reasons == ("", "", "in two pieces")
    assert made.factors.warnings == ("", "coarse", "")
    np.testing.assert_array_equal(made.factors.column("volume"), [1, 2, np.nan])


def test_a_project_without_style_is_written_as_before(tmp_path, clones):
    write_project(tmp_path / "old.mbs", ProjectState())
    write_project(tmp_path / "new.mbs", ProjectState(clones=clones))
    with h5py.File(tmp_path / "old.mbs") as old, h5py.File(tmp_path / "new.mbs") as new:
        assert (old.attrs["schema"], new.attrs["schema"]) == (1, 2)
        assert "style" not in old
        assert "clones" not in old
    assert read_project(tmp_path / "old.mbs").style is None


def test_nothing_is_pickled(tmp_path, learner, clones):
    path = tmp_path / "sand.mbs"
    write_project(path, ProjectState(style=learner, clones=clones))
    with h5py.File(path) as file:
        found = []
        file.visititems(lambda _, item: found.append(item))
        kinds = [item.dtype for item in found if isinstance(item, h5py.Dataset)]
    assert len(kinds) > 10
    assert all(kind.kind in "bifu" or h5py.check_string_dtype(kind) for kind in kinds)


@pytest.mark.parametrize(
    "missing", ["style/entries", "style/latents", "clones/parents", "clones/avatars/unit"]
)
def test_a_missing_part_is_named(tmp_path, clones, missing, edit_project):
    path = tmp_path / "sand.mbs"
    learner = learn(boxes(8, np.random.default_rng(2)), "pca")
    write_project(path, ProjectState(style=learner, clones=clones))
    with edit_project(path) as file:
        del file[missing]
    with pytest.raises(ProjectError, match=r"sand\.mbs"):
        read_project(path)


def test_a_newer_style_is_named(tmp_path, edit_project):
    path = tmp_path / "sand.mbs"
    write_project(path, ProjectState(style=learn(boxes(8, np.random.default_rng(2)), "pca")))
    with edit_project(path) as file:
        file["style"].attrs["format"] = 99
    with pytest.raises(ProjectError, match=r"sand\.mbs is from a newer mbstudio"):
        read_project(path)
