"""Files of strangers: whatever they are made of, they harm nothing and bring nothing impossible in."""

from __future__ import annotations

import gzip
import subprocess
import sys
import threading
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from mbstudio.core import own_files
from mbstudio.core.errors import ProjectError
from mbstudio.core.project import ProjectState, stored_reading
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.sealing import seal_image
from tests.core.project.contents import describe


@pytest.fixture
def path(tmp_path, state):
    write_project(tmp_path / "sand.mbs", state)
    return tmp_path / "sand.mbs"


@pytest.fixture
def no_hdf5_here(monkeypatch):
    """Fail if HDF5 opens anything in this process."""
    monkeypatch.setattr("h5py.File", lambda *_, **__: pytest.fail("a stranger's file reached HDF5"))


def seal_as_a_stranger(path: Path) -> None:
    content = bytearray(path.read_bytes())
    seal_image(content)
    path.write_bytes(content)


def test_both_ways_find_the_same(path, state):
    before = describe(read_project(path))
    seal_as_a_stranger(path)
    assert describe(read_project(path)) == before
    assert describe(state) == before


def test_own_files_are_read_here_and_strangers_elsewhere(path, monkeypatch, request):
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("an own file went elsewhere"))
    read_project(path)
    monkeypatch.undo()
    request.getfixturevalue("no_hdf5_here")
    seal_as_a_stranger(path)
    read_project(path)


def test_a_mark_is_made_with_a_key_that_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(own_files, "user_config_path", lambda *_, **__: tmp_path)
    own_files._key.cache_clear()
    mark = own_files.mark_of("00" * 32)
    own_files._key.cache_clear()
    assert own_files.is_own("00" * 32, mark)
    assert not own_files.is_own("01" * 32, mark)
    (tmp_path / "seal.key").unlink()
    own_files._key.cache_clear()
    assert not own_files.is_own("00" * 32, mark)
    own_files._key.cache_clear()


def test_without_a_place_for_the_key_files_have_no_mark(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(own_files, "user_config_path", lambda *_, **__: tmp_path / "file")
    own_files._key.cache_clear()
    assert own_files.mark_of("00" * 32) == own_files.NO_MARK
    assert not own_files.is_own("00" * 32, own_files.NO_MARK)
    own_files._key.cache_clear()


# ------------------------------------------------------------------ what mbstudio never writes


def a_soft_link(file):
    file["fits/n2"] = h5py.SoftLink("/fits/n")


def a_link_to_another_file(file):
    file["fits/n2"] = h5py.ExternalLink("/etc/hostname", "/")


def another_name(file):
    file["fits/n2"] = file["fits/n"]


def a_ring_of_groups(file):
    file["fits/ring"] = file["fits"]


def data_in_another_file(file):
    file.create_dataset("fits/x", (10,), "u1", external=[("/etc/hostname", 0, 10)])


def a_virtual_dataset(file):
    layout = h5py.VirtualLayout((10,), "u1")
    layout[:] = h5py.VirtualSource("/etc/hostname", "x", (10,))
    file.create_virtual_dataset("fits/x", layout)


def a_filter_of_others(file):
    file.create_dataset("fits/x", data=np.zeros(100), chunks=(10,), compression="lzf")


def packed_twice(file):
    stored = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    stored.set_chunk((2**20,))
    stored.set_deflate(9)
    stored.set_deflate(9)
    space = h5py.h5s.create_simple((2**20,))
    made = h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_UINT8, space, stored)
    made.write(h5py.h5s.ALL, h5py.h5s.ALL, np.zeros(2**20, "u1"))


def a_claim_of_21_gigabytes(file):
    del file["grains/labels"]
    labels = file.create_dataset(
        "grains/labels", (2000, 2000, 1300), "i4", chunks=(1, 100, 100), compression="gzip"
    )
    labels.attrs.update(voxel_size_zyx=(1.0, 1, 1), unit="um", origin_xyz=(0.0, 0, 0))


def data_that_were_never_stored(file):
    file.create_dataset("fits/x", (1000,), "f8", chunks=(10,))


def a_reference(file):
    file.create_dataset("fits/x", data=np.array([file["fits"].ref], dtype=h5py.ref_dtype))


def a_record(file):
    file.create_dataset("fits/x", data=np.zeros(3, [("a", "i4"), ("b", "f8")]))


def lists_of_numbers(file):
    file.create_dataset("fits/x", (3,), dtype=h5py.vlen_dtype(np.int32))


def a_named_type(file):
    file["fits/x"] = np.dtype("f8")


def a_name_that_is_none(file):
    h5py.h5g.create(file.id, b"\xff\xfe")


def many_parts(file):
    for index in range(10_001):
        file.create_group(f"fits/g{index}")


def groups_in_groups(file):
    file.create_group("/".join("abcdefghijk"))


def a_long_attribute(file):
    file["fits"].attrs.create("x", np.zeros(5000), dtype="f8")
    for index in range(20):
        file["fits"].attrs.create(f"y{index}", np.zeros(4000), dtype="f8")


