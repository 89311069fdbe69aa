"""Opening damaged files in a process of their own, with little memory: nothing but refusals may come out.

``python -m tests.core.scan.readers.fuzzing FOLDER COUNT SEED`` damages each scan of a folder so many
times, and prints what was wrong as JSON. `damaged_files_are_refused` does the same from a test.
"""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np

MEMORY = 6 << 30
_WORDS = (
    b"0",
    b"-1",
    b"65535",
    b"2147483647",
    b"4294967296",
    b"99999999999",
    b"1e308",
    b"nan",
    b"null",
    b'""',
)
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF)


def damage(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a file's bytes with one to four things wrong."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        if not data:
            break
        # Headers are what matters: half of all damage is among the first bytes.
        reach = len(data) if rng.random() < 0.5 else min(len(data), 600)
        place = int(rng.integers(reach))
        match rng.integers(7):
            case 0:
                data[place] = rng.integers(256)
            case 1:
                data[place] ^= 1 << int(rng.integers(8))
            case 2:
                size = int(rng.choice([1, 2, 4, 8]))
                number = _NUMBERS[rng.integers(len(_NUMBERS))] & (256**size - 1)
                data[place : place + size] = number.to_bytes(size, str(rng.choice(["little", "big"])))
            case 3:
                del data[place:]
            case 4:
                end = place + int(rng.integers(1, 64))
                data[place:end] = b"" if rng.random() < 0.5 else data[place:end] * 2
            case 5:
                digits = [at for at in range(reach) if 48 <= data[at] <= 57]
                if digits:
                    start = end = digits[rng.integers(len(digits))]
                    while end < len(data) and 48 <= data[end] <= 57:
                        end += 1
                    data[start:end] = _WORDS[rng.integers(len(_WORDS))]
            case 6:
                data[place : place + 8] = rng.bytes(8)
    return bytes(data)


def attempt(path: Path) -> None:
    """Read all that a reader hands out; its own refusals alone are allowed."""
    from mbstudio.core.errors import MbstudioError
    from mbstudio.core.scan.opening import place
    from mbstudio.core.scan.readers import ReadOptions, family_of, split_dataset

    file, dataset = split_dataset(path)
    for numbers in (False, True):
        try:
            options = ReadOptions(numbers=numbers, dataset=dataset)
            reading = family_of(file, options).read(file, options)
            voxels = reading.voxels
            if np.prod([float(count) for count in voxels.shape]) < 1e8:
                np.asarray(voxels).sum()
            else:
                np.asarray(voxels[voxels.shape[0] // 2]).sum()
            place(reading, None, None, path)
        except MbstudioError as error:
            told = str(error)
            if not told.startswith(str(file.parent)) and str(file) not in told:
                raise AssertionError(f"the refusal does not name the file: {told}") from error


def _fuzz(folder: Path, count: int, seed: int) -> list[str]:
    rng = np.random.default_rng(seed)
    wrong: dict[str, str] = {}
    for source in sorted(folder.iterdir()):
        attempt(source)
        for turn in range(count):
            with tempfile.TemporaryDirectory() as place:
                copy = Path(place) / source.name
                (shutil.copytree if source.is_dir() else shutil.copy)(source, copy)
                files = sorted(one for one in copy.rglob("*") if one.is_file()) if copy.is_dir() else [copy]
                victim = files[rng.integers(len(files))]
                victim.write_bytes(damage(victim.read_bytes(), rng))
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("error")
                        attempt(copy)
                except Exception as error:
                    last = traceback.extract_tb(error.__traceback__)[-1]
                    key = f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}"
                    wrong.setdefault(key, f"{source.name} turn {turn}: {traceback.format_exc()}")
    return list(wrong.values())


def damaged_files_are_refused(folder: Path, count: int = 60, seed: int = 20) -> None:
    """Fail if any damaged copy of a folder's scans ends in anything but a refusal that names it."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.core.scan.readers.fuzzing", str(folder), str(count), str(seed)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[4],
    )
    assert run.returncode == 0, f"the process ended with {run.returncode}: {run.stderr[-2000:]}"
    assert json.loads(run.stdout) == []


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    print(json.dumps(_fuzz(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])), indent=1))
