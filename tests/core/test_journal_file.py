"""Journals: what was appended whole is there; what was being written is dropped; damage is told."""

from __future__ import annotations

import errno
import os

import pytest

from mbstudio.core import journal_file
from mbstudio.core.errors import JournalError
from mbstudio.core.journal_file import JournalWriter, read_journal


@pytest.fixture
def path(tmp_path):
    return tmp_path / "sand.mbs.journal"


def write(path, contents, header=b"of sand"):
    writer = JournalWriter.create(path, header)
    for content in contents:
        writer.append(content)
    writer.sync()
    writer.close()


def contents(path):
    found = read_journal(path)
    return [record.content for record in found.records], found.damaged


RECORDS = [b"one", b"", b"three " * 100, b"\xa7rec", b"\0" * 64]


def test_what_was_appended_comes_back(path):
    write(path, RECORDS)
    assert contents(path) == (RECORDS, 0)
    assert read_journal(path).header == b"of sand"
    assert len({record.digest for record in read_journal(path).records}) == len(RECORDS)


def test_it_can_begin_with_records(path):
    writer = JournalWriter.create(path, b"of sand", RECORDS[:2])
    for content in RECORDS[2:]:
        writer.append(content)
    writer.close()
    assert contents(path) == (RECORDS, 0)


def test_no_journal_is_none(path):
    assert read_journal(path) is None


def test_wherever_a_writer_ended_the_whole_records_are_there_and_nothing_is_told(path):
    write(path, RECORDS)
    whole = path.read_bytes()
    ends = []
    for count in range(len(RECORDS) + 1):
        write(path, RECORDS[:count])
        ends.append(path.stat().st_size)
    # The header's own bytes do not depend on when it was written: the ends are those of the whole file.
    assert ends[-1] == len(whole)
    for cut in range(ends[0], len(whole) + 1):
        path.write_bytes(whole[:cut])
        count = sum(end <= cut for end in ends) - 1
        assert contents(path) == (RECORDS[:count], 0), cut
    for cut in range(ends[0]):
        path.write_bytes(whole[:cut])
        with pytest.raises(JournalError, match="no journal"):
            read_journal(path)


def test_room_without_contents_behind_the_end_is_no_damage(path):
    write(path, RECORDS[:4])
    path.write_bytes(path.read_bytes() + b"\0" * 4096)
    assert contents(path) == (RECORDS[:4], 0)


@pytest.mark.parametrize("flips", [400, pytest.param(5_000, marks=pytest.mark.full)])
def test_a_flipped_bit_costs_its_record_and_is_told(path, rng, flips):
    write(path, RECORDS)
    whole = path.read_bytes()
    first = len(whole) - sum(52 + len(record) for record in RECORDS)
    for bit in rng.integers(8 * len(whole), size=flips).tolist():
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        if bit // 8 < first:
            with pytest.raises(JournalError, match="damaged"):
                read_journal(path)
            continue
        found, damaged = contents(path)
        assert damaged == 1
        assert len(found) == len(RECORDS) - 1
        assert [record for record in RECORDS if record in found] == found


def test_records_of_another_journal_and_moved_ones_do_not_count(path, tmp_path):
    write(path, RECORDS[:1])
    begun = path.read_bytes()
    write(tmp_path / "other", RECORDS[:2], b"of gravel")
    other = (tmp_path / "other").read_bytes()
    path.write_bytes(begun + other[-52 - len(RECORDS[1]) :])
    assert contents(path) == (RECORDS[:1], 1)
    path.write_bytes(begun + begun[-52 - len(RECORDS[0]) :])
    assert contents(path) == (RECORDS[:1], 0), "a copy says nothing new"


def test_a_record_that_was_cut_out_is_told(path):
    write(path, RECORDS)
    whole = path.read_bytes()
    start = len(whole) - sum(52 + len(record) for record in RECORDS)
    path.write_bytes(whole[:start] + whole[start + 52 + len(RECORDS[0]) :])
    assert contents(path) == (RECORDS[1:], 1)


def test_a_journal_of_a_stranger_is_bounded(path, monkeypatch):
    with pytest.raises(JournalError, match="too long"):
        JournalWriter.create(path, b"x", [b"x" * (journal_file.MOST_BYTES + 1)])
    assert not path.exists()
    write(path, [])
    # Marks without end, each of which could be one: they are given up on, not tried for ever.
    monkeypatch.setattr(journal_file, "_MOST_CANDIDATES", 100)
    path.write_bytes(path.read_bytes() + b"x" + b"\xa7rec" * 100_000)
    assert contents(path) == ([], 1)
    monkeypatch.setattr(journal_file, "MOST_IN_FILE", 1000)
    with pytest.raises(JournalError, match="no journal"):
        read_journal(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
def test_a_pipe_is_not_waited_for(path):
    os.mkfifo(path)
    with pytest.raises(JournalError, match="no journal"):
        read_journal(path)


def test_what_does_not_fit_on_the_disk_leaves_nothing_half(path):
    writer = JournalWriter.create(path, b"of sand")
    writer.append(RECORDS[0])

    class Full:
        def __init__(self, stream):
            self.stream = stream

        def write(self, data):
            if len(data) < 100:
                raise OSError(errno.ENOSPC, "No space left on device")
            return self.stream.write(data[: len(data) // 2])

        def __getattr__(self, name):
            return getattr(self.stream, name)

    stream, writer._stream = writer._stream, Full(writer._stream)
    with pytest.raises(OSError, match="No space"):
        writer.append(RECORDS[2])
    assert contents(path) == (RECORDS[:1], 0)
    writer._stream = stream
    writer.append(RECORDS[1])
    writer.close()
    assert contents(path) == (RECORDS[:2], 0)
