"""Pixels are read as their format means them, in stacks, folders of slices and label images alike."""

from __future__ import annotations

from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile
from PIL import Image

from mbstudio.core.errors import ScanError, ScanWarning
from mbstudio.core.grains import load_labels
from mbstudio.core.scan import Scan, open_scan


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 250, (6, 7, 11)).astype(np.uint8)


def opened(path: Path) -> np.ndarray:
    return np.asarray(open_scan(path, "14 um").voxels)


def write_slices(folder: Path, volume: np.ndarray, **options: object) -> Path:
    folder.mkdir()
    for index, image in enumerate(volume):
        tifffile.imwrite(folder / f"s{index:03d}.tif", image, **options)  # type: ignore[arg-type]
    return folder


@pytest.mark.parametrize("kind", ["uint8", "uint16", "int16", ">u2"])
def test_white_at_zero_is_turned_round(tmp_path: Path, volume: np.ndarray, kind: str) -> None:
    grey = volume.astype(kind)
    stored = ~grey  # the largest number less the grey value; -1 less it where there is a sign
    order = ">" if kind[0] == ">" else "<"
    tifffile.imwrite(tmp_path / "s.tif", stored, photometric="miniswhite", byteorder=order)
    np.testing.assert_array_equal(opened(tmp_path / "s.tif"), grey)
    np.testing.assert_array_equal(
        opened(write_slices(tmp_path / "slices", stored, photometric="miniswhite")), grey
    )


