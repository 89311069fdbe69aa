"""A program that finishes avatars and saves, and is ended, or refused by the disk, at any one of its steps.

Run as ``python -m tests.core.project.interrupted_program FOLDER``: every step to the disk (opening for
writing, each write, flush, renaming, removing) is the one at which a copy of the program is killed, or told
that the disk is full; half of a write is written by then. What the copy had reported as done must be there,
whole, at the next opening. Prints one line of JSON: how many steps were tried, and what was not there.
"""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd

from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.validity import Verdict
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.file import write_project
from mbstudio.core.project.merging import same_fit
from mbstudio.core.units import VoxelSize

LABELS = (2, 7, 9, 12)
KILLED = 9


def grains() -> GrainSet:
    volume = np.zeros((3, 4, 20), np.int32)
    volume[1, 1:3, list(LABELS)] = np.array(LABELS)[:, None]
    table = {"label": list(LABELS), "voxels": [2] * 4, "volume": [2.0] * 4, "touches_border": [False] * 4}
    return GrainSet(volume, pd.DataFrame(table), VoxelSize(1, 1, 1, "um"))


def fit_of(label: int, version: int) -> FitResult:
    rng = np.random.default_rng([label, version])
    avatar = Avatar(rng.normal(size=(5, 3)), rng.uniform(1, 2, 5), "um", label=label)
    verdict = Verdict(True, 1, 0, 0, 0, 0.01, 0.5)
    return FitResult(avatar, np.zeros(3), np.zeros(3), verdict, "fast", 5, version)


class Steps:
    """Counts the steps to the disk, and ends or refuses one of them."""

    def __init__(self, at: int, kind: str) -> None:
        self.count, self.at, self.kind = 0, at, kind

    def take(self, half: object = None) -> None:
        self.count += 1
        if self.count == self.at:
            if half is not None:
                half()
            if self.kind == "kill":
                os._exit(KILLED)
            raise OSError(28, "No space left on device")

    def install(self) -> None:
        for name in ("fsync", "replace", "rename", "unlink", "truncate", "ftruncate", "open"):
            setattr(os, name, self._wrapped(getattr(os, name)))
        opened = io.open

        def open_counted(file, mode="r", *more, **named):
            stream = opened(file, mode, *more, **named)
            writes = set(mode) & set("wa+x") and not str(file).endswith(".lock")
            return Written(stream, self) if writes else stream

        io.open = open_counted

    def _wrapped(self, call):
        def counted(*arguments, **named):
            if not str(arguments[0]).endswith(".lock"):
                self.take()
            return call(*arguments, **named)

        return counted


class Written:
    """An open file whose writes are steps."""

    def __init__(self, stream, steps: Steps) -> None:
        self._stream, self._steps = stream, steps

    def write(self, data):
        def half() -> None:
            self._stream.write(bytes(data)[: len(data) // 2])
            self._stream.flush()

        self._steps.take(half)
        return self._stream.write(data)

    def writelines(self, lines):
        for line in lines:
            self.write(line)

    def __enter__(self):
        self._stream.__enter__()
        return self

    def __exit__(self, *error):
        return self._stream.__exit__(*error)

    def __getattr__(self, name):
        return getattr(self._stream, name)


def work(path: Path, done: Path, steps: Steps) -> None:
    """Go on with a project; write every label that is done, and its version, at the end of a file."""
    report = os.open(done, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    steps.install()
    project = Project.open(path)
    project.hold("a test")
    for version, labels in ((1, LABELS[:2]), (2, LABELS[1:]), (3, LABELS[:1])):
        try:
            project.begin_journal()
        except Exception:
            if steps.kind == "kill":
                raise
        for label in labels:
            fit = fit_of(label, version)
            if project._journals.of(project.grains) and not project.keep_finished({label: fit}):
                os.write(report, f"{label} {version}\n".encode())
            project.add_fits({label: fit})
        under_way = {12: fit_of(12, version)}  # of a run over many, which adds them at its end
        if project._journals.of(project.grains) and not project.keep_finished(under_way):
            os.write(report, f"12 {version}\n".encode())
        try:
            project.save()
        except Exception:
            if steps.kind == "kill":
                raise
        else:
            os.write(report, "".join(f"{label} {version}\n" for label in labels).encode())
        if version < 3:
            project.add_fits(under_way)
    project.close()


def in_copy(call) -> int:
    """Run a call in a copy of this process; return how it ended."""
    process = os.fork()
    if process == 0:
        try:
            warnings.simplefilter("ignore")
            call()
        except BaseException as error:
            print(repr(error), file=sys.stderr, flush=True)
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def missing(path: Path, done: Path) -> list[str]:
    """Return what was reported as done and is not there at the next opening."""
    latest: dict[int, int] = {}
    for line in done.read_text().splitlines():
        label, version = map(int, line.split())
        latest[label] = max(version, latest.get(label, 0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        project = Project.open(path)
        found = [
            f"grain {label} of version {version}"
            for label, version in latest.items()
            # What was finished and not yet reported may be there as well.
            if not any(same_fit(fit_of(label, later), project.fits.get(label)) for later in range(version, 4))
        ]
        project.hold("a test")
        project.save()
        project.close()
    left = [entry.name for entry in path.parent.iterdir() if entry.name not in ("sand.mbs", "done")]
    return found + [f"left: {name}" for name in left]


def tried(folder: Path, kind: str, at: int) -> tuple[int, list[str]]:
    """Begin a project anew and let a copy work on it; return how that ended, and what was wrong then."""
    path, done = folder / "sand.mbs", folder / "done"
    for entry in folder.iterdir():
        entry.unlink()
    write_project(path, ProjectState(grains=grains()))
    done.write_text("")
    ended = in_copy(lambda: work(path, done, Steps(at, kind)))
    return ended, [f"{kind} at step {at}: {one}" for one in missing(path, done)]


def main(folder: Path) -> None:
    wrong: list[str] = []
    steps = 0
    while True:
        ended, found = tried(folder, "kill", steps + 1)
        wrong += found
        if ended != KILLED:
            break
        steps += 1
    for at in range(1, steps + 1):
        refused, found = tried(folder, "full", at)
        wrong += found if refused == 0 else [*found, f"full at step {at}: ended with {refused}"]
    print(json.dumps({"steps": steps, "ended": ended, "wrong": wrong}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
