"""``mbstudio latent``: each operation from a saved style-learner to files."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from mbstudio.core.dem.formats.metaball import read_metaball
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.vae.models.style_learner import load_style_learner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping.kept_grain import measure_recipes
from mbstudio.core.vae.shaping.latent import clamp, farthest, mean_latent
from mbstudio.core.vae.shaping.latent_recipe import Recipe, style_digest
from mbstudio.core.vae.shaping.meaning_factors import meaning_factors
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
        (("--move", "1", "--by", "csf"), "not a meaning with a number"),
        (("--move", "1", "--by", "colour=1"), "not a meaning of the latent space"),
        (("--design", "sphericity=2"), "No body can have"),
        (("--design", "csf=0.6", "--design", "sphericity=0.99"), "most spherical body of csf 0.6 has 0.953"),
        (("--design", "size=1000"), "cannot give"),
        (("--blend", "box 3"), "a grain with a weight"),
        (("--blend", "box 3=1", "--take", "1"), "one of"),
        (("--take", "nothing.stl"), "no such file"),
    ],
)
def test_bad_calls_say_one_line_and_write_nothing(mbstudio, style, tmp_path, arguments, words):
    ran = mbstudio("latent", style, *arguments, "-o", tmp_path / "out")
    assert ran.code == 1
    assert words in ran.err
    assert not (tmp_path / "out").exists()


def test_grains_made_before_are_taken_up_again(mbstudio, style, tmp_path):
    """From the table of an earlier run, from kept grains of the window, from an avatar and from a mesh."""
    learner = load_style_learner(style)
    ran = mbstudio("latent", style, "--take", "box 3", "-o", tmp_path / "a")
    assert ran.code == 0, ran.err
    recipe = Recipe("kept 1", tuple(learner.latents[5].tolist()), (), style_digest(learner))
    kept = tmp_path / "recipes.json"
    kept.write_text(json.dumps([recipe.as_record()]), encoding="utf-8")
    learner.parents.avatar(3).mesh(48).export(tmp_path / "box.stl")
    sources = (
        f"{tmp_path / 'a' / 'latents.csv'}:grain_1", f"{kept}:kept 1", tmp_path / "a" / "grain_1.json",
        tmp_path / "box.stl",
    )  # fmt: skip
    taken = [part for source in sources for part in ("--take", source)]
    ran = mbstudio("latent", style, *taken, "-o", tmp_path / "b")
    assert ran.code == 0, ran.err
    table = pd.read_csv(tmp_path / "b" / "latents.csv")
    latents = table.filter(regex=r"^z\d+$").to_numpy()
    np.testing.assert_allclose(latents[:2], learner.latents[[3, 5]], rtol=1e-9)
    known = meaning_factors(learner.parents.take([3]))[0]
    np.testing.assert_allclose(table["sphericity"].iloc[[2, 3]], known[3], rtol=0.01)
    np.testing.assert_allclose(table["dn_mm"].iloc[[2, 3]], np.exp(known[0]), rtol=0.01)


def test_a_blend_of_one_grain_is_the_grain_and_of_none_the_mean(mbstudio, style, tmp_path):
    learner = load_style_learner(style)
    for weight, wanted in ((1, learner.latents[3]), (0, mean_latent(learner))):
        folder = tmp_path / str(weight)
        ran = mbstudio("latent", style, "--blend", f"box 3={weight}", "-o", folder)
        assert ran.code == 0, ran.err
        found = pd.read_csv(folder / "latents.csv").filter(regex=r"^z\d+$").to_numpy()[0]
        np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_what_lies_far_outside_is_held_unless_it_may(mbstudio, style, tmp_path):
    learner = load_style_learner(style)
    limit = mean_latent(learner) + farthest(learner)
    far = np.clip(5 * learner.latents[3], -limit, limit) * 1.2
    table = pd.DataFrame([{"name": "far", **{f"z{k + 1}": value for k, value in enumerate(far)}}])
    table.to_csv(tmp_path / "latents.csv", index=False)
    take = ("--take", f"{tmp_path / 'latents.csv'}:far", "--json", "-o")
    ran = mbstudio("latent", style, *take, tmp_path / "held")
    assert ran.code == 0, ran.err
    assert "farther from the mean than any" in ran.err
    assert json.loads(ran.out)["held_at_their_range"] == 1
    held = pd.read_csv(tmp_path / "held" / "latents.csv").filter(regex=r"^z\d+$").to_numpy()[0]
    np.testing.assert_allclose(held, clamp(learner, far))
    ran = mbstudio("latent", style, *take, tmp_path / "free", "--beyond")
    if ran.code == 0:
        assert json.loads(ran.out)["far_outside_the_parents"] == 1
    else:
        assert "None of these grains is a valid body" in ran.err


def test_a_step_that_falls_short_says_so(mbstudio, style, tmp_path):
    ran = mbstudio("latent", style, "--move", 3, "--by", "csf=40", "-o", tmp_path / "a")
    assert ran.code == 0, ran.err
    assert "of +40 s.d." in ran.err


def test_latents_of_another_size_are_refused(mbstudio, style, tmp_path):
    path = tmp_path / "latents.csv"
    pd.DataFrame([{"name": "a", "z1": 0.1, "z2": 0.2}]).to_csv(path, index=False)
    ran = mbstudio("latent", style, "--take", f"{path}:a", "-o", tmp_path / "out")
    assert ran.code == 1
    assert "latent vectors of 2 numbers" in ran.err
    ran = mbstudio("latent", style, "--take", f"{path}:b", "-o", tmp_path / "out")
    assert ran.code == 1
    assert "no latent vector named 'b'" in ran.err
    recipe = Recipe("kept 1", tuple(load_style_learner(style).latents[5].tolist()), (), "0" * 16)
    kept = tmp_path / "recipes.json"
    kept.write_text(json.dumps([recipe.as_record()]), encoding="utf-8")
    for name, words in (("kept 1", "another style-learner"), ("kept 2", "it contains kept 1")):
        ran = mbstudio("latent", style, "--take", f"{kept}:{name}", "-o", tmp_path / "out")
        assert ran.code == 1
        assert words in ran.err


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
    with Project(ProjectState(style=learner, kept=measure_recipes(learner, recipes))) as project:
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
    assert "no kept grain 'round one': choose from kept 1, flat one, kept 3" in ran.err
    with Project(ProjectState(style=learner)) as project:
        project.save(tmp_path / "bare.mbs")
    ran = mbstudio("export", tmp_path / "bare.mbs", *to, "--select", "kept", "-o", tmp_path / "none")
    assert "has no kept grains" in ran.err
