"""Commands that are killed: what they reported as done is there, and the same command goes on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mbstudio.core.project import Project
from mbstudio.core.vae.models.style_learner import load_style_learner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.serialize.serialization import save_serialization
from tests.core.vae.boxes import boxes

# Ends itself by a signal as soon as so many grains were kept.
_PROGRAM = textwrap.dedent(
    """
    import os, sys
    from mbstudio.cli import going_on, main

    after, number = int(sys.argv[1]), int(sys.argv[2])
    keep, count = going_on.FinishedFits.keep, 0

    def keep_and_end(self, label, fit):
        global count
        keep(self, label, fit)
        print("done", label, flush=True)
        count += 1
        if count == after:
            os.kill(os.getpid(), number)

    going_on.FinishedFits.keep = keep_and_end
    main(sys.argv[3:])
    """
)


def ended(after, number, *words):
    """Run the command line until it ends itself; return how, and which grains it told to be done."""
    ran = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(after), str(int(number)), *map(str, words)],
        capture_output=True,
        text=True,
        env=os.environ | {"MBSTUDIO_PROCESSES": "1"},
    )
    return ran, [int(line.split()[1]) for line in ran.stdout.splitlines() if line.startswith("done")]


needs_signals = pytest.mark.skipif(os.name == "nt", reason="signals")
pytestmark = pytest.mark.filterwarnings("always::mbstudio.core.errors.ProjectWarning")


@pytest.fixture
def fit(tmp_path, monkeypatch):
    """The command that fits three small stones into `sand.mbs`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stones").mkdir()
    for number in range(3):
        stone = trimesh.creation.icosphere(subdivisions=2, radius=0.5 + 0.1 * number)
        stone.apply_scale((1, 1.2, 0.8)).export(tmp_path / "stones" / f"s{number}.stl")
    return ("fit", "stones", "--unit", "mm", "--resolution", 14, "-n", 3, "-o", "sand.mbs", "--workers", 0)


@needs_signals
@pytest.mark.parametrize("after", [1, 2])
def test_the_same_command_goes_on_after_a_kill(mbstudio, fit, tmp_path, after):
    ran, done = ended(after, signal.SIGKILL, *fit)
    assert ran.returncode == -signal.SIGKILL
    assert len(done) == after
    ran = mbstudio(*fit, "--json")
    assert ran.code == 0, ran.err
    avatars = "1 avatar" if after == 1 else "2 avatars"
    assert f"{avatars} that had not been saved came back from sand.mbs.journal" in ran.err
    assert f"{after} of 3 grains were fitted before; {3 - after} to go." in ran.err
    assert json.loads(ran.out)["fitted"] == 3 - after
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["sand.mbs", "stones"]
    whole = Project.open("sand.mbs")
    assert sorted(whole.fits) == whole.grains.interior_labels
    # As if nothing had happened.
    assert mbstudio(*(word if word != "sand.mbs" else "at once.mbs" for word in fit)).code == 0
    for label, result in Project.open("at once.mbs").fits.items():
        np.testing.assert_array_equal(whole.fits[label].avatar.weights, result.avatar.weights)
        np.testing.assert_array_equal(whole.fits[label].avatar.centers, result.avatar.centers)


@needs_signals
def test_the_project_goes_on_as_well_and_other_commands_see_what_was_finished(mbstudio, fit):
    ended(2, signal.SIGKILL, *fit)
    ran = mbstudio("measure", "sand.mbs", "--json", "--workers", 0)
    assert ran.code == 0
    assert "2 avatars that had not been saved came back" in ran.err
    assert sum("avatar" in row for row in json.loads(ran.out)["grains"]) == 2
    ran = mbstudio("fit", "sand.mbs", "-n", 3, "--workers", 0)
    assert "2 of 3 grains were fitted before; 1 to go." in ran.err
    assert len(Project.open("sand.mbs").fits) == 3
    ran = mbstudio("fit", "sand.mbs", "-n", 3, "--workers", 0, "--refit", "--json")
    assert "before" not in ran.err
    assert json.loads(ran.out)["fitted"] == 3


@needs_signals
def test_a_terminated_command_saves_what_is_finished(fit, tmp_path):
    ran, done = ended(2, signal.SIGTERM, *fit)
    assert ran.returncode == 130
    assert "interrupted; 1 grain is left" in ran.stderr
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["sand.mbs", "stones"]
    assert sorted(Project.open("sand.mbs").fits) == sorted(done)


@needs_signals
def test_a_file_of_other_avatars_gives_way_with_the_first_new_one(mbstudio, fit):
    assert mbstudio(*fit).code == 0
    finer = [word if word != 14 else 15 for word in fit]
    assert mbstudio(*(word if word != 3 else 5_000 for word in finer)).code == 1, "none can be fitted"
    assert len(Project.open("sand.mbs").fits) == 3
    _, done = ended(1, signal.SIGKILL, *finer)
    assert len(done) == 1
    assert sorted(Project.open("sand.mbs").fits) == done
    ran = mbstudio(*finer)
    assert ran.code == 0
    assert "1 of 3 grains were fitted before; 2 to go." in ran.err
    assert len(Project.open("sand.mbs").fits) == 3


