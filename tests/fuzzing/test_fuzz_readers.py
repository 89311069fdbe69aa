"""A small seeded share of ``benchmarks/fuzz_readers.py``; ``--full`` runs more."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from tests.fuzzing.harness import attack
from tests.fuzzing.mutation import mutate
from tests.fuzzing.seeds import CHECKSUMMED, SEEDS

pytestmark = pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
# Readers of scans have tests of their own.
HERE = ("recipes", "latents", "sweeps", "serializations", "avatars", "styles", "unsealed-styles", "journals",
        "projects", "autosaves", "meshes")  # fmt: skip


def outcome(kind: str, folder: Path, count: int, *, flips: bool = False):
    reader, make = SEEDS[kind]
    (folder / "whole").mkdir()
    return attack(reader, make(folder / "whole"), count, folder / "mutated", flips=flips)


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", HERE)
def test_mutated_files_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    told = outcome(kind, tmp_path, 40)
    assert told.problems == []
    assert told.inputs == 40
    assert told.refused > 0


@pytest.mark.full
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("kind", sorted(SEEDS))
def test_many_mutated_files_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    assert outcome(kind, tmp_path, 300 if kind == "old-projects" else 2000).problems == []


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", CHECKSUMMED)
def test_no_flipped_bit_is_read_as_something_else(kind: str, tmp_path: Path) -> None:
    told = outcome(kind, tmp_path, 80, flips=True)
    assert told.problems == []
    assert (told.inputs, told.read) == (80, told.same)
    assert told.refused > 60


def test_the_harness_finds_what_is_wrong(tmp_path: Path) -> None:
    """A crash, a wait, another exception, much memory and a silent change are told, and the rest goes on."""
    wanted = {
        "crash": "ended with -11",
        "raise": "ZeroDivisionError",
        "lines": "several lines",
        "nameless": "does not name the file",
        "memory": "MiB of memory",
        "wait": "ended with -",
    }
    cases = [({f"{how}.txt": b"whole"}, [f"{how}.txt"]) for how in wanted]
    found = attack("bad", cases, len(cases), tmp_path / "all", seconds=12)
    assert found.inputs == len(found.problems) == len(cases)
    for told in wanted.values():
        assert any(told in problem for problem in found.problems), found.problems
    found = attack("bad", [({"s.txt": b"silent"}, ["s.txt"])], 3, tmp_path / "silent", flips=True)
    assert len(found.problems) == 3
    assert "read as something else" in found.problems[0]


def test_mutations_are_those_of_their_seed() -> None:
    content = b'{"name": "sand", "sizes": [1, 2, 3], "spacing": 0.5}'
    made = [mutate(content, np.random.default_rng([1, turn])) for turn in range(50)]
    assert made == [mutate(content, np.random.default_rng([1, turn])) for turn in range(50)]
    assert len(set(made)) > 45
    assert made.count(content) < 5