NEVER_WRITTEN = [
    (a_soft_link, "fits/n2 is a soft link"),
    (a_link_to_another_file, "fits/n2 is a link to another file"),
    (another_name, "is another name of something else"),
    (a_ring_of_groups, "is another name of something else"),
    (data_in_another_file, "keeps its data in another file"),
    (a_virtual_dataset, "is put together from other datasets"),
    (a_filter_of_others, "packed in a way that mbstudio never uses"),
    (packed_twice, "packed in a way that mbstudio never uses"),
    (a_claim_of_21_gigabytes, "claims to hold"),
    (data_that_were_never_stored, "does not hold all that it claims"),
    (a_reference, "holds neither numbers nor texts"),
    (a_record, "holds neither numbers nor texts"),
    (lists_of_numbers, "holds neither numbers nor texts"),
    (a_named_type, "is neither a group nor a dataset"),
    (a_name_that_is_none, "has an impossible name"),
    (many_parts, "more than 10000 parts"),
    (groups_in_groups, "more than 8 deep"),
]


@pytest.mark.parametrize(("make", "told"), NEVER_WRITTEN, ids=[make.__name__ for make, _ in NEVER_WRITTEN])
def test_what_mbstudio_never_writes_is_refused(path, edit_project, make, told):
    with edit_project(path) as file:
        make(file)
    with pytest.raises(ProjectError, match=rf"sand\.mbs is not an mbstudio project.*{told}"):
        read_project(path)


# ------------------------------------------------------------------ what no project can hold


def put(name, value):
    def change(file):
        file[name][...] = value

    change.__name__ = f"{name}={value}"
    return change


def put_attribute(group, name, value):
    def change(file):
        file[group].attrs[name] = value

    change.__name__ = f"{group}@{name}={value!r:.30}"
    return change


IMPOSSIBLE = [
    put("fits/centers", np.nan),
    put("fits/centers", np.inf),
    put("fits/weights", -1.0),
    put("fits/weights", 0.0),
    put("fits/n", 0),
    put("fits/pieces", -3),
    put("fits/label", 2),
    put("fits/method", "magic"),
    put("fits/unit", "parsec"),
    put("fits/options", "[1, 2]"),
    put("fits/options", "[" * 100_000),
    put("fits/reached", '{"iou": NaN}'),
    put("fits/centers_offsets", 0),
    put("fits/centers_offsets", np.array([0, 10**12, 8])),
    put("fits/history_offsets", np.array([0, 9, 3])),
    put("grains/labels", -1),
    put("grains/table/label", 7),
    put("grains/table/label", np.array([-1, 7])),
    put("grains/table/volume", np.nan),
    put("grains/table/volume", -5.0),
    put_attribute("grains/labels", "voxel_size_zyx", (1.0, 0.0, 1.0)),
    put_attribute("grains/labels", "voxel_size_zyx", (1.0, np.nan, 1.0)),
    put_attribute("grains/labels", "voxel_size_zyx", (1.0, 1.0)),
    put_attribute("grains/labels", "origin_xyz", (np.inf, 0.0, 0.0)),
    put_attribute("grains/labels", "unit", 3),
    put_attribute("grains/table", "columns", "label"),
    put_attribute("grains/table", "columns", ["label", "missing"]),
    put_attribute("fit_settings", "n", "abc"),
    put_attribute("fit_settings", "n", -1),
    put_attribute("fit_settings", "n", 2.5),
    put_attribute("fit_settings", "method", "magic"),
    put_attribute("fit_settings", "options", "[]"),
    put_attribute("/", "schema", "three"),
    put_attribute("/", "schema", -1),
]


@pytest.mark.parametrize("change", IMPOSSIBLE, ids=lambda change: change.__name__)
def test_what_no_project_can_hold_does_not_enter(path, edit_project, change, monkeypatch):
    # Read here: the other way finds the same, and takes longer to start.
    monkeypatch.setattr("mbstudio.core.project.file._is_own", lambda _: True)
    with edit_project(path) as file:
        change(file)
    with pytest.raises(ProjectError, match=r"sand\.mbs"):
        read_project(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fits/label", np.array([2.0, 7.0])),
        ("fits/n", np.array(["a", "b"], object)),
        ("fits/centers", np.zeros((8, 2))),
        ("fits/centers", np.zeros(24)),
        ("fits/weights", np.zeros(8, "i4")),
        ("fits/volume_error", np.zeros(3)),
        ("grains/labels", np.zeros((4, 5), "i4")),
        ("grains/labels", np.zeros((4, 5, 6), "f4")),
        ("grains/table/label", np.array([2.0, 7.0])),
        ("grains/table/voxels", np.array([8])),
    ],
)
def test_arrays_of_another_kind_or_shape_do_not_enter(path, edit_project, name, value, monkeypatch):
    monkeypatch.setattr("mbstudio.core.project.file._is_own", lambda _: True)
    with edit_project(path) as file:
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = value
        file[name].attrs.update(attributes)
    with pytest.raises(ProjectError, match=r"sand\.mbs"):
        read_project(path)


# ------------------------------------------------------------------ bounds


