"""Project files that are not what was written: told before anything of them is read."""

from __future__ import annotations

import pytest

from mbstudio.core.errors import DamagedProjectError, MbstudioError, ProjectError, ProjectWarning
from mbstudio.core.project import Project
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.sealing import HEADER_BYTES


@pytest.fixture
def path(tmp_path, state):
    write_project(tmp_path / "sand.mbs", state)
    return tmp_path / "sand.mbs"


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("flips", [500, pytest.param(5_000, marks=pytest.mark.full)])
def test_every_flipped_bit_is_told(path, rng, monkeypatch, flips):
    monkeypatch.setattr("h5py.File", lambda *_, **__: pytest.fail("a damaged file reached HDF5"))
    whole = path.read_bytes()
    places = [*rng.integers(0, 8 * len(whole), flips), *rng.integers(0, 8 * HEADER_BYTES, flips // 5)]
    told = 0
    for bit in map(int, places):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        try:
            read_project(path)
        except DamagedProjectError:
            told += 1
    assert told == len(places)


@pytest.mark.parametrize(
    "change", [lambda b: b[:-1], lambda b: b[:700], lambda b: b + b"\0", lambda b: b + b]
)
def test_a_file_of_another_length_is_told(path, change):
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(DamagedProjectError, match="and was written with"):
        read_project(path)


def test_the_message_says_since_when_and_what_to_do(path):
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(
        DamagedProjectError,
        match=r"was whole when mbstudio [\d.]+ saved it at 20.*nothing of it was read.*backup",
    ):
        Project.open(path)


def test_a_file_without_a_seal_says_so_and_is_sealed_by_the_next_save(path, state):
    path.write_bytes(path.read_bytes()[HEADER_BYTES:])  # HDF5 finds its data wherever they begin
    with pytest.warns(ProjectWarning, match="did not seal its files"):
        project = Project.open(path)
    assert len(project.fits) == len(state.fits)
    project.save()
    Project.open(path)


def test_another_programs_header_is_no_seal(path):
    content = bytearray(path.read_bytes())
    content[:HEADER_BYTES] = bytes(HEADER_BYTES)
    path.write_bytes(content)
    with pytest.raises(DamagedProjectError, match="first 512 bytes"):
        read_project(path)


def test_whatever_is_read_afterwards_is_what_was_compared(path, state, monkeypatch):
    """Another file that takes the place of the one that was compared is not looked at."""
    import mbstudio.core.project.sealed_file as sealed_file

    compare = sealed_file.check_seal

    def compare_and_replace(stream, seal):
        compare(stream, seal)
        path.unlink()
        path.write_bytes(b"something else")

    monkeypatch.setattr(sealed_file, "check_seal", compare_and_replace)
    assert len(read_project(path).fits) == len(state.fits)


def test_a_damaged_file_is_an_error_of_mbstudio():
    assert issubclass(DamagedProjectError, ProjectError)
    assert issubclass(DamagedProjectError, MbstudioError)