def test_a_scan_is_not_segmented_twice(mbstudio, fitted_project, small_scan_file, tmp_path):
    path = shutil.copy(fitted_project, tmp_path / "sand.mbs")
    words = ("fit", small_scan_file, "--voxel-size", "14 um", "-n", 12, "-o", path, "--workers", 0, "--json")
    ran = mbstudio(*words)
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["fitted"] == 0
    assert "3 of 3 grains were fitted before; 0 to go." in ran.err
    assert "Finding grains" not in ran.err
    project = Project.open(path)
    assert len(project.fits) == 3
    # Other voxels make other grains: nothing is continued.
    other = [word if word != "14 um" else "15 um" for word in words]
    assert "before" not in mbstudio(*other, "--limit", 1).err
    assert Project.open(path).grains.voxel_size.x == 15


# ---- measure, generate, learn ----------------------------------------------------------------------

# Ends itself by a kill as soon as so many results were kept, or as many checkpoints written.
_KEEPING = textwrap.dedent(
    """
    import os, signal, sys
    from mbstudio.cli import main
    from mbstudio.core.batch import kept_answers
    from mbstudio.core.vae.models import training

    what, after = sys.argv[1], int(sys.argv[2])
    count = 0

    def and_die(call):
        def counted(*arguments):
            global count
            call(*arguments)
            count += 1
            if count == after:
                os.kill(os.getpid(), signal.SIGKILL)
        return counted

    if what == "results":
        kept_answers.KeptAnswers.keep = and_die(kept_answers.KeptAnswers.keep)
    else:
        training.write_checkpoint = and_die(training.write_checkpoint)
    main(sys.argv[3:])
    """
)


def killed_after(what, after, *words):
    ran = subprocess.run(
        [sys.executable, "-c", _KEEPING, what, str(after), *map(str, words)], capture_output=True, text=True
    )
    assert ran.returncode == -signal.SIGKILL, ran.stderr


@needs_signals
def test_measuring_goes_on_and_gives_the_same(mbstudio, fit):
    words = ("measure", "stones", "--unit", "mm", "--workers", 1, "--csv")
    assert mbstudio(*words, "at once.csv").code == 0
    killed_after("results", 2, *words, "table.csv")
    assert not Path("table.csv").exists()
    ran = mbstudio(*words, "table.csv")
    assert "going on with 2 results of an earlier run (table.csv.unfinished)." in ran.err
    assert Path("table.csv").read_bytes() == Path("at once.csv").read_bytes()
    assert not Path("table.csv.unfinished").exists()


@needs_signals
def test_generating_goes_on_and_gives_the_same(mbstudio, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    learn(boxes(20, np.random.default_rng(2)), preset="pca", seed=0).save(tmp_path / "style")
    words = ("generate", "style", "--count", 6, "--seed", 3, "--workers", 1, "-o")
    assert mbstudio(*words, "at once").code == 0
    killed_after("results", 3, *words, "clones")
    assert not Path("clones").exists()
    ran = mbstudio(*words, "clones")
    assert "going on with 3 results of an earlier run" in ran.err
    whole, again = (
        {path.name: path.read_bytes() for path in Path(folder).rglob("*.csv")}
        for folder in ("at once", "clones")
    )
    assert whole == again
    assert sorted(path.name for path in tmp_path.iterdir()) == ["at once", "clones", "style"]


@needs_signals
def test_learning_goes_on_and_gives_the_same(mbstudio, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_serialization(boxes(20, np.random.default_rng(2)), tmp_path / "avatars.npz")
    words = ("learn", "avatars.npz", "--steps", 40, "-o")
    assert mbstudio(*words, "at once").code == 0
    killed_after("checkpoints", 2, *words, "style")
    assert not Path("style").exists()
    ran = mbstudio(*words, "style")
    assert "going on from step" in ran.err
    at_once, style = load_style_learner(Path("at once")), load_style_learner(Path("style"))
    np.testing.assert_array_equal(at_once.latents, style.latents)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["at once", "avatars.npz", "style"]
    # Learning on goes on likewise.
    save_serialization(boxes(24, np.random.default_rng(2)).take(np.arange(20, 24)), tmp_path / "new.npz")
    more = ("learn", "new.npz", "--on", "style", "--steps", 40, "-o")
    assert mbstudio(*more, "on at once").code == 0
    killed_after("checkpoints", 2, *more, "on")
    assert "going on from step" in mbstudio(*more, "on").err
    at_once, on = load_style_learner(Path("on at once")), load_style_learner(Path("on"))
    assert len(on.latents) == 24
    np.testing.assert_array_equal(at_once.latents, on.latents)
    # From another learner it begins anew.
    killed_after("checkpoints", 2, *more, "third")
    learned = mbstudio("learn", "avatars.npz", "--steps", 42, "-o", "style")
    assert learned.code == 0
    assert "third.checkpoint is damaged or of another training" in mbstudio(*more, "third").err
    # A checkpoint of another training, and one that was damaged, are no beginning.
    killed_after("checkpoints", 2, *words, "other", "--seed", 1)
    checkpoint = Path("other.checkpoint")
    ran = mbstudio(*words, "other")
    assert "other.checkpoint is damaged or of another training, which begins anew." in ran.err
    assert not checkpoint.exists()
