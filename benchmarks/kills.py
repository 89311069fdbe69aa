"""What SIGKILLs at random times cost: programs are killed in their work, and what they had done is sought.

Usage: python benchmarks/kills.py [--kills 300] [--seed 0] [--only fit,save,...]

Each kind of work runs once to its end, which gives its duration; then copies of it are killed at moments that
are even over that. A copy writes down what it reports as done. Afterwards all of that must be there, whole,
and what is there must be what the undisturbed run has found. After every fifth kill the same work is done
again, and nothing of the killed one may lie about. Prints a Markdown table, and what was missing.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
import tifffile
import trimesh

from mbstudio.cli import going_on, main
from mbstudio.core.batch import kept_answers
from mbstudio.core.dem.manifest import check_digests, read_manifest
from mbstudio.core.project import Autosave, FitSettings, Project
from mbstudio.core.project.merging import same_fit
from mbstudio.core.vae.generate import generator
from mbstudio.core.vae.models import training
from mbstudio.core.vae.models.style_learner import load_style_learner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.serialize.serialization import save_serialization
from mbstudio.core.vae.serialize.serializer import serialize

generator._SPARE = 10  # candidates for each clone, so that it takes seconds
STONES = 12
FIT = ("--unit", "mm", "--resolution", "14", "-n", "3", "--workers", "0")
SHARES = {"fit": 60, "segment": 30, "learn": 30, "generate": 40, "export": 50, "save": 40, "autosave": 40,
          "window": 10}  # fmt: skip
"""Of 300 kills."""


class Work(ABC):
    """A kind of work in a folder of its own; what goes on is done again after some of the kills.

    Attributes
    ----------
    goes_on : bool
    begins_late : bool
        Whether kills come after the first report alone.
    """

    goes_on, begins_late = True, False

    def __init__(self, folder: Path, parts: Path) -> None:
        self.folder, self.parts, self.report = folder, parts, folder / "report"

    def prepare(self) -> None:
        """Make the folder as it is before the work."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        self.report.touch()

    def tell(self, *words: object) -> None:
        """Report something as done."""
        handle = os.open(self.report, os.O_WRONLY | os.O_APPEND)
        os.write(handle, (" ".join(map(str, words)) + "\n").encode())
        os.close(handle)

    def told(self) -> list[list[str]]:
        return [line.split() for line in self.report.read_text().splitlines()]

    def start(self) -> int:
        """Begin the work in a copy of this process; return its number."""
        process = os.fork()
        if not process:
            os.chdir(self.folder)
            in_silence(self.do)
        return process

    def wait_until_begun(self) -> None:
        """Wait until the work is where kills are to come."""
        deadline = time.monotonic() + 600
        while self.begins_late and not self.told() and time.monotonic() < deadline:
            time.sleep(0.02)

    @abstractmethod
    def do(self) -> None: ...

    @abstractmethod
    def missing(self) -> list[str]:
        """Return what was reported as done and is not there, or is not whole."""

    def litter(self) -> list[str]:
        """Return what lies about after the same work was done again."""
        return [
            path.name
            for path in self.folder.iterdir()
            if path.name.startswith(".") or "unfinished" in path.name
        ]


def after(owner: Any, name: str, told: Callable[..., None]) -> None:
    """Let something be told whenever a function or method has returned."""
    call = getattr(owner, name)

    def and_tell(*arguments: Any, **named: Any) -> Any:
        found = call(*arguments, **named)
        told(*arguments)
        return found

    setattr(owner, name, and_tell)


def opened(path: Path) -> Project:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Project.open(path)


class Fit(Work):
    """`mbstudio fit` of meshes into a project."""

    def do(self) -> None:
        after(going_on.FinishedFits, "keep", lambda _, label, fit: self.tell(label))
        main(["fit", str(self.parts / "stones"), *FIT, "-o", "sand.mbs"])

    def missing(self) -> list[str]:
        path, labels = self.folder / "sand.mbs", [int(words[0]) for words in self.told()]
        if not path.exists():
            return [f"grain {label}" for label in labels]
        fits, true = opened(path).fits, opened(self.parts / "fitted.mbs").fits
        lost = [f"grain {label}" for label in labels if label not in fits]
        return lost + [
            f"grain {label} differs" for label, fit in fits.items() if not same_fit(fit, true[label])
        ]


