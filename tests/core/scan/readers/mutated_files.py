"""Opens mutated files in a child process of bounded memory and time, and returns what went wrong.

Run as a script, it is that child: it reads what to do from standard input, as JSON.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

# A file may take so many seconds of the processor, and of the clock where it waits: a busy machine is slow.
SECONDS, SECONDS_OF_WAITING = 20, 240
BYTES = 4 << 30
REPOSITORY = Path(__file__).resolve().parents[4]
# What is put into files beside random bytes: numbers at the edge, and signs that formats use.
WORDS = (
    b"0", b"-1", b"99999999999999999999", b"1e999", b"nan", b"\xff\xff\xff\xff", b"\0\0\0\0",
    b"\x7f\xff\xff\xff", b"%s", b"%n%n", b"../", b"/etc/passwd", b"=", b"{", b"}", b"@1", b"\n", b" ", b"[",
    b"]", b"\xc2\xb5", b"1" * 400, b"\x80\0\0\0\0\0\0\0", b"LIST", b"LOCAL", b"4294967295", b"-", b"\0",
)  # fmt: skip


def problems_of(
    folder: Path, cases: Sequence[tuple[dict[str, bytes], Sequence[str]]], rounds: int, seed: int = 1
) -> list[str]:
    """Return what went wrong when files were mutated and opened.

    Parameters
    ----------
    folder : Path
        Where they are written.
    cases : sequence of (dict, sequence of str)
        Files that belong together, content by name, of which one is mutated each time; and which of
        them are opened.
    rounds : int
        How often, for each case.
    seed : int

    Every mutated file must be read, or refused with a named error of one line; no other exception, no lack
    of memory, no crash and no wait.
    """
    order = {
        "folder": str(folder),
        "rounds": rounds,
        "seed": seed,
        "cases": [
            ({name: base64.b64encode(content).decode() for name, content in files.items()}, list(opened))
            for files, opened in cases
        ],
    }
    child = subprocess.run(
        [sys.executable, __file__],
        input=json.dumps(order),
        capture_output=True,
        text=True,
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        check=False,
    )
    if child.returncode:
        return [f"the child ended with {child.returncode}: {child.stdout[-500:]}{child.stderr[-1500:]}"]
    return list(json.loads(child.stdout.splitlines()[-1]))


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Return content with some bits, bytes, words, lines or ends changed."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        if not data:
            return bytes(data)
        # Headers are where things go wrong: half of the changes are in the first 600 bytes.
        place = int(rng.integers(len(data) if rng.random() < 0.5 else min(len(data), 600)))
        kind = int(rng.integers(7))
        if kind == 0:
            data[place] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data[place] = int(rng.integers(256))
        elif kind == 2:
            del data[place : place + int(rng.integers(1, 40))]
        elif kind == 3:
            data[place:place] = WORDS[int(rng.integers(len(WORDS)))]
        elif kind == 4:
            word = WORDS[int(rng.integers(len(WORDS)))]
            data[place : place + len(word)] = word
        elif kind == 5:
            del data[place:]
        else:
            other = int(rng.integers(len(data)))
            data[place:place] = data[other : other + int(rng.integers(1, 60))]
    return bytes(data)


def _open(path: Path, numbers: bool) -> None:
    from mbstudio.core.scan.opening import place
    from mbstudio.core.scan.readers import ReadOptions, family_of

    options = ReadOptions(numbers=numbers)
    reading = family_of(path, options).read(path, options)
    np.asarray(reading.voxels)
    place(reading, None, None, path)


def _child() -> None:
    import resource
    import warnings

    order: dict[str, Any] = json.load(sys.stdin)
    with contextlib.suppress(OSError, ValueError):  # macOS refuses it
        resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    warnings.simplefilter("ignore")
    rng = np.random.default_rng(order["seed"])
    found: list[str] = []
    for number, (texts, opened) in enumerate(order["cases"]):
        folder = Path(order["folder"]) / f"case-{number}"
        folder.mkdir()
        files = {name: base64.b64decode(text) for name, text in texts.items()}
        for _ in range(order["rounds"]):
            _try_once(folder, files, opened, rng, found)
    print(json.dumps(found[:20]))


def _try_once(
    folder: Path, files: dict[str, bytes], opened: list[str], rng: np.random.Generator, found: list[str]
) -> None:
    """Mutate one of the files, open them, and add what went wrong."""
    from mbstudio.core.errors import MbstudioError

    names = sorted(files)
    chosen = names[int(rng.integers(len(names)))]
    content = mutated(files[chosen], rng)
    for name in names:
        (folder / name).write_bytes(content if name == chosen else files[name])
    for name in opened:
        # What these send ends this process.
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        signal.alarm(SECONDS_OF_WAITING)
        try:
            _open(folder / name, bool(rng.integers(2)))
        except MbstudioError as error:
            if "\n" in str(error):
                found.append(f"{chosen}: a message of several lines: {error}")
        except BaseException:
            kept = folder / f"problem-{len(found)}"
            kept.write_bytes(content)
            found.append(f"{chosen} (kept as {kept}), opening {name}: {traceback.format_exc()[-900:]}")
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.alarm(0)


if __name__ == "__main__":
    _child()
