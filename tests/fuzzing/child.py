"""Reads mutated files in a process of its own, whose memory and time are bounded; `harness` starts it.

What to do comes from standard input as JSON; each problem is a line of JSON on standard output. The number of
the input at hand lies in a file, so that whoever started the process knows which one ended it.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import signal
import struct
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np

PROGRESS = struct.Struct("<4Q")
"""Input at hand, inputs read, refused, and those of damage that passed without changing anything."""


def peak_bytes() -> int:
    """Return the most memory that this process has held since :func:`_forget_peak`."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM:"):
            return 1024 * int(line.split()[1])
    return 0


def _forget_peak() -> None:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


class _Child:
    def __init__(self, order: dict[str, Any]) -> None:
        from tests.fuzzing.readers import READERS

        self.order, self.folder = order, Path(order["folder"])
        self.read = READERS[order["reader"]]
        self.cases = [
            ({name: base64.b64decode(text) for name, text in files.items()}, opened)
            for files, opened in order["cases"]
        ]
        self.done, self.refused, self.same = 0, 0, 0
        self.whole: dict[tuple[int, str], str] = {}
        self.progress = os.open(self.folder / "progress", os.O_WRONLY | os.O_CREAT)

    def run(self) -> None:
        for turn in range(self.order["first"], self.order["last"]):
            self._note(turn)
            self._try(turn)
        self._note(self.order["last"])

    def _note(self, turn: int) -> None:
        os.pwrite(self.progress, PROGRESS.pack(turn, self.done, self.refused, self.same), 0)

    def _try(self, turn: int) -> None:
        from mbstudio.core.errors import MbstudioError
        from tests.fuzzing.mutation import flip_one_bit, mutate
        from tests.fuzzing.readers import require_one_line_that_names

        rng = np.random.default_rng([self.order["seed"], turn])
        number = turn % len(self.cases)
        files, opened = self.cases[number]
        place = self.folder / f"case-{number}"
        names = sorted(files)
        chosen = names[int(rng.integers(len(names)))]
        change = flip_one_bit if self.order["flips"] else mutate
        content = change(files[chosen], rng)
        for name in opened:
            whole = self._digest_of_whole(number, place, files, name) if self.order["flips"] else ""
            _write(place, {**files, chosen: content})
            signal.setitimer(signal.ITIMER_PROF, self.order["seconds"])
            signal.alarm(12 * self.order["seconds"])
            _forget_peak()
            problem = ""
            try:
                found = self.read(place / name)
                self.done += 1
                if self.order["flips"] and found != whole:
                    problem = "a flipped bit was read as something else"
                self.same += found == whole
            except MbstudioError as error:
                self.refused += 1
                try:
                    require_one_line_that_names(str(error), [str(place), name, chosen])
                except AssertionError as fault:
                    problem = str(fault)
            except BaseException as error:
                last = traceback.extract_tb(error.__traceback__)[-1]
                problem = f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {error}"
                if not isinstance(error, MemoryError):
                    problem += f"\n{traceback.format_exc()[-1500:]}"
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
                signal.alarm(0)
            peak = peak_bytes()
            if not problem and peak > self.order["most_bytes"]:
                problem = f"{peak >> 20} MiB of memory"
            if problem:
                self._tell(turn, chosen, name, problem)

    def _digest_of_whole(self, number: int, place: Path, files: dict[str, bytes], name: str) -> str:
        if (number, name) not in self.whole:
            _write(place, files)
            self.whole[number, name] = self.read(place / name)
        return self.whole[number, name]

    def _tell(self, turn: int, chosen: str, name: str, problem: str) -> None:
        print(json.dumps({"turn": turn, "file": chosen, "opened": name, "problem": problem}), flush=True)


def _write(place: Path, files: dict[str, bytes]) -> None:
    for name, content in files.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def main() -> None:
    """Do what standard input says."""
    import resource

    order: dict[str, Any] = json.load(sys.stdin)
    with contextlib.suppress(OSError, ValueError):  # macOS refuses it
        resource.setrlimit(resource.RLIMIT_AS, (order["address_bytes"],) * 2)
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    _Child(order).run()


if __name__ == "__main__":
    main()
