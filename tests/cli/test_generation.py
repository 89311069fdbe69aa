"""``mbstudio learn`` and ``mbstudio generate``, from serialized avatars to files and a report."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from mbstudio.core.dem.formats.metaball import read_metaball
from mbstudio.core.metaball.validity import check
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.style_learner import load_style_learner
from mbstudio.core.vae.serialize.serialization import save_serialization
from tests.core.vae.boxes import boxes


@pytest.fixture(autouse=True)
def few_candidates(monkeypatch):
    monkeypatch.setattr("mbstudio.core.vae.generate.generator._SPARE", 10)


@pytest.fixture
def style(mbstudio, tmp_path):
    save_serialization(boxes(12, np.random.default_rng(5)), tmp_path / "parents.npz")
    ran = mbstudio("learn", tmp_path / "parents.npz", "-o", tmp_path / "style", "--preset", "pca", "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["parents"] == 12
    assert json.loads(ran.out)["control_points"] == 8
    return tmp_path / "style"


def test_clones_are_written_with_their_factors_and_a_report(mbstudio, style, tmp_path):
    folder, report = tmp_path / "clones", tmp_path / "report.html"
    ran = mbstudio(
        "generate", style, "--count", 12, "--seed", 1, "-o", folder, "--where", "csf=0.7..0.95",
        "--workers", 1, "--report", report, "--json",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    said = json.loads(ran.out)
    assert said["clones"] == 12
    assert said["quality"]["valid_after"] == 1.0
    table = pd.read_csv(folder / "factors.csv")
    assert list(table["name"]) == [f"clone_{i:02d}" for i in range(1, 13)]
    assert table["csf"].between(0.7, 0.95).all()
    avatar = read_metaball(folder / "clone_03.json")
    assert avatar.n == 8
    assert check(avatar).valid
    volume = avatar.mesh(64).volume
    assert volume == pytest.approx(table["volume_mm3"][2], rel=0.01)
    assert "factors.csv" in json.loads((folder / "manifest.json").read_text())["files"]
    text = report.read_text(encoding="utf-8")
    for words in ("How new they are", "What was asked for", "Errors of the factors", "data:image/svg+xml"):
        assert words in text


def test_bad_calls_say_one_line_and_write_nothing(mbstudio, style, tmp_path):
    clones = tmp_path / "clones"
    for arguments, words in (
        (("--where", "csf=0.1..0.2"), "cannot give"),
        (("--where", "shape=3"), "not a factor"),
        (("--count", "0"), "1 or more"),
    ):
        ran = mbstudio("generate", style, "--count", 4, "-o", clones, "--workers", 1, *arguments)
        assert ran.code == 1
        assert words in ran.err
        assert len([line for line in ran.err.splitlines() if line.startswith("mbstudio:")]) == 1
        assert not clones.exists()
    ran = mbstudio("generate", tmp_path, "-o", clones)
    assert ran.code == 1
    assert not clones.exists()
    ran = mbstudio("generate", style, "-o", style)
    assert ran.code == 1
    assert "another folder" in ran.err


def test_learning_refuses_what_it_cannot_use(mbstudio, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    save_serialization(boxes(12, np.random.default_rng(5)), tmp_path / "parents.npz")
    for arguments, words in (
        (("missing.mbs", "-o", "style"), "does not exist"),
        (("empty", "-o", "style"), "no meshes"),
        (("parents.npz", "-o", "full"), "other files"),
        (("parents.npz", "-o", "parents.npz"), "is a file"),
        (("parents.npz", "-o", "style", "--preset", "pca", "--steps", "5"), "--steps"),
    ):
        paths = [tmp_path / word if not word.startswith("-") and word not in ("pca", "5") else word
                 for word in arguments]  # fmt: skip
        ran = mbstudio("learn", *paths)
        assert ran.code == 1, arguments
        assert words in ran.err
        assert not (tmp_path / "style").exists()
    assert (tmp_path / "full" / "notes.txt").read_text() == "mine"


def test_learning_on_adds_parents(mbstudio, style, tmp_path):
    save_serialization(boxes(5, np.random.default_rng(8)), tmp_path / "more.npz")
    ran = mbstudio("learn", tmp_path / "more.npz", "--on", style, "-o", tmp_path / "both", "--json")
    assert ran.code == 0, ran.err
    said = json.loads(ran.out)
    assert (said["parents"], said["preset"], said["control_points"]) == (17, "pca", 8)
    old, both = load_style_learner(style), load_style_learner(tmp_path / "both")
    assert both.parents.names[:12] == old.parents.names
    made = both.decode(both.encode(old.parents))
    assert surface_rms(old.parents, made).max() < 0.02
    ran = mbstudio("learn", tmp_path / "more.npz", "--on", tmp_path, "-o", tmp_path / "none")
    assert ran.code == 1
    assert not (tmp_path / "none").exists()
