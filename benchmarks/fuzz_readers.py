"""Attacks every reader with mutated files, each in a process of bounded memory and time.

    python benchmarks/fuzz_readers.py --count 20000 --reader dicom
    python benchmarks/fuzz_readers.py --flips 5000

Without ``--reader`` all kinds of files are attacked in turn, those that carry a checksum with ``--flips``.
What is found is printed, with the number by which ``--first NUMBER --count 1`` makes the same input again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.fuzzing.harness import Outcome, attack
from tests.fuzzing.seeds import CHECKSUMMED, SEEDS


def attack_kind(kind: str, count: int, seed: int, first: int, flips: bool) -> Outcome:
    """Attack the reader of one kind of file."""
    reader, make = SEEDS[kind]
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "whole"
        whole.mkdir()
        cases = make(whole)
        return attack(reader, cases, count, Path(folder) / "mutated", seed=seed, first=first, flips=flips)


def main() -> None:
    """Run what the command line asks for; the exit status is 1 if anything was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--reader", choices=sorted(SEEDS), action="append", help="kinds of files; repeat for more"
    )
    parser.add_argument("--count", type=int, default=20_000, help="mutated files of each kind")
    parser.add_argument("--flips", type=int, default=0, help="flip so many single bits instead, and compare")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    asked = parser.parse_args()
    print("| Kind | Inputs | Read | Refused | Unchanged | Problems | Time |")
    print("|---|---|---|---|---|---|---|", flush=True)
    found: list[str] = []
    for kind in asked.reader or (CHECKSUMMED if asked.flips else SEEDS):
        began = time.monotonic()
        told = attack_kind(kind, asked.flips or asked.count, asked.seed, asked.first, bool(asked.flips))
        took = time.monotonic() - began
        print(
            f"| {kind} | {told.inputs:,} | {told.read:,} | {told.refused:,} | {told.same:,} "
            f"| {len(told.problems)} | {took:.0f} s |",
            flush=True,
        )
        found += told.problems
        for problem in told.problems:
            print(problem, file=sys.stderr, flush=True)
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
