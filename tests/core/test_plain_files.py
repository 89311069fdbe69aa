"""Small files of others: bounded, and refused by one kind of error."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.plain_files import PlainFileError, parse_json, read_json, read_npz, read_plain_text


def test_what_was_written_is_read(tmp_path: Path) -> None:
    arrays = {
        "a": np.arange(12.0).reshape(3, 4),
        "b": np.array(["x", "µ"]),
        "c": np.asfortranarray(np.eye(3)),
    }
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    again = read_npz(tmp_path / "a.npz")
    assert again.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(again[name], array)
    (tmp_path / "a.json").write_text('{"a": [1, 2.5, "µ", null, true]}', encoding="utf-8")
    assert read_json(tmp_path / "a.json") == {"a": [1, 2.5, "µ", None, True]}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{", "Expecting"),
        ('{"a": NaN}', "the number NaN"),
        ("[-Infinity]", "the number -Infinity"),
        ("[1e999]", "the number 1e999"),
        ("[" * 100_000, "nested too deeply"),
        ("[" * 200 + "]" * 200, "nested too deeply"),
        ("[" + "9" * 5000 + "]", "digits"),
        ("", "Expecting"),
    ],
)
def test_json_that_cannot_be(text: str, told: str) -> None:
    with pytest.raises(PlainFileError, match=told) as caught:
        parse_json(text)
    assert "\n" not in str(caught.value)


def test_arrays_that_claim_more_than_there_is(tmp_path: Path) -> None:
    for shape, content, told in (
        ((10**9,), bytes(1000), "cut off"),
        ((10,), bytes(81), "81 bytes and should have 80"),
    ):
        stream = io.BytesIO()
        np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            archive.writestr("a.npy", stream.getvalue() + content)
        with pytest.raises(PlainFileError, match=told):
            read_npz(tmp_path / "a.npz")
    for header in (
        b"{'descr': '<f8', 'shape': (1",
        b"[" * 100,
        b"\0",
        b"{1: 2}",
        b"{'descr': 'O', 'shape': (), ",
    ):
        head = b"\x93NUMPY\x01\0" + len(header).to_bytes(2, "little") + header
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            archive.writestr("a.npy", head + bytes(8))
        with pytest.raises(PlainFileError) as caught:
            read_npz(tmp_path / "a.npz")
        assert "\n" not in str(caught.value)
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(10**7))
    with pytest.raises(PlainFileError, match="unpack to more than 50 MiB"):
        read_npz(tmp_path / "a.npz", 50 << 20)
    np.savez(tmp_path / "a.npz", a=np.array([{}], dtype=object))
    with pytest.raises(PlainFileError, match="objects"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.json")
    for read in (read_json, read_npz, read_plain_text):
        with pytest.raises(PlainFileError, match="no regular file"):
            read(tmp_path / "a.json")


def test_files_that_are_too_long_or_no_text(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"\xff" * 3000)
    with pytest.raises(PlainFileError, match="no text"):
        read_plain_text(tmp_path / "a.txt")
    with pytest.raises(PlainFileError, match="it is 0 MiB long"):
        read_plain_text(tmp_path / "a.txt", 1000)
    with pytest.raises(PlainFileError, match="No such file"):
        read_plain_text(tmp_path / "none.txt")
