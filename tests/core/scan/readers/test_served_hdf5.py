"""HDF5 scans are read by a process of their own: it may loop, end or lie, and this one goes on."""

from __future__ import annotations

import gc
import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from mbstudio.core.errors import ScanError
from mbstudio.core.scan import open_scan
from mbstudio.core.scan.readers.hdf5 import served_file, volume
from mbstudio.core.scan.readers.hdf5.served_file import ServedFile
from mbstudio.core.scan.readers.hdf5.server import Server, pieces


@pytest.fixture
def packed(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, np.ndarray]:
    voxels = rng.integers(0, 60_000, (9, 14, 11)).astype(np.uint16)
    with h5py.File(tmp_path / "s.h5", "w") as file:
        data = file.create_dataset("entry/data", data=voxels, compression="gzip", chunks=(2, 4, 5))
        data.attrs["element_size_um"] = (3.0, 2.0, 1.0)
    return tmp_path / "s.h5", voxels


def process_of(file: ServedFile) -> int:
    assert file._process is not None
    return file._process._program.pid


def is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("most", [1, 40, 300, 5000])
@pytest.mark.parametrize("chunks", [(2, 4, 5), (1, 1, 1), (9, 14, 11), (4, 20, 3)])
def test_pieces_cover_a_block_once_and_cut_no_chunk_twice(most: int, chunks: tuple[int, ...]) -> None:
    block = [(1, 9), (3, 13), (0, 11)]
    seen = np.zeros((9, 14, 11), int)
    for piece in pieces(block, chunks, 2, most):
        seen[tuple(slice(*ends) for ends in piece)] += 1
        for (begin, end), step, (first, last) in zip(piece, chunks, block, strict=True):
            assert begin in {first, *range(0, last, step)}
            assert end in {last, *range(0, last + step, step)}
    inside = seen[tuple(slice(*ends) for ends in block)]
    assert (inside == 1).all()
    assert seen.sum() == inside.size


def test_pieces_are_as_large_as_is_asked(packed: tuple[Path, np.ndarray]) -> None:
    sizes = [
        np.prod([end - begin for begin, end in piece])
        for piece in pieces([(0, 100), (0, 100), (0, 100)], (8, 8, 8), 2, 100_000)
    ]
    assert max(sizes) * 2 <= 130_000
    assert len(sizes) < 40