class Segment(Work):
    """`mbstudio segment` of a scan into a project."""

    def do(self) -> None:
        after(Project, "save", lambda *_: self.tell("saved"))
        main(["segment", str(self.parts / "scan.tif"), "--voxel-size", "14 um", "-o", "sand.mbs"])

    def missing(self) -> list[str]:
        path = self.folder / "sand.mbs"
        if not path.exists():
            return ["the grains"] if self.told() else []
        grains = opened(path).grains
        return [] if grains is not None and len(grains) == 2 else ["whole grains"]


class Learn(Work):
    """`mbstudio learn`, with its checkpoints."""

    def do(self) -> None:
        after(training, "write_checkpoint", lambda one, _: self.tell("step", one.history[-1].step))
        main(["learn", str(self.parts / "avatars.npz"), "-o", "style", "--steps", "60"])

    def missing(self) -> list[str]:
        steps = [int(words[1]) for words in self.told()]
        if (self.folder / "style").exists():
            load_style_learner(self.folder / "style")
        elif steps:
            _, tensors = training._read(self.folder / "style.checkpoint")
            if tensors["history"][-1, 0] < steps[-1]:
                return [f"step {steps[-1]}"]
        return []


class Generate(Work):
    """`mbstudio generate`, with its kept results."""

    def do(self) -> None:
        after(kept_answers.KeptAnswers, "keep", lambda *_: self.tell("result"))
        main(["generate", str(self.parts / "style"), "--count", "8", "-o", "clones", "--workers", "1"])

    def missing(self) -> list[str]:
        folder, results = self.folder / "clones", len(self.told())
        if folder.exists():
            check_digests(folder, read_manifest(folder))
            true, found = ((place / "factors.csv").read_bytes() for place in (self.parts / "clones", folder))
            return [] if found == true else ["the same clones"]
        if not results:
            return []
        kept = len(kept_answers._own_records(self.folder / "clones.unfinished"))
        return [f"{results - kept} results"] if kept < results else []


class Export(Work):
    """`mbstudio export` into the folder of an earlier export."""

    def prepare(self) -> None:
        super().prepare()
        shutil.copytree(self.parts / "earlier", self.folder / "out")

    def do(self) -> None:
        main(["export", str(self.parts / "fitted.mbs"), "--to", "comflusom", "--select", "all", "-o", "out"])
        self.tell("exported")

    def missing(self) -> list[str]:
        from mbstudio.core.dem.folder import roll_back

        folder = self.folder / "out"
        roll_back(folder)
        check_digests(folder, found := read_manifest(folder))
        return [] if found["target"] == "comflusom" or not self.told() else ["the export"]


class Save(Work):
    """Saving a project again and again."""

    def do(self) -> None:
        project = opened(self.parts / "fitted.mbs")
        for n in range(1, 25):
            project.change("Settings", fit_settings=FitSettings(n=n))
            project.save(self.folder / "sand.mbs")
            self.tell(n)

    def missing(self) -> list[str]:
        done = max((int(words[0]) for words in self.told()), default=0)
        if not (self.folder / "sand.mbs").exists():
            return [f"save {done}"] if done else []
        project = opened(self.folder / "sand.mbs")
        whole = len(project.fits) == STONES and project.state.fit_settings.n >= done
        return [] if whole else [f"save {done}"]