def test_white_at_zero_page_by_page(
    tmp_path: Path, volume: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mbstudio.core.scan.readers import tiff

    monkeypatch.setattr(tiff, "DECODE_AT_ONCE_BYTES", 0)
    tifffile.imwrite(tmp_path / "s.tif", 255 - volume, photometric="miniswhite", compression="zlib")
    scan = open_scan(tmp_path / "s.tif", "14 um")
    assert not isinstance(scan.voxels, np.ndarray)
    np.testing.assert_array_equal(np.asarray(scan.voxels), volume)


@pytest.mark.parametrize("compression", [None, "packbits"])
@pytest.mark.parametrize("photometric", ["minisblack", "miniswhite"])
def test_one_bit_becomes_zero_and_one(
    tmp_path: Path, volume: np.ndarray, photometric: str, compression: str | None
) -> None:
    solid = volume > 100
    stored = solid if photometric == "minisblack" else ~solid
    tifffile.imwrite(tmp_path / "s.tif", stored, photometric=photometric, compression=compression)
    voxels = opened(tmp_path / "s.tif")
    assert voxels.dtype == np.uint8
    np.testing.assert_array_equal(voxels, solid)
    folder = tmp_path / "slices"
    folder.mkdir()
    for index, image in enumerate(solid):
        Image.fromarray(image).convert("1").save(folder / f"{index}.png")
    np.testing.assert_array_equal(opened(folder), solid)


def test_truth_values_of_numpy(tmp_path: Path, volume: np.ndarray) -> None:
    np.save(tmp_path / "s.npy", volume > 100)
    scan = open_scan(tmp_path / "s.npy", "14 um")
    assert scan.is_memory_mapped
    assert scan.voxels.dtype == np.uint8


def test_a_grey_palette_shows_greys_and_a_coloured_one_nothing(tmp_path: Path, volume: np.ndarray) -> None:
    inverse = np.tile(np.arange(255, -1, -1, dtype=np.uint16) * 257, (3, 1))
    tifffile.imwrite(tmp_path / "grey.tif", 255 - volume, photometric="palette", colormap=inverse)
    np.testing.assert_array_equal(opened(tmp_path / "grey.tif"), volume)
    fire = inverse.copy()
    fire[1] //= 2
    tifffile.imwrite(tmp_path / "fire.tif", volume, photometric="palette", colormap=fire)
    with pytest.raises(ScanError, match=r"fire\.tif.*colour palette"):
        opened(tmp_path / "fire.tif")
    folder = tmp_path / "slices"
    folder.mkdir()
    for index, image in enumerate(volume):
        picture = Image.fromarray(255 - image).convert("P")
        picture.putpalette(np.repeat(np.arange(255, -1, -1, dtype=np.uint8), 3).tobytes())
        picture.save(folder / f"{index}.png")
    np.testing.assert_array_equal(opened(folder), volume)


@pytest.mark.parametrize("planes", ["contig", "separate"])
@pytest.mark.parametrize("alpha", [False, True])
def test_grey_in_colours_is_grey(tmp_path: Path, volume: np.ndarray, planes: str, alpha: bool) -> None:
    layers = [volume] * 3 + ([np.full_like(volume, 255)] if alpha else [])
    axis = -1 if planes == "contig" else 1
    tifffile.imwrite(tmp_path / "s.tif", np.stack(layers, axis), photometric="rgb", planarconfig=planes,
                     extrasamples=["unassalpha"] if alpha else None)  # fmt: skip
    np.testing.assert_array_equal(opened(tmp_path / "s.tif"), volume)
    layers[1] = layers[1] ^ 1
    tifffile.imwrite(tmp_path / "c.tif", np.stack(layers, axis), photometric="rgb", planarconfig=planes,
                     extrasamples=["unassalpha"] if alpha else None)  # fmt: skip
    with pytest.raises(ScanError, match=r"c\.tif contains colour images"):
        opened(tmp_path / "c.tif")


@pytest.mark.parametrize("ending", ["png", "bmp"])
def test_pictures_of_grey_in_colours(tmp_path: Path, volume: np.ndarray, ending: str) -> None:
    for index, image in enumerate(volume):
        iio.imwrite(tmp_path / f"{index}.{ending}", np.repeat(image[..., None], 3, axis=2))
    np.testing.assert_array_equal(opened(tmp_path), volume)


def test_jpeg_slices(tmp_path: Path) -> None:
    ramp = np.tile(np.arange(64, dtype=np.uint8), (6, 64, 1))
    for index, image in enumerate(ramp):
        Image.fromarray(image).convert("RGB").save(tmp_path / f"{index}.jpg", quality=100)
    assert np.abs(opened(tmp_path).astype(int) - ramp).max() <= 3


@pytest.mark.parametrize(
    "options",
    [{"tile": (16, 16)}, {"tile": (16, 16, 16), "volumetric": True}, {"bigtiff": True}, {"byteorder": ">"},
     {"rowsperstrip": 2, "compression": "lzw"}, {"predictor": True, "compression": "zlib"}],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["uint8", "int16", "uint32", "float32", "float16", "float64"])
def test_layouts_and_types_of_tiff(
    tmp_path: Path, volume: np.ndarray, options: dict[str, object], kind: str
) -> None:
    if options.get("predictor") and kind == "float16":
        pytest.skip("tifffile writes no such file")
    grey = volume.astype(kind) - (np.array(100, kind) if kind[0] in "if" else np.array(0, kind))
    tifffile.imwrite(tmp_path / "s.tif", grey, photometric="minisblack", **options)  # type: ignore[arg-type]
    voxels = opened(tmp_path / "s.tif")
    np.testing.assert_array_equal(voxels, grey)
    assert voxels.dtype != np.float16


def test_a_preview_behind_the_stack_is_left_out_and_told(tmp_path: Path, volume: np.ndarray) -> None:
    with tifffile.TiffWriter(tmp_path / "s.tif") as writer:
        for image in volume:
            writer.write(image, contiguous=False, metadata=None)
        writer.write(volume[0, :3, :3], metadata=None)
    with pytest.warns(ScanWarning, match=r"s\.tif contains other images besides the stack.*3 x 3"):
        np.testing.assert_array_equal(opened(tmp_path / "s.tif"), volume)


def test_two_stacks_in_one_file_are_refused_by_name(tmp_path: Path, volume: np.ndarray) -> None:
    with tifffile.TiffWriter(tmp_path / "s.ome.tif", ome=True) as writer:
        writer.write(volume, metadata={"axes": "ZYX", "Name": "raw"})
        writer.write(volume, metadata={"axes": "ZYX", "Name": "filtered"})
    with pytest.raises(ScanError, match=r"2 stacks of images.*raw.*filtered"):
        opened(tmp_path / "s.ome.tif")


def test_frames_with_an_interval_are_a_time_series(tmp_path: Path, volume: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "t.tif", volume, imagej=True, metadata={"axes": "TYX", "finterval": 0.5})
    with pytest.raises(ScanError, match=r"t\.tif is a time series"):
        opened(tmp_path / "t.tif")
    tifffile.imwrite(tmp_path / "f.tif", volume, imagej=True, metadata={"axes": "TYX"})
    np.testing.assert_array_equal(opened(tmp_path / "f.tif"), volume)


def test_channels_of_a_hyperstack_are_refused(tmp_path: Path, volume: np.ndarray) -> None:
    stack = np.stack([volume, volume], axis=1)
    tifffile.imwrite(tmp_path / "c.tif", stack, imagej=True, metadata={"axes": "ZCYX", "mode": "composite"})
    with pytest.raises(ScanError, match=r"c\.tif contains more than one volume"):
        opened(tmp_path / "c.tif")


def test_a_file_of_another_kind_is_no_damaged_tiff(tmp_path: Path, volume: np.ndarray) -> None:
    iio.imwrite(tmp_path / "s.png", volume[0])
    (tmp_path / "s.tif").write_bytes((tmp_path / "s.png").read_bytes())
    with pytest.raises(ScanError, match="not a TIFF file but a PNG image") as caught:
        opened(tmp_path / "s.tif")
    assert "damaged" not in str(caught.value)


# Numbers of grains ------------------------------------------------------------------------------------


@pytest.fixture
def labels() -> np.ndarray:
    image = np.zeros((12, 20, 20), np.uint8)
    for number, corner in enumerate(((1, 1), (1, 8), (8, 1), (8, 12)), 1):
        image[3:8, corner[0] : corner[0] + 5, corner[1] : corner[1] + 5] = number
    return image


def sizes(path: Path) -> list[int]:
    return [int(count) for count in load_labels(path, voxel_size="10 um").table["voxels"]]


def test_labels_through_palettes_and_white_at_zero(tmp_path: Path, labels: np.ndarray) -> None:
    colours = np.random.default_rng(1).integers(0, 65535, (3, 256)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "palette.tif", labels, photometric="palette", colormap=colours)
    tifffile.imwrite(tmp_path / "noted.tif", labels, photometric="miniswhite")
    tifffile.imwrite(tmp_path / "turned.tif", 255 - labels, photometric="miniswhite")
    folder = tmp_path / "slices"
    folder.mkdir()
    for index, image in enumerate(labels):
        picture = Image.new("P", image.shape[::-1])
        picture.putdata(image.ravel().tolist())
        picture.putpalette((colours.T // 257).astype(np.uint8).tobytes())
        picture.save(folder / f"{index}.png")
    for name in ("palette.tif", "noted.tif", "turned.tif", "slices"):
        assert sizes(tmp_path / name) == [125] * 4, name


def test_labels_of_one_bit(tmp_path: Path, labels: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "s.tif", labels > 0, photometric="minisblack")
    tifffile.imwrite(tmp_path / "w.tif", labels == 0, photometric="miniswhite")
    assert sizes(tmp_path / "s.tif") == sizes(tmp_path / "w.tif") == [125] * 4


# No numbers outside the field of view -----------------------------------------------------------------


def test_infinite_outside_a_cylinder_along_x_is_unseen(tmp_path: Path) -> None:
    from mbstudio.core.grains import segment
    from mbstudio.core.units import VoxelSize

    z, y, x = np.indices((40, 40, 30))
    grey = np.where((z - 20) ** 2 + (y - 20) ** 2 + (x - 15) ** 2 <= 64, 100.0, 10.0)
    grey[(z - 19.5) ** 2 + (y - 19.5) ** 2 > 18**2] = np.inf
    grains = segment(Scan(grey, VoxelSize(1, 1, 1, "mm")))
    assert len(grains.interior_labels) == 1
    # A grain that the circle cuts is cut, a hole inside is told by its place.
    cut = np.where((z - 20) ** 2 + (y - 6) ** 2 + (x - 15) ** 2 <= 49, 100.0, 10.0)
    cut[~np.isfinite(grey)] = np.nan
    assert segment(Scan(cut, VoxelSize(1, 1, 1, "mm"))).interior_labels == []
    holed = grey.copy()
    holed[20, 20, 12] = np.nan
    with pytest.raises(ScanError, match="z 20 to 20, y 20 to 20, x 12 to 12"):
        segment(Scan(holed, VoxelSize(1, 1, 1, "mm")))
