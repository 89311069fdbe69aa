"""``mbstudio latent``: each operation from a saved style-learner to files."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from mbstudio.core.dem.metaball import read_metaball
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.vae import learn, load_style_learner
from mbstudio.core.vae.kept_grain import measured
from mbstudio.core.vae.latent_recipe import Recipe, style_digest
from mbstudio.core.vae.meaning_factors import meaning_factors
from tests.core.vae.boxes import boxes


@pytest.fixture(scope="module")
def style(tmp_path_factory):
    folder = tmp_path_factory.mktemp("latent") / "style"
    return learn(boxes(40, np.random.default_rng(1)), preset="pca").save(folder)


def test_a_morph_begins_and_ends_at_its_parents(mbstudio, style, tmp_path):
    ends = ("--interpolate", "box 3", "8")
    ran = mbstudio("latent", style, *ends, "--steps", 5, "-o", tmp_path / "a", "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["grains"] == 5
    table = pd.read_csv(tmp_path / "a" / "latents.csv")
    assert list(table["name"]) == [f"steps_{i}" for i in range(1, 6)]
    learner = load_style_learner(style)
    latents = table.filter(regex=r"^z\d+$").to_numpy()
    np.testing.assert_allclose(latents[0], learner.latents[3], rtol=1e-9)
    known = meaning_factors(learner.parents.take([3, 7]))
    np.testing.assert_allclose(table["csf"].iloc[[0, 4]], known[:, 2], rtol=0.02)
    first = read_metaball(tmp_path / "a" / "steps_1.json")
    true = learner.decode(learner.latents[3][None]).avatar(0)
    assert first.mesh(48).volume == pytest.approx(true.mesh(48).volume, rel=1e-3)


def test_noise_is_repeatable(mbstudio, style, tmp_path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        ran = mbstudio(
            "latent", style, "--noise", 2, "--sigma", 0.2, "--count", 3, "--seed", seed, "-o", tmp_path / name
        )
        assert ran.code == 0, ran.err
    a, b, c = (pd.read_csv(tmp_path / name / "latents.csv") for name in "abc")
    pd.testing.assert_frame_equal(a, b)
    assert not np.allclose(a["z1"], c["z1"])


def test_moved_designed_and_added(mbstudio, style, tmp_path):
    learner = load_style_learner(style)
    known = meaning_factors(learner.parents)
    step = known[:, 2].std(ddof=1)
    middle = int(np.argsort(known[:, 2])[20])
    ran = mbstudio("latent", style, "--move", middle + 1, "--by", "csf=-0.5", "-o", tmp_path / "a")
    assert ran.code == 0, ran.err
    moved = pd.read_csv(tmp_path / "a" / "latents.csv")
    assert moved["csf"][0] - known[middle, 2] == pytest.approx(-0.5 * step, abs=0.1 * step)
    assert "csf=-0.5" in moved["recipe"][0]
    target = float(np.median(known[:, 2]))
    ran = mbstudio("latent", style, "--design", f"csf={target}", "-o", tmp_path / "b")
    assert ran.code == 0, ran.err
    assert pd.read_csv(tmp_path / "b" / "latents.csv")["csf"][0] == pytest.approx(target, rel=0.02)
    ran = mbstudio("latent", style, "--add", 1, 2, 2, "-o", tmp_path / "c", "--json")
    assert ran.code == 0, ran.err
    same = pd.read_csv(tmp_path / "c" / "latents.csv")["csf"][0]
    assert same == pytest.approx(known[0, 2], rel=0.02)


def test_what_it_knows(mbstudio, style):
    ran = mbstudio("latent", style, "--json")
    assert ran.code == 0, ran.err
    said = json.loads(ran.out)
    assert said["parents"] == 40
    known = meaning_factors(load_style_learner(style).parents)
    csf = next(row for row in said["meanings"] if row["meaning"] == "csf")
    assert csf["median"] == pytest.approx(np.median(known[:, 2]), rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--noise", "box 99"), "no parent 'box 99'"),
        (("--noise", "1", "--move", "2"), "one of"),
        (("--move", "1"), "--by"),
        (("--move", "1", "--by", "csf"), "no meaning with a number"),
        (("--move", "1", "--by", "colour=1"), "no meaning of the latent space"),
        (("--design", "sphericity=2"), "cannot give"),
    ],
)
def test_bad_calls_say_one_line_and_write_nothing(mbstudio, style, tmp_path, arguments, words):
    ran = mbstudio("latent", style, *arguments, "-o", tmp_path / "out")
    assert ran.code == 1
    assert words in ran.err
    assert not (tmp_path / "out").exists()


def test_an_output_folder_is_needed(mbstudio, style):
    ran = mbstudio("latent", style, "--noise", "1")
    assert ran.code == 1
    assert "-o FOLDER" in ran.err


def test_kept_grains_of_a_project_are_exported(mbstudio, tmp_path):
    learner = learn(boxes(12, np.random.default_rng(1)), preset="pca")
    recipes = [
        Recipe(name, tuple(learner.latents[row].tolist()), (), style_digest(learner))
        for row, name in enumerate(("kept 1", "flat one", "kept 3"))
    ]
    path = tmp_path / "sand.mbs"
    with Project(ProjectState(style=learner, kept=measured(learner, recipes))) as project:
        project.save(path)
    to = ("--to", "metaball", "--json")
    ran = mbstudio("export", path, *to, "--select", "kept", "-o", tmp_path / "all")
    assert ran.code == 0, ran.err
    assert (json.loads(ran.out)["avatars"], json.loads(ran.out)["left_out"]) == (3, 0)
    records = json.loads((tmp_path / "all" / "recipes.json").read_text(encoding="utf-8"))
    assert [record["name"] for record in records] == ["kept 1", "flat one", "kept 3"]
    ran = mbstudio("export", path, *to, "--select", "kept:flat one", "-o", tmp_path / "one")
    assert ran.code == 0, ran.err
    written = read_metaball(tmp_path / "one" / "flat_one.json")
    wanted = learner.decode(learner.latents[1:2]).avatar(0)
    assert written.mesh().volume == pytest.approx(wanted.mesh().volume, rel=1e-3)
    ran = mbstudio("export", path, *to, "--select", "kept:round one", "-o", tmp_path / "none")
    assert ran.code != 0
    assert "no kept grain 'round one': there are kept 1, flat one, kept 3" in ran.err
    with Project(ProjectState(style=learner)) as project:
        project.save(tmp_path / "bare.mbs")
    ran = mbstudio("export", tmp_path / "bare.mbs", *to, "--select", "kept", "-o", tmp_path / "none")
    assert "holds no kept grains" in ran.err