class Autosaving(Work):
    """Writing the window's autosave again and again, with avatars in its journal."""

    goes_on = False  # the next program has a folder of its own

    def do(self) -> None:
        state = opened(self.parts / "fitted.mbs").state
        kept = Autosave.begin(self.folder / "autosave")
        project = Project(replace(state, fits={}))
        kept.write(project.state)
        project.begin_journal(kept.journal)
        for n, (label, fit) in enumerate(state.fits.items(), start=1):
            project.keep_finished({label: fit})
            self.tell("grain", label)
            project.change("Settings", fit_settings=FitSettings(n=n))
            kept.write(project.state)
            self.tell("written", n)

    def missing(self) -> list[str]:
        told = self.told()
        if not told:
            return []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            (found,) = Autosave.find_abandoned(self.folder / "autosave")
            project = found.restore()
        found.release()
        written = max((int(words[1]) for words in told if words[0] == "written"), default=0)
        lost = [
            f"grain {words[1]}" for words in told if words[0] == "grain" and int(words[1]) not in project.fits
        ]
        return lost + ([f"autosave {written}"] if written and project.state.fit_settings.n < written else [])


_WINDOW = """
import os, sys
from PySide6.QtCore import QTimer
from mbstudio.core.project.project import Project
from mbstudio.ui.shell import app
from mbstudio.ui.shell.main_window import MainWindow

application = app.make_application()
begun, keep = [], Project.keep_finished

def and_tell(self, fits, grains=None):
    trouble = keep(self, fits, grains)
    with open("report", "a") as report:
        report.write("".join(f"{label}\\n" for label in fits))
    return trouble

Project.keep_finished = and_tell

def work():
    window = next((w for w in application.topLevelWidgets() if isinstance(w, MainWindow)), None)
    if window is not None and window.workspace.state.grains is not None and not begun:
        begun.append(True)
        window.workspace.change_fit_settings(n=3)
        window.stations.fit.work.fit_all()
    elif begun and not window.stations.fit.work.all_run.is_running and window.queue.is_idle:
        if window.workspace.is_modified:
            window.project_files.save()
        else:
            window.close()

timer = QTimer()
timer.timeout.connect(work)
timer.start(50)
sys.exit(app.run(project_path="sand.mbs"))
"""


class Window(Fit):
    """The window in the midst of "Fit all", after the first grain was reported."""

    goes_on, begins_late = False, True

    def prepare(self) -> None:
        super().prepare()
        shutil.copy(self.parts / "found.mbs", self.folder / "sand.mbs")

    def start(self) -> int:
        environment = os.environ | {"XDG_STATE_HOME": str(self.folder), "MBSTUDIO_PROCESSES": "1"}
        program = subprocess.Popen(
            [sys.executable, "-c", _WINDOW], cwd=self.folder, env=environment, stderr=subprocess.DEVNULL
        )
        program.returncode = 0  # waited for by its number
        return program.pid


def make_parts(folder: Path, kinds: Collection[str]) -> None:
    """Make what the works of these kinds begin from."""
    rng = np.random.default_rng(1)
    (folder / "stones").mkdir()
    for number in range(STONES):
        stone = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
        stone.apply_scale(rng.uniform(0.7, 1.3, 3)).export(folder / "stones" / f"s{number:02d}.stl")
    call(folder, "fit", "stones", *FIT, "-o", "fitted.mbs")
    project = opened(folder / "fitted.mbs")
    avatars = project.avatars
    project.change("Without", fits={})
    project.save(folder / "found.mbs")
    project.close()
    if "segment" in kinds:
        place = np.moveaxis(np.indices((40, 40, 60)), 0, -1)
        solid = np.linalg.norm(place - (20, 20, 17), axis=-1) < 11
        solid |= np.linalg.norm(place - (20, 20, 42), axis=-1) < 12
        grey = np.where(solid, 30_000, 8_000) + rng.normal(0, 500, solid.shape)
        tifffile.imwrite(folder / "scan.tif", grey.astype(np.uint16))
    if "learn" in kinds or "generate" in kinds:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            parents = serialize(avatars, 8)
        save_serialization(parents, folder / "avatars.npz")
        learn(parents, preset="pca", seed=0).save(folder / "style")
    if "generate" in kinds:
        call(folder, "generate", "style", "--count", "8", "-o", "clones", "--workers", "1")
    if "export" in kinds:
        call(folder, "export", "fitted.mbs", "--to", "metaball", "--select", "all", "-o", "earlier")


