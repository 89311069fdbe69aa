"""Attacks readers with mutated files: each must be read, or refused with a named error of one line.

No other exception, no crash, no wait, no memory beyond the bound, and of single flipped bits in formats that
carry a checksum no silent change. The suite runs a small share, ``benchmarks/fuzz_readers.py`` any number.
"""

from __future__ import annotations

import base64
import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.fuzzing.child import PROGRESS

REPOSITORY = Path(__file__).resolve().parents[2]
SECONDS = 20
ADDRESS_BYTES = 4 << 30
MOST_BYTES = 2 << 30
_MOST_PROBLEMS = 50

SERVED = {"hdf5": "scan", "project read here": "project"}
"""Readers that do here what mbstudio lets another process do, and those that ask it to."""

Case = tuple[dict[str, bytes], Sequence[str]]
"""Files that belong together, content by name, of which one is mutated; and which of them are opened."""


@dataclass
class Outcome:
    """What came of an attack.

    Attributes
    ----------
    inputs : int
        Mutated files (or sets of files).
    read, refused : int
        Openings that were read to the end, and that were refused by a named error.
    same : int
        Openings of files with a flipped bit that hold what was written: the bit said nothing.
    problems : list of str
        What went wrong, with the number of the input: the same seed and number make it again.
    """

    inputs: int = 0
    read: int = 0
    refused: int = 0
    same: int = 0
    problems: list[str] = field(default_factory=list)

    def add(self, other: Outcome) -> None:
        """Add what came of another attack."""
        self.inputs += other.inputs
        self.read += other.read
        self.refused += other.refused
        self.same += other.same
        self.problems += other.problems


def attack(
    reader: str,
    cases: Sequence[Case],
    count: int,
    folder: Path,
    *,
    seed: int = 1,
    first: int = 0,
    flips: bool = False,
    seconds: int = SECONDS,
) -> Outcome:
    """Open so many mutated files.

    Parameters
    ----------
    reader : str
        Name of one of :data:`tests.fuzzing.readers.READERS`.
    cases : sequence of Case
        Taken in turn.
    count : int
    folder : Path
        Where they are written.
    seed, first : int
        The input is made of the seed and its number, counted from `first`.
    flips : bool
        Flip one bit each and compare what is read, in place of mutations of every kind.
    seconds : int
        That one file may take of the processor; twelve times as long by the clock, on a busy machine.
    """
    folder.mkdir(parents=True, exist_ok=True)
    told = Outcome()
    at, last = first, first + count
    while at < last and len(told.problems) < _MOST_PROBLEMS:
        order = {
            "reader": reader,
            "folder": str(folder),
            "seed": seed,
            "first": at,
            "last": last,
            "flips": flips,
            "seconds": seconds,
            "address_bytes": ADDRESS_BYTES,
            "most_bytes": MOST_BYTES,
            "cases": [
                ({name: base64.b64encode(content).decode() for name, content in files.items()}, list(opened))
                for files, opened in cases
            ],
        }
        (folder / "progress").write_bytes(PROGRESS.pack(at, 0, 0, 0))
        child = _run(order)
        reached, read, refused, same = PROGRESS.unpack((folder / "progress").read_bytes())
        told.read, told.refused, told.same = told.read + read, told.refused + refused, told.same + same
        told.problems += [_words(reader, seed, json.loads(line)) for line in child.stdout.splitlines()]
        if child.returncode == -signal.SIGPROF and reader in SERVED:
            # A library loops. In mbstudio another process reads such files, and is ended: is it?
            again = attack(SERVED[reader], cases, 1, folder, seed=seed, first=reached, seconds=3 * seconds)
            told.read, told.refused = told.read + again.read, told.refused + again.refused
            told.problems += again.problems
            reached += 1
        elif child.returncode:
            how = f"the process ended with {child.returncode}: {child.stderr[-600:]}"
            told.problems.append(_words(reader, seed, {"turn": reached, "problem": how}))
            reached += 1
        told.inputs += reached - at
        at = reached
    return told


def _run(order: dict[str, Any]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tests.fuzzing.child"],
        input=json.dumps(order),
        capture_output=True,
        text=True,
        cwd=REPOSITORY,
        check=False,
    )


def _words(reader: str, seed: int, told: dict[str, Any]) -> str:
    where = f"{reader}, seed {seed}, input {told['turn']}"
    files = f", {told['file']} opened as {told['opened']}" if "file" in told else ""
    return f"{where}{files}: {told['problem']}"


def problems_of(
    folder: Path, cases: Sequence[Case], rounds: int, seed: int = 1, reader: str = "scan"
) -> list[str]:
    """Return what went wrong when each case was mutated and opened so often."""
    return attack(reader, cases, rounds * len(cases), folder / "fuzzing", seed=seed).problems


def cases_of_folder(folder: Path) -> list[Case]:
    """Return each file or folder in a folder as a case."""
    cases: list[Case] = []
    for entry in sorted(folder.iterdir()):
        files = sorted(path for path in entry.rglob("*") if path.is_file()) if entry.is_dir() else [entry]
        cases.append(({str(file.relative_to(folder)): file.read_bytes() for file in files}, [entry.name]))
    return cases