def test_more_than_there_is_memory_for_is_refused_before_it_is_taken(path, monkeypatch):
    monkeypatch.setattr(stored_reading, "free_memory", lambda: 100)
    with pytest.raises(ProjectError, match=r"this machine has 0\.0 GiB of memory left"):
        read_project(path)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="bounds and measures memory as Linux does")
def test_a_bomb_takes_no_memory(path, edit_project):
    """A chunk of 2 MB that inflates to twice what the process that reads it may take."""
    import resource

    packer = zlib.compressobj(9)
    begin = packer.compress(b"") + packer.flush(zlib.Z_FULL_FLUSH)
    more = packer.compress(bytes(2**24)) + packer.flush(zlib.Z_FULL_FLUSH)
    bomb = begin + 128 * more + packer.flush()
    with edit_project(path) as file:
        del file["fits/centers"]
        made = file.create_dataset("fits/centers", (1000, 3), "f8", chunks=(1000, 3), compression="gzip")
        made.id.write_direct_chunk((0, 0), bomb)
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    with pytest.raises(ProjectError, match=r"sand\.mbs is not an mbstudio project"):
        read_project(path)
    after = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    # In KiB. A new process counts the memory of the one that it was forked from; the bomb itself is 2 GiB.
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert after <= max(before, own, 1.25 * 2**20)


def stub_program(tmp_path: Path, monkeypatch, text: str) -> None:
    program = tmp_path / "program.py"
    program.write_text(text, encoding="utf-8")
    monkeypatch.setattr(stored_reading.hdf5_walk, "__file__", str(program))


def test_without_a_python_to_start_it_is_told(path, monkeypatch):
    seal_as_a_stranger(path)
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(ProjectError, match="reads such files safely cannot be started"):
        read_project(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("while True: pass", "came to no end within 0.2 s"),
        ("import os, signal; os.kill(os.getpid(), 11)", "ended the program that tried"),
        ("raise SystemExit(1)", "ended the program that tried"),
        ("import sys; sys.stdout.buffer.write(b'\\xff' * 100)", "its texts are too long"),
    ],
)
def test_a_program_that_loops_or_ends_is_a_message(tmp_path, path, monkeypatch, text, told):
    seal_as_a_stranger(path)
    stub_program(tmp_path, monkeypatch, text)
    monkeypatch.setattr(stored_reading, "SECONDS", 0.2)
    with pytest.raises(ProjectError, match=told):
        read_project(path)
    assert not [thread for thread in threading.enumerate() if thread.name == "Reading a project"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such bounds")
def test_the_program_may_write_no_file_and_take_no_memory(tmp_path):
    script = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import hdf5_walk, numpy; hdf5_walk._bound_this_process()\n"
        "for attempt in (lambda: numpy.ones(2**28), lambda: open(sys.argv[2], 'w').write('x' * 9999)):\n"
        "    try: attempt()\n"
        "    except (MemoryError, OSError) as error: print(type(error).__name__)\n"
    )
    folder = Path(stored_reading.__file__).parent
    run = subprocess.run(
        [sys.executable, "-P", "-c", script, folder, tmp_path / "x"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "MemoryError" in run.stdout
    assert not (tmp_path / "x").exists() or not (tmp_path / "x").stat().st_size


def test_an_empty_project_goes_both_ways(tmp_path):
    write_project(tmp_path / "empty.mbs", ProjectState())
    before = describe(read_project(tmp_path / "empty.mbs"))
    seal_as_a_stranger(tmp_path / "empty.mbs")
    assert describe(read_project(tmp_path / "empty.mbs")) == before


FORMATS = Path(__file__).with_name("formats")


@pytest.mark.timeout(6000)
@pytest.mark.filterwarnings("ignore::mbstudio.core.errors.ProjectWarning")
@pytest.mark.parametrize("mutations", [16, pytest.param(2_000, marks=pytest.mark.full)])
def test_mutated_files_of_strangers_are_read_or_refused(tmp_path, rng, no_hdf5_here, mutations, monkeypatch):
    """Bytes set at random, many of them among the structure: a project, or one named error, and no wait."""
    monkeypatch.setattr(stored_reading, "SECONDS", 5)
    path, names = tmp_path / "strange.mbs", ("format-1", "format-2", "format-4")
    wholes = [gzip.decompress((FORMATS / f"{name}.mbs.gz").read_bytes()) for name in names]
    outcomes = {"opened": 0, "refused": 0, "came to no end": 0, "ended the program": 0}
    for turn in range(mutations):
        content = bytearray(wholes[turn % len(wholes)])
        for place in rng.integers(512, len(content) if rng.random() < 0.5 else 4096, rng.integers(1, 4)):
            content[place] = rng.integers(256)
        if content.startswith(b"MetaBall"):
            seal_image(content)
        path.write_bytes(content)
        try:
            read_project(path)
            outcomes["opened"] += 1
        except ProjectError as error:
            told = next((words for words in outcomes if words in str(error)), "refused")
            outcomes[told] += 1
    print(outcomes)
    assert sum(outcomes.values()) == mutations