def call(folder: Path, *words: str) -> None:
    """Run the command line in a copy of this process."""
    process = os.fork()
    if not process:
        os.chdir(folder)
        in_silence(lambda: main(list(words)))
    if status := os.waitpid(process, 0)[1]:
        sys.exit(f"{' '.join(words)} ended with {status}.")


def in_silence(work: Callable[[], object]) -> NoReturn:
    """Do work without a word, unless it fails, and end this process."""
    sink = io.StringIO()
    try:
        with warnings.catch_warnings(), redirect_stdout(sink), redirect_stderr(sink):
            warnings.simplefilter("ignore")
            work()
    except SystemExit as left:
        if left.code:
            os.write(2, sink.getvalue().encode())
            os._exit(1)
    except BaseException as error:
        os.write(2, repr(error).encode())
        os._exit(1)
    os._exit(0)


def killed(work: Work, moment: float) -> bool:
    """Begin the work and kill it; return whether it was still at it."""
    work.prepare()
    process = work.start()
    work.wait_until_begun()
    time.sleep(moment)
    os.kill(process, signal.SIGKILL)
    return os.waitpid(process, 0)[1] == signal.SIGKILL


def duration(work: Work) -> float:
    """Return the seconds that the work takes undisturbed, from where kills are to come."""
    work.prepare()
    process = work.start()
    work.wait_until_begun()
    begun = time.monotonic()
    status = os.waitpid(process, 0)[1]
    if status:
        sys.exit(f"{type(work).__name__} ended with {status} without being killed.")
    seconds = time.monotonic() - begun
    if lost := work.missing():
        sys.exit(f"{type(work).__name__}: {lost} without being killed.")
    return seconds


def try_kind(name: str, work: Work, kills: int, rng: np.random.Generator) -> list[str]:
    """Kill a kind of work; print its row of the table; return what was missing."""
    seconds = duration(work)
    inside, reported, lost = 0, 0, []
    for number in range(kills):
        inside += killed(work, seconds * float(rng.random()))
        reported += len(work.told())
        try:
            lost += [f"{name}, kill {number}: {one}" for one in work.missing()]
            if number % 5 == 0 and work.goes_on:
                status = os.waitpid(work.start(), 0)[1]
                if status:
                    lost.append(f"{name}, kill {number}: again it ended with {status}")
                lost += [f"{name}, kill {number}: {one}, done again" for one in work.missing()]
                lost += [f"{name}, kill {number}: {one} lies about" for one in work.litter()]
        except Exception as error:
            lost.append(f"{name}, kill {number}: {type(error).__name__}: {error}")
    summary = str(type(work).__doc__).rstrip(".")
    print(f"| {name} | {summary} | {kills} | {inside} | {reported} | {len(lost)} |", flush=True)
    return lost


KINDS: dict[str, type[Work]] = {
    "fit": Fit, "segment": Segment, "learn": Learn, "generate": Generate, "export": Export, "save": Save,
    "autosave": Autosaving, "window": Window,
}  # fmt: skip


def run() -> None:
    """Try all kinds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default=",".join(KINDS))
    given = parser.parse_args()
    rng, lost, kinds = np.random.default_rng(given.seed), [], given.only.split(",")
    with tempfile.TemporaryDirectory() as place:
        parts = Path(place) / "parts"
        parts.mkdir()
        make_parts(parts, kinds)
        print(
            "| Work | | Kills | Still at work | Reported as done | Missing |\n|---|---|---|---|---|---|",
            flush=True,
        )
        for name in kinds:
            work = KINDS[name](Path(place) / name, parts)
            lost += try_kind(name, work, max(1, round(given.kills * SHARES[name] / 300)), rng)
    print(*lost, sep="\n")
    sys.exit(bool(lost))


if __name__ == "__main__":
    run()
