"""OME-Zarr and plain Zarr as zarr writes them: the array that is meant, its place, and what is refused."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numcodecs
import numpy as np
import pytest
import zarr
from zarr import codecs

from mbstudio.core.errors import GrainWarning, ScanError, ScanWarning, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project
from mbstudio.core.scan import Scan, open_scan
from mbstudio.core.scan.readers.ome_zarr import reading
from tests.fuzzing.harness import cases_of_folder, problems_of

Transformation = dict[str, Any]


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(1, 60_000, (9, 7, 11)).astype(np.uint16)


def scaled(*edges: float) -> Transformation:
    return {"type": "scale", "scale": list(edges)}


def moved(*places: float) -> Transformation:
    return {"type": "translation", "translation": list(places)}


def axes(names: str = "zyx", unit: str | None = "micrometer") -> list[dict[str, str]]:
    kinds = {"t": "time", "c": "channel"}
    return [
        {"name": name, "type": kinds.get(name, "space")}
        | ({"unit": unit} if unit and name not in kinds else {})
        for name in names
    ]


def describe(group: zarr.Group, image: dict[str, Any], **beside: Any) -> None:
    """Write what NGFF 0.4 keeps in .zattrs, or 0.5 under the name ome."""
    if group.metadata.zarr_format == 2:
        group.attrs.update({"multiscales": [{"version": "0.4", **image}], **beside})
    else:
        group.attrs["ome"] = {"version": "0.5", "multiscales": [image], **beside}


def write_image(
    path: Path,
    volume: np.ndarray,
    number: int = 3,
    names: str = "zyx",
    unit: str | None = "micrometer",
    place: list[Transformation] | None = None,
    whole: list[Transformation] | None = None,
    levels: int = 1,
    **options: Any,
) -> zarr.Group:
    group = zarr.open_group(path, mode="a", zarr_format=number)  # type: ignore[arg-type]
    datasets = []
    for level in range(levels):
        data = volume[..., :: 2**level, :: 2**level, :: 2**level]
        group.create_array(
            str(level), data=data, **({"chunks": tuple(min(4, n) for n in data.shape)} | options)
        )
        edges = [1.0] * (len(names) - 3) + [20.0 * 2**level, 15.0 * 2**level, 14.0 * 2**level]
        datasets.append({"path": str(level), "coordinateTransformations": place or [scaled(*edges)]})
    image: dict[str, Any] = {"axes": axes(names, unit), "datasets": datasets}
    if whole:
        image["coordinateTransformations"] = whole
    describe(group, image)
    return group


def assert_same(scan: Scan, volume: np.ndarray) -> None:
    assert scan.shape == volume.shape
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)
    np.testing.assert_array_equal(scan.voxels[2], volume[2])


# What zarr writes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [2, 3])
def test_an_image(tmp_path: Path, volume: np.ndarray, number: int) -> None:
    write_image(tmp_path / "s.ome.zarr", volume, number)
    scan = open_scan(tmp_path / "s.ome.zarr")
    assert_same(scan, volume)
    assert (scan.voxel_size.zyx, scan.unit) == ((20, 15, 14), "um")


@pytest.mark.parametrize("number", [2, 3])
def test_the_finest_level_is_taken_and_said(tmp_path: Path, volume: np.ndarray, number: int) -> None:
    group = write_image(tmp_path / "s.zarr", volume, number, levels=3)
    facts = dict(group.attrs)
    holder = facts if number == 2 else facts["ome"]
    holder["multiscales"][0]["datasets"].reverse()  # whatever their order
    group.attrs.update(facts)
    with pytest.warns(ScanWarning, match=r"holds 3 sizes of the image; the finest, 0 \(9 x 7 x 11\)"):
        scan = open_scan(tmp_path / "s.zarr")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == (20, 15, 14)
    coarse = open_scan(f"{tmp_path}/s.zarr:1")
    assert_same(coarse, volume[::2, ::2, ::2])
    assert coarse.voxel_size.zyx == (40, 30, 28)
    assert open_scan(tmp_path / "s.zarr" / "1").voxel_size.zyx == (40, 30, 28)


PACKED_2 = {
    "nothing": None, "blosc": numcodecs.Blosc("zstd", 3, 2), "zlib": numcodecs.Zlib(),
    "gzip": numcodecs.GZip(), "bz2": numcodecs.BZ2(), "lzma": numcodecs.LZMA(), "zstd": numcodecs.Zstd(),
    "lz4": numcodecs.LZ4(),
}  # fmt: skip
PACKED_3 = {
    "nothing": (), "zstd": (codecs.ZstdCodec(),), "gzip": (codecs.GzipCodec(),),
    "blosc": (codecs.BloscCodec(),),
    "checked": (codecs.ZstdCodec(), codecs.Crc32cCodec()), "checksum alone": (codecs.Crc32cCodec(),),
}  # fmt: skip


@pytest.mark.parametrize("packed", PACKED_2)
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", [">u2", "<f4", "u1"])
def test_format_2(tmp_path: Path, volume: np.ndarray, packed: str, order: Any, kind: str) -> None:
    data = (volume % 250).astype(kind)
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=data.shape, dtype=kind, chunks=(4, 3, 5), order=order, zarr_format=2,
        compressors=PACKED_2[packed],
    )  # fmt: skip
    array[...] = data
    assert_same(open_scan(tmp_path / "a.zarr", "10 um"), data)


@pytest.mark.parametrize("packed", PACKED_3)
@pytest.mark.parametrize("shards", [None, (8, 6, 10)])
@pytest.mark.parametrize("kind", ["u2", "i4", "f4"])
def test_format_3(
    tmp_path: Path, volume: np.ndarray, packed: str, shards: Any, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = volume.astype(kind)
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=data.shape, dtype=kind, chunks=(4, 3, 5), shards=shards, zarr_format=3,
        compressors=PACKED_3[packed],
    )  # fmt: skip
    array[...] = data
    assert_same(open_scan(tmp_path / "a.zarr", "10 um"), data)
    monkeypatch.setattr(reading, "UNPACK_AT_ONCE_BYTES", 0)
    lazy = open_scan(tmp_path / "a.zarr", "10 um")
    assert not isinstance(lazy.voxels, np.ndarray)
    assert_same(lazy, data)


def test_turned_and_big_endian_chunks(tmp_path: Path, volume: np.ndarray) -> None:
    for order in ((2, 0, 1), (1, 2, 0)):
        path = tmp_path / f"{order[0]}.zarr"
        array = zarr.create_array(
            path, shape=volume.shape, dtype="u2", chunks=(4, 3, 5),
            filters=(codecs.TransposeCodec(order=order),),
            serializer=codecs.BytesCodec(endian="big"), compressors=(codecs.GzipCodec(),),
        )  # fmt: skip
        array[...] = volume
        assert_same(open_scan(path, "10 um"), volume)


def test_chunks_in_folders_of_their_own(tmp_path: Path, volume: np.ndarray) -> None:
    """As NGFF 0.4 wants them on Zarr 2."""
    write_image(tmp_path / "s.zarr", volume, 2, chunk_key_encoding={"name": "v2", "separator": "/"})
    assert (tmp_path / "s.zarr" / "0" / "0" / "1" / "2").is_file()
    assert_same(open_scan(tmp_path / "s.zarr"), volume)
    write_image(tmp_path / "t.zarr", volume, 3, chunk_key_encoding={"name": "default", "separator": "."})
    assert (tmp_path / "t.zarr" / "0" / "c.0.1.2").is_file()
    assert_same(open_scan(tmp_path / "t.zarr"), volume)


def test_truth_values_and_half_precision(tmp_path: Path, volume: np.ndarray) -> None:
    for number in (2, 3):
        for name, data in (("mask", volume > 30_000), ("half", (volume % 100).astype(np.float16))):
            path = tmp_path / f"{name}{number}.zarr"
            array = zarr.create_array(path, shape=data.shape, dtype=data.dtype, zarr_format=number)  # type: ignore[arg-type]
            array[...] = data
            scan = open_scan(path, "10 um")
            assert_same(scan, data)
            assert scan.voxels.dtype == {"mask": np.uint8, "half": np.float32}[name]


def test_an_archive(tmp_path: Path, volume: np.ndarray) -> None:
    write_image(tmp_path / "s.zarr", volume)
    for packing in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        for top in ("", "s.zarr/"):
            with zipfile.ZipFile(tmp_path / "s.zarr.zip", "w", packing) as archive:
                for file in (tmp_path / "s.zarr").rglob("*"):
                    archive.write(file, top + file.relative_to(tmp_path / "s.zarr").as_posix())
            scan = open_scan(tmp_path / "s.zarr.zip")
            assert_same(scan, volume)
            assert scan.voxel_size.zyx == (20, 15, 14)
            assert_same(open_scan(f"{tmp_path}/s.zarr.zip:0"), volume)


def test_a_document_stands_for_its_folder(tmp_path: Path, volume: np.ndarray) -> None:
    write_image(tmp_path / "s.zarr", volume)
    assert_same(open_scan(tmp_path / "s.zarr" / "zarr.json"), volume)
    shutil.copytree(tmp_path / "s.zarr", tmp_path / "no ending")
    assert_same(open_scan(tmp_path / "no ending"), volume)
    assert_same(open_scan(f"{tmp_path}/no ending:0"), volume)


# Which array, and its axes ------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [2, 3])
def test_channels_and_times(tmp_path: Path, volume: np.ndarray, number: int) -> None:
    write_image(tmp_path / "one.zarr", volume[None, None], number, "tczyx")
    scan = open_scan(tmp_path / "one.zarr")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == (20, 15, 14)
    write_image(tmp_path / "two.zarr", np.stack([volume, volume + 1])[None], number, "tczyx")
    with pytest.raises(ScanError, match=r"more than one volume \(c=2\).*'two\.zarr:0,c=0'"):
        open_scan(tmp_path / "two.zarr")
    assert_same(open_scan(f"{tmp_path}/two.zarr:c=1"), volume + 1)
    assert_same(open_scan(f"{tmp_path}/two.zarr:0,c=0"), volume)
    with pytest.raises(ScanError, match="no c=2: its axis c has places 0 to 1"):
        open_scan(f"{tmp_path}/two.zarr:c=2")
    with pytest.raises(ScanError, match="no axis 'q'"):
        open_scan(f"{tmp_path}/two.zarr:q=0")


@pytest.mark.parametrize("names", ["xyz", "yxz", "zxy"])
def test_axes_in_another_order(tmp_path: Path, volume: np.ndarray, names: str) -> None:
    group = zarr.open_group(tmp_path / "s.zarr", mode="w")
    group.create_array("0", data=volume.transpose(["zyx".index(name) for name in names]), chunks=(4, 4, 4))
    edges = {"z": 20.0, "y": 15.0, "x": 14.0}
    image = {"path": "0", "coordinateTransformations": [scaled(*(edges[name] for name in names))]}
    describe(group, {"axes": axes(names), "datasets": [image]})
    scan = open_scan(tmp_path / "s.zarr")
    assert_same(scan, volume)
    assert scan.voxel_size.zyx == (20, 15, 14)
    plain = zarr.create_array(tmp_path / "p.zarr", shape=(11, 7, 9), dtype="u2", dimension_names=list("xyz"))
    plain[...] = volume.transpose(2, 1, 0)
    assert_same(open_scan(tmp_path / "p.zarr", "10 um"), volume)


def test_several_arrays_are_named(tmp_path: Path, volume: np.ndarray) -> None:
    root = zarr.open_group(tmp_path / "s.zarr", mode="w", zarr_format=2)
    for name in ("raw", "deeper/filtered"):
        root.create_array(name, data=volume + len(name))
    root.create_array("angles", data=np.arange(5.0))
    with pytest.raises(
        ScanError, match=r"2 arrays.*deeper/filtered \(9 x 7 x 11\).*'s\.zarr:deeper/filtered'"
    ):
        open_scan(tmp_path / "s.zarr", "10 um")
    for name in (f"{tmp_path}/s.zarr:raw", f"{tmp_path}/s.zarr/raw", f"{tmp_path}/s.zarr:/raw"):
        assert_same(open_scan(name, "10 um"), volume + 3)
    assert_same(open_scan(f"{tmp_path}/s.zarr:deeper", "10 um"), volume + 15)
    with pytest.raises(ScanError, match=r"no array 'none'.*raw \(9 x 7 x 11\)"):
        open_scan(f"{tmp_path}/s.zarr:none", "10 um")
    scan = open_scan(f"{tmp_path}/s.zarr:raw", "10 um")
    Project.new(scan).save(tmp_path / "p.mbs")
    again = Project.open(tmp_path / "p.mbs").scan
    assert again is not None
    assert_same(again, volume + 3)


def test_several_images(tmp_path: Path, volume: np.ndarray) -> None:
    """As bioformats2raw lays them out: one image for each series."""
    zarr.open_group(tmp_path / "s.zarr", mode="w", zarr_format=2).attrs["bioformats2raw.layout"] = 3
    for series in range(2):
        write_image(tmp_path / "s.zarr" / str(series), volume + series, 2)
    with pytest.raises(ScanError, match=r"2 arrays that could be meant: 0 \(9 x 7 x 11\), 1 \(9 x 7 x 11\)"):
        open_scan(tmp_path / "s.zarr")
    scan = open_scan(f"{tmp_path}/s.zarr:1")
    assert_same(scan, volume + 1)
    assert scan.voxel_size.zyx == (20, 15, 14)


# Size and place -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "factor", "name"),
    [("micrometer", 1, "um"), ("nanometer", 1e3, "nm"), ("millimeter", 1e-3, "mm"), ("meter", 1e-6, "m"),
     ("angstrom", 1e4, "nm"), ("µm", 1, "um"), ("micron", 1, "um"), ("inch", 1 / 25400, "mm")],
)  # fmt: skip
def test_units(tmp_path: Path, volume: np.ndarray, unit: str, factor: float, name: str) -> None:
    edges = [part * factor for part in (20, 15, 14)]
    write_image(tmp_path / "s.zarr", volume, unit=unit, place=[scaled(*edges)])
    scan = open_scan(tmp_path / "s.zarr")
    assert scan.unit == name
    assert scan.voxel_size.to("um").zyx == pytest.approx((20, 15, 14))


def test_axes_in_units_of_their_own(tmp_path: Path, volume: np.ndarray) -> None:
    group = write_image(tmp_path / "s.zarr", volume, 2, place=[scaled(0.02, 15, 14)])
    facts = dict(group.attrs)
    facts["multiscales"][0]["axes"][0]["unit"] = "millimeter"
    group.attrs.update(facts)
    assert open_scan(tmp_path / "s.zarr").voxel_size.to("um").zyx == pytest.approx((20, 15, 14))


@pytest.mark.parametrize(
    ("unit", "told"), [(None, "without a unit"), ("parsec", "'parsec'"), ("pixel", "without")]
)
def test_units_that_are_none(tmp_path: Path, volume: np.ndarray, unit: str | None, told: str) -> None:
    write_image(tmp_path / "s.zarr", volume, unit=unit)
    with pytest.raises(UnitError, match=told):
        open_scan(tmp_path / "s.zarr")
    assert open_scan(tmp_path / "s.zarr", unit="um").voxel_size.zyx == (20, 15, 14)


def test_sizes_that_nobody_has_are_questioned(tmp_path: Path, volume: np.ndarray) -> None:
    for number, edges in enumerate(([14.0] * 3, [1e-6] * 3, [14.0, 14.0, 0.0])):
        write_image(tmp_path / f"{number}.zarr", volume, unit="millimeter", place=[scaled(*edges)])
        with pytest.raises(UnitError, match=r"state the voxel size"):
            open_scan(tmp_path / f"{number}.zarr")


def test_translations_of_both_places(tmp_path: Path, volume: np.ndarray) -> None:
    write_image(
        tmp_path / "s.zarr", volume, 2, place=[scaled(2, 2, 2), moved(1, 2, 3)],
        whole=[scaled(10, 5, 5), moved(100, 0, 0)],
    )  # fmt: skip
    scan = open_scan(tmp_path / "s.zarr")
    assert scan.voxel_size.zyx == (20, 10, 10)
    assert scan.origin == (15, 10, 110)
    write_image(tmp_path / "back.zarr", volume[::-1], place=[scaled(-20, 15, 14), moved(160, 0, 0)])
    scan = open_scan(tmp_path / "back.zarr")
    assert_same(scan, volume)
    assert scan.origin == (0, 0, 0)


def test_transformations_that_are_not_read(tmp_path: Path, volume: np.ndarray) -> None:
    for number, place in enumerate(
        ([{"type": "affine", "affine": []}], [scaled(1, 2)], [{"type": "scale", "path": "elsewhere"}])
    ):
        write_image(tmp_path / f"{number}.zarr", volume, place=place)
        with pytest.raises(UnitError, match="places its voxels by a"):
            open_scan(tmp_path / f"{number}.zarr")
        assert open_scan(tmp_path / f"{number}.zarr", "10 um").voxel_size.x == 10


def test_attributes_of_plain_arrays(tmp_path: Path, volume: np.ndarray) -> None:
    array = zarr.create_array(tmp_path / "s.zarr", shape=volume.shape, dtype="u2", zarr_format=2)
    array[...] = volume
    array.attrs.update({"voxel_size": [0.02, 0.015, 0.014], "unit": "mm"})
    assert open_scan(tmp_path / "s.zarr").voxel_size.to("um").zyx == pytest.approx((20, 15, 14))
    array.attrs.update({"_ARRAY_DIMENSIONS": ["z", "y", "x"], "unit": "furlong"})
    with pytest.raises(UnitError, match="'furlong'"):
        open_scan(tmp_path / "s.zarr")


def test_versions_without_axes_or_scales(tmp_path: Path, volume: np.ndarray) -> None:
    group = zarr.open_group(tmp_path / "s.zarr", mode="w", zarr_format=2)
    group.create_array("0", data=volume[None, None])
    group.attrs["multiscales"] = [{"version": "0.1", "datasets": [{"path": "0"}]}]
    with pytest.raises(UnitError, match="does not contain the voxel size"):
        open_scan(tmp_path / "s.zarr")
    assert_same(open_scan(tmp_path / "s.zarr", "10 um"), volume)
    group.attrs["multiscales"] = [{"version": "0.3", "axes": list("tczyx"), "datasets": [{"path": "0"}]}]
    assert_same(open_scan(tmp_path / "s.zarr", "10 um"), volume)
    group.attrs["multiscales"] = [{"coordinateSystems": [], "datasets": [{"path": "0"}]}]
    with pytest.raises(ScanError, match=r"later than 0\.5"):
        open_scan(tmp_path / "s.zarr", "10 um")


# Labels -------------------------------------------------------------------------------------------------


@pytest.fixture
def grains() -> tuple[np.ndarray, np.ndarray]:
    """A scan, and the labels of its two grains."""
    scan, labels = np.full((12, 14, 16), 20, np.uint8), np.zeros((12, 14, 16), np.uint8)
    labels[2:6, 3:7, 4:8], labels[7:10, 8:12, 9:14] = 1, 2
    scan[labels > 0] = 200
    return scan, labels


@pytest.mark.parametrize("number", [2, 3])
def test_labels_beside_their_image(tmp_path: Path, grains: Any, number: int) -> None:
    scan, labels = grains
    write_image(tmp_path / "s.zarr", scan, number)
    write_image(tmp_path / "s.zarr" / "labels" / "grains", labels, number)
    image = open_scan(tmp_path / "s.zarr")
    assert_same(image, scan)
    found = load_labels(f"{tmp_path}/s.zarr:labels/grains", image)
    np.testing.assert_array_equal(found.labels, labels)
    with pytest.warns(GrainWarning, match="the labels labels/grains were taken"):
        found = load_labels(tmp_path / "s.zarr", image)
    np.testing.assert_array_equal(found.labels, labels)
    write_image(tmp_path / "s.zarr" / "labels" / "pores", labels, number)
    with pytest.raises(ScanError, match="2 arrays that could be meant: labels/grains"):
        load_labels(tmp_path / "s.zarr", image)
    with pytest.warns(ScanWarning, match="lacks"):
        assert_same(open_scan(f"{tmp_path}/s.zarr:labels/grains"), labels)


def test_a_region_lands_where_its_translation_says(tmp_path: Path, grains: Any) -> None:
    scan, labels = grains
    write_image(tmp_path / "s.zarr", scan, place=[scaled(10, 10, 10), moved(50, 60, 70)])
    crop = [scaled(0.01, 0.01, 0.01), moved(0.06, 0.08, 0.1)]
    write_image(tmp_path / "l.zarr", labels[1:, 2:, 3:], 2, unit="millimeter", place=crop)
    with pytest.warns(GrainWarning, match=r"from voxel \(1, 2, 3\)"):
        found = load_labels(tmp_path / "l.zarr", open_scan(tmp_path / "s.zarr"))
    np.testing.assert_array_equal(found.labels, labels)


# What is refused ----------------------------------------------------------------------------------------


def test_links_out_of_the_folder(tmp_path: Path, volume: np.ndarray) -> None:
    write_image(tmp_path / "other.zarr", volume)
    write_image(tmp_path / "s.zarr", volume)
    for part in ("0/c/0/0/0", "0/c/1", "0/zarr.json"):
        copy = tmp_path / f"{part.count('/')}{part[-1]}.zarr"
        shutil.copytree(tmp_path / "s.zarr", copy)
        victim = copy / part
        (shutil.rmtree if victim.is_dir() else Path.unlink)(victim)
        victim.symlink_to(tmp_path / "other.zarr" / part)
        with pytest.raises(ScanError, match=r"as a link to another folder"):
            open_scan(copy)
    (tmp_path / "linked.zarr").symlink_to(tmp_path / "s.zarr")
    assert_same(open_scan(tmp_path / "linked.zarr"), volume)


def test_paths_out_of_the_folder(tmp_path: Path, volume: np.ndarray) -> None:
    write_image(tmp_path / "other.zarr", volume)
    group = write_image(tmp_path / "s.zarr", volume, 2)
    for path in ("../other.zarr/0", "0/../../other.zarr/0", "C:/other.zarr/0"):
        facts = dict(group.attrs)
        facts["multiscales"][0]["datasets"][0]["path"] = path
        group.attrs.update(facts)
        with pytest.raises(ScanError, match="outside its own folder"):
            open_scan(tmp_path / "s.zarr")
    with pytest.raises(ScanError, match="outside its own folder"):
        open_scan(f"{tmp_path}/s.zarr:../other.zarr/0")


def change(path: Path, edit: Callable[[dict[str, Any]], None]) -> None:
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))


def test_claims_are_checked_before_memory_is_taken(tmp_path: Path, volume: np.ndarray) -> None:
    for number, document in ((2, ".zarray"), (3, "zarr.json")):
        path = tmp_path / f"{number}.zarr"
        write_image(path, volume, number)
        change(path / "0" / document, lambda content: content.update(shape=[3000, 2000, 2000]))
        with pytest.raises(ScanError, match="24,000,000,000 bytes, but holds"):
            open_scan(path)
    array = zarr.create_array(
        tmp_path / "e.zarr", shape=(2000, 2000, 2000), dtype="u2", chunks=(200, 200, 200)
    )
    with pytest.raises(ScanError, match="never filled"):
        open_scan(tmp_path / "e.zarr", "10 um")
    assert array.shape == (2000, 2000, 2000)


@pytest.mark.parametrize("packed", ["blosc", "zlib", "gzip", "bz2", "lzma", "zstd", "lz4"])
def test_chunks_are_not_unpacked_beyond_their_size(tmp_path: Path, packed: str) -> None:
    data = np.ones((4, 4, 4), np.uint16)
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=data.shape, dtype="u2", chunks=data.shape, zarr_format=2,
        compressors=PACKED_2[packed],
    )  # fmt: skip
    array[...] = data
    codec = PACKED_2[packed]
    assert codec is not None
    (tmp_path / "a.zarr" / "0.0.0").write_bytes(codec.encode(bytes(10_000)))
    with pytest.raises(ScanError, match=r"chunk 0\.0\.0 .*damaged or cut off"):
        open_scan(tmp_path / "a.zarr", "10 um")


@pytest.mark.parametrize(
    ("place", "number"), [(4, 2**31), (8, 2**31 - 1), (8, 0), (12, 2**31 - 1), (12, 20), (16, 2**31 - 1)]
)
def test_blosc_that_lies_about_its_lengths(
    tmp_path: Path, volume: np.ndarray, place: int, number: int
) -> None:
    """Sizes of all, of a block, of what is stored, and where the first block begins."""
    array = zarr.create_array(
        tmp_path / "a.zarr", shape=volume.shape, dtype="u2", chunks=volume.shape, zarr_format=2,
        compressors=numcodecs.Blosc(),
    )  # fmt: skip
    array[...] = volume // 7000
    chunk = tmp_path / "a.zarr" / "0.0.0"
    content = bytearray(chunk.read_bytes())
    content[place : place + 4] = number.to_bytes(4, "little")
    chunk.write_bytes(content)
    with pytest.raises(ScanError, match=r"chunk 0\.0\.0 .*damaged or cut off"):
        open_scan(tmp_path / "a.zarr", "10 um")


def test_damage_is_told_with_its_chunk(tmp_path: Path, volume: np.ndarray) -> None:
    for number, packed in ((0, PACKED_3["zstd"]), (1, PACKED_3["checked"]), (2, PACKED_3["nothing"])):
        path = tmp_path / f"{number}.zarr"
        array = zarr.create_array(path, shape=volume.shape, dtype="u2", chunks=(9, 7, 11), compressors=packed)
        array[...] = volume
        chunk = path / "c" / "0" / "0" / "0"
        content = chunk.read_bytes()
        chunk.write_bytes(content[:-5] if number != 1 else content[:40] + b"?" + content[41:])
        with pytest.raises(ScanError, match=r"in its chunk c/0/0/0 .*damaged"):
            open_scan(path, "10 um")


def test_chunks_that_are_missing_are_told(tmp_path: Path, volume: np.ndarray) -> None:
    write_image(tmp_path / "s.zarr", volume)
    (tmp_path / "s.zarr" / "0" / "c" / "0" / "1" / "2").unlink()
    with pytest.warns(ScanWarning, match="lacks 1 of 18 chunks, where Zarr means 0"):
        scan = open_scan(tmp_path / "s.zarr")
    assert not scan.voxels[:4, 4:, 8:].any()
    np.testing.assert_array_equal(scan.voxels[4:], volume[4:])


def test_what_is_not_damaged_is_not_said_to_be(tmp_path: Path, volume: np.ndarray) -> None:
    def write(name: str, data: np.ndarray, **options: Any) -> Path:
        path = tmp_path / f"{name}.zarr"
        array = zarr.create_array(path, shape=data.shape, dtype=data.dtype, **options)
        array[...] = data
        return path

    image = zarr.open_group(tmp_path / "gone.zarr", mode="w")
    describe(image, {"axes": axes(), "datasets": [{"path": "0"}]})
    odd = write_image(tmp_path / "odd.zarr", volume, 2)
    facts = dict(odd.attrs)
    facts["multiscales"][0]["axes"].pop()
    odd.attrs.update(facts)
    empty = tmp_path / "empty.zarr"
    empty.mkdir()
    cases = (
        (write("filtered", volume, zarr_format=2, filters=[numcodecs.Delta("u2")]), "packed by 'delta'"),
        (write("flat", volume[0]), "no array of three axes|has 2 axes"),
        (write("complex", volume.astype("c8")), "values of type complex64"),
        (tmp_path / "gone.zarr", "names its array '0', which is not there"),
        (tmp_path / "odd.zarr", "has 3 axes .*names 2"),
        (empty, "no array of three axes"),
    )
    for path, told in cases:
        with pytest.raises(ScanError, match=told) as caught:
            open_scan(path, "10 um")
        assert "damaged" not in str(caught.value).replace(str(tmp_path), "")
    change(write("codec", volume) / "zarr.json", lambda content: content["codecs"].append({"name": "jumble"}))
    with pytest.raises(ScanError, match=r"codec\.zarr .*zarr does not understand .*jumble"):
        open_scan(tmp_path / "codec.zarr", "10 um")
    (empty / "zarr.json").write_text("{")
    with pytest.raises(ScanError, match=r"cannot be read as Zarr \(zarr\.json"):
        open_scan(empty, "10 um")
    (tmp_path / "n.zarr.zip").write_bytes(b"nothing")
    with pytest.raises(ScanError, match="not a ZIP archive"):
        open_scan(tmp_path / "n.zarr.zip", "10 um")


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_damaged_files_are_refused(tmp_path: Path, volume: np.ndarray) -> None:
    folder = tmp_path / "whole"
    write_image(folder / "a.zarr", volume, 2, compressors=numcodecs.Blosc(), levels=2)
    write_image(folder / "b.zarr", volume, 3, chunks=(4, 4, 4), shards=(8, 8, 12))
    write_image(folder / "c.zarr", volume, 2, compressors=numcodecs.GZip(), chunks=(9, 7, 11))
    shutil.make_archive(str(folder / "d.zarr"), "zip", folder / "b.zarr")
    assert problems_of(tmp_path, cases_of_folder(folder), 60) == []