def test_a_volume_is_unpacked_piece_by_piece(
    packed: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, voxels = packed
    scan = open_scan(path)
    np.testing.assert_array_equal(np.asarray(scan.voxels), voxels)
    assert scan.voxel_size.to("um").zyx == pytest.approx((3, 2, 1))
    inner = Server(str(path))
    told = list(inner.answers({"do": "read", "name": "entry/data", "block": [[0, 9], [0, 14], [0, 11]]}))
    inner.close()
    assert told[-1][0] == {"end": True}
    assert sum(len(content) for _, content in told) == voxels.nbytes


def test_blocks_are_read_on_demand_and_the_program_goes_with_the_scan(
    packed: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, voxels = packed
    monkeypatch.setattr(volume, "UNPACK_AT_ONCE_BYTES", 0)
    begun: list[int] = []
    start = subprocess.Popen

    def noted(*words: object, **options: object) -> subprocess.Popen[bytes]:
        program = start(*words, **options)  # type: ignore[call-overload]
        begun.append(program.pid)
        return program  # type: ignore[no-any-return]

    monkeypatch.setattr(subprocess, "Popen", noted)
    scan = open_scan(path)
    np.testing.assert_array_equal(scan.voxels[3:6, 2:9, 1:], voxels[3:6, 2:9, 1:])
    np.testing.assert_array_equal(scan.voxels[8], voxels[8])
    assert len(begun) == 1
    # It ends when nobody asks for long, and the next block starts another.
    os.kill(begun[0], signal.SIGKILL)
    np.testing.assert_array_equal(scan.voxels[2:4], voxels[2:4])
    assert len(begun) == 2
    assert is_alive(begun[1])
    del scan
    gc.collect()
    assert not any(map(is_alive, begun))


def test_the_program_ends_when_nobody_asks(packed: tuple[Path, np.ndarray]) -> None:
    words = (
        "import sys; from mbstudio.core.scan.readers.hdf5 import server; server.IDLE_SECONDS = 0.2; "
        "sys.argv[1:] = ['x']; server.main()"
    )
    command = [sys.executable, "-c", words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as one:
        assert one.wait(100) == 0
        assert one.stdout is not None
        assert one.stdout.read() == b""


def bad_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    path = tmp_path / "bad.py"
    path.write_text(text)
    monkeypatch.setattr(served_file, "PROGRAM", path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("while True: pass", "no end within"),
        ("import os; os.kill(os.getpid(), 11)", "ended the program"),
        ("import sys; sys.stdin.readline(); sys.stdout.write('abc')", "ended the program"),
        ("import sys, time; sys.stdout.write('\\x7f' * 8); sys.stdout.flush(); time.sleep(9)", "too long"),
    ],
)  # fmt: skip
def test_a_program_that_loops_or_ends_is_one_message(
    packed: tuple[Path, np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, words: str
) -> None:
    bad_program(tmp_path, monkeypatch, text)
    if "no end" in words:
        monkeypatch.setattr(served_file, "SECONDS", 1)
    with pytest.raises(ScanError, match=words) as caught:
        open_scan(packed[0])
    assert str(packed[0]) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_program_that_is_stopped_while_it_reads_is_told(
    packed: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = packed
    file = ServedFile(path)
    array = file.find("entry/data")
    assert array is not None
    monkeypatch.setattr(served_file, "SECONDS", 1)
    os.kill(process_of(file), signal.SIGSTOP)
    begun = time.monotonic()
    with pytest.raises(ScanError, match="no end within 1 s"):
        file.read(array, (slice(0, 9), slice(0, 14), slice(0, 11)))
    assert time.monotonic() - begun < 60
    # The next question starts another program.
    monkeypatch.setattr(served_file, "SECONDS", 300)
    assert file.read(array, (slice(0, 1), slice(0, 14), slice(0, 11))).shape == (1, 14, 11)
    file.close()


def test_memory_of_the_program_is_bounded(tmp_path: Path) -> None:
    """A chunk that claims more than a file of this size can unpack to is not made room for."""
    path = tmp_path / "s.h5"
    with h5py.File(path, "w") as file:
        data = file.create_dataset(
            "data", (2, 2**15, 2**15), "u2", compression="gzip", chunks=(1, 2**15, 2**15), fillvalue=0
        )
        data.id.write_direct_chunk((0, 0, 0), b"x\x9c" + bytes(100))
    with pytest.raises(ScanError, match="cannot be read as HDF5"):
        open_scan(path, "1 um").voxels[0]


def test_links_that_lead_outside_are_not_followed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["group/data"] = np.zeros((3, 4, 5))
        file["z"] = np.arange(3.0)
    with h5py.File(tmp_path / "s.h5", "w") as file:
        file["away"] = h5py.ExternalLink("other.h5", "/group")
        file["entry/data"] = np.ones((3, 4, 5), np.uint8)
        file["entry"].attrs["axes"] = ["z", "y", "x"]
        for axis in "zyx":
            file[f"entry/{axis}"] = h5py.ExternalLink("other.h5", "/z")
    with pytest.raises(ScanError, match=r"in another file, .*other\.h5"):
        open_scan(f"{tmp_path}/s.h5:/away/data", "1 um")
    scan = open_scan(tmp_path / "s.h5", "2 um")
    assert np.asarray(scan.voxels).all()


def test_a_ring_of_groups_is_walked_once(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "s.h5", "w") as file:
        group = file.create_group("a/b")
        group["ring"], group["again"] = file["a"], h5py.SoftLink("/a")
        file["a/data"] = np.ones((3, 4, 5), np.uint8)
    assert open_scan(tmp_path / "s.h5", "1 um").shape == (3, 4, 5)


def test_threads_read_at_the_same_time(
    packed: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    from concurrent.futures import ThreadPoolExecutor

    path, voxels = packed
    monkeypatch.setattr(volume, "UNPACK_AT_ONCE_BYTES", 0)
    scan = open_scan(path)
    blocks = [
        (slice(z, z + 2), slice(y, y + 5), slice(0, 11)) for z, y in itertools.product(range(7), range(9))
    ]
    with ThreadPoolExecutor(4) as threads:
        for block, found in zip(blocks, threads.map(lambda one: scan.voxels[one], blocks), strict=True):
            np.testing.assert_array_equal(found, voxels[block])
