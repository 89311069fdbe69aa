"""A region of a scan, and means of blocks, lie in space where the scan's voxels lay."""

from __future__ import annotations

import itertools
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
import zarr
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.errors import ScanError, ScanWarning
from mbstudio.core.scan import Scan, open_scan
from mbstudio.core.scan.excerpt import Excerpt, read_bin, read_crop
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.readers import slices, tiff
from mbstudio.core.scan.readers.hdf5 import volume as hdf5
from mbstudio.core.scan.readers.ome_zarr.reading import ZarrArray
from mbstudio.core.units import VoxelSize

SHAPE = (12, 14, 17)
SIZE = VoxelSize(4, 3, 2, "um")
ORIGIN = (100.0, -20.0, 5.0)


def numbered(shape: tuple[int, int, int] = SHAPE, dtype: type = np.uint16) -> np.ndarray:
    return np.arange(np.prod(shape)).reshape(shape).astype(dtype)


def scan_of(voxels: np.ndarray, **more) -> Scan:
    return Scan(voxels, SIZE, ORIGIN, **more)


# What is asked for -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("crop", "ends"),
    [
        ("2:5,3:9,1:17", ((2, 5), (3, 9), (1, 17))),
        (" 2:5 , :9 , 4: ", ((2, 5), (0, 9), (4, 17))),
        (":,:,:", ((0, 12), (0, 14), (0, 17))),
        ("2:5", ((2, 5), (0, 14), (0, 17))),
        ("-3:,:-1,-4:-2", ((9, 12), (0, 13), (13, 15))),
        (np.s_[2:5, :, -4:], ((2, 5), (0, 14), (13, 17))),
        (np.s_[np.int64(2) : 5], ((2, 5), (0, 14), (0, 17))),
    ],
)
def test_a_region_is_written_as_python_slices(crop, ends) -> None:
    block = read_crop(crop, SHAPE)
    assert tuple((part.start, part.stop) for part in block) == ends
    parts = crop if not isinstance(crop, str) else eval(f"np.s_[{crop}]")
    np.testing.assert_array_equal(numbered()[block], numbered()[parts])


@pytest.mark.parametrize(
    ("crop", "said"),
    [
        ("5:5,:,:", "empty along z .5:5.*12 x 14 x 17"),
        (":,9:3,:", "empty along y"),
        (":,:,10:30", "beyond the scan along x, which has 12 x 14 x 17 voxels.*0 to 17"),
        ("-13:,:,:", "beyond the scan along z"),
        ("13:,:,:", "beyond the scan along z"),
        ("1,2,3", "cannot be read at '1'.*100:300"),
        ("a:b", "cannot be read"),
        ("", "cannot be read"),
        ("0:4:2", "cannot be read"),
        ("1.5:3", "cannot be read"),
        (":,:,:,:", "4 parts"),
        (np.s_[0:4:2], "step along z"),
        (np.s_[0.5:4], "not whole numbers"),
        ((1, 2, 3), "not a sequence of slices"),
    ],
)
def test_a_region_that_is_none_is_refused_with_the_size_of_the_scan(crop, said: str) -> None:
    with pytest.raises(ScanError, match=said):
        scan_of(numbered()).cropped(crop)


@pytest.mark.parametrize("bad", [0, -1, "0", "a", "2,2", "1,2,3,4", 1.5, "1.5", (2, 0, 2), None, [2.5]])
def test_a_bin_that_is_none_is_refused(bad) -> None:
    with pytest.raises(ScanError, match="cannot be read"):
        read_bin(bad)


def test_a_bin_larger_than_the_region_is_refused() -> None:
    with pytest.raises(ScanError, match="bin of 13 is larger than the 12 voxels along z of 12 x 14 x 17"):
        scan_of(numbered()).binned(13)
    with pytest.raises(ScanError, match="bin of 5 is larger than the 4 voxels along y of 12 x 4 x 17"):
        scan_of(numbered()).cropped(":,2:6,:").binned("1,5,1")


def test_a_scan_is_binned_once() -> None:
    """Means of rounded means would not be found again in the file."""
    with pytest.raises(ScanError, match="binned already"):
        scan_of(numbered()).binned(2).binned(2)


# Where it lies -----------------------------------------------------------------------------------


def places(scan: Scan) -> np.ndarray:
    """Positions (x, y, z) of all voxels."""
    index = np.indices(scan.shape).reshape(3, -1).T
    return scan.voxel_size.positions(index, scan.origin).reshape(*scan.shape, 3)


@st.composite
def parts(draw) -> tuple[tuple[slice, slice, slice], tuple[int, int, int]]:
    ends, factors = [], []
    for count in SHAPE:
        start = draw(st.integers(0, count - 1))
        stop = draw(st.integers(start + 1, count))
        ends.append(slice(start, stop))
        factors.append(draw(st.integers(1, min(4, stop - start))))
    return tuple(ends), tuple(factors)


@given(parts())
def test_blocks_lie_in_the_middle_of_their_voxels(part) -> None:
    block, factors = part
    voxels = numbered(dtype=np.float64)
    whole = scan_of(voxels)
    scan = whole.cropped(block).binned(factors)
    z, y, x = scan.shape
    grey, where = np.asarray(scan.voxels), places(scan)
    of_file = places(whole)
    for index in itertools.product((0, z - 1), (0, y - 1), (0, x - 1)):
        inside = tuple(
            slice(first.start + n * f, first.start + (n + 1) * f)
            for first, n, f in zip(block, index, factors, strict=True)
        )
        assert grey[index] == pytest.approx(voxels[inside].mean())
        np.testing.assert_allclose(where[index], of_file[inside].reshape(-1, 3).mean(axis=0))
    assert scan.voxel_size.volume == pytest.approx(SIZE.volume * np.prod(factors))
    assert scan.shape == tuple(
        (one.stop - one.start) // factor for one, factor in zip(block, factors, strict=True)
    )


@given(parts(), st.tuples(st.booleans(), st.booleans(), st.booleans()))
def test_the_grid_of_the_file_follows(part, flipped) -> None:
    """Voxel [0, 0, 0] of what is stored lies where the grid says, whichever axes run backwards."""
    block, factors = part
    steps = np.diag([2.0, 3.0, 4.0]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    grid = Grid(steps, np.array([7.0, 8, 9]), "um", flipped)
    stored = numbered(dtype=np.float64)
    # The position of every stored voxel, handed out as the voxels are.
    z, y, x = np.indices(SHAPE)
    where = grid.origin + np.stack([x, y, z], axis=-1) @ steps
    turned = tuple(slice(None, None, -1 if back else 1) for back in flipped)
    scan = scan_of(stored[turned], grid=grid).cropped(block).binned(factors)
    shape = scan.shape
    inside = tuple(
        slice(one.start, one.start + n * f) for one, n, f in zip(block, shape, factors, strict=True)
    )
    blocks = where[turned][inside].reshape(
        shape[0], factors[0], shape[1], factors[1], shape[2], factors[2], 3
    )
    middles = scan.grid.as_stored(blocks.mean(axis=(1, 3, 5)))
    np.testing.assert_allclose(scan.grid.origin, middles[0, 0, 0])
    np.testing.assert_allclose(
        scan.grid.origin + np.array(shape[::-1]) @ scan.grid.steps - scan.grid.steps.sum(axis=0),
        middles[-1, -1, -1],
    )


def test_regions_of_regions_are_regions_of_the_file() -> None:
    voxels = numbered()
    scan = scan_of(voxels).cropped("2:,1:,:").binned("2,1,3").cropped("1:4,2:5,:-1")
    assert scan.excerpt == Excerpt(SHAPE, (4, 3, 0), (10, 6, 12), (2, 1, 3))
    again = scan_of(voxels).cropped(scan.excerpt.block).binned(scan.excerpt.bin)
    np.testing.assert_array_equal(np.asarray(again.voxels), np.asarray(scan.voxels))
    assert again.origin == pytest.approx(scan.origin)
    assert scan.excerpt.describe() == "4:10, 3:6, 0:12 of 12 × 14 × 17; bin 2 × 1 × 3"


def test_all_of_a_scan_is_no_part() -> None:
    scan = scan_of(numbered())
    assert scan.cropped(":").excerpt is None
    assert scan.binned(1) is scan


# Values ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["u1", "i1", ">u2", "<i2", "u4", ">f4", "f8"])
def test_means_keep_the_type_and_round_to_the_nearest(dtype: str, rng: np.random.Generator) -> None:
    voxels = (rng.uniform(-1, 1, (4, 6, 8)) * 100).astype(dtype)
    means = np.asarray(scan_of(voxels).binned(2).voxels)
    exact = voxels.reshape(2, 2, 3, 2, 4, 2).astype(float).mean(axis=(1, 3, 5))
    assert means.dtype == np.dtype(dtype)
    if means.dtype.kind == "f":
        np.testing.assert_allclose(means, exact, rtol=1e-6)
    else:
        assert np.abs(means - exact).max() <= 0.5


def test_the_largest_numbers_have_a_mean() -> None:
    voxels = np.full((2, 2, 2), np.iinfo(np.uint32).max, np.uint32)
    assert np.asarray(scan_of(voxels).binned(2).voxels).item() == np.iinfo(np.uint32).max


def test_what_is_left_out_at_the_far_end_is_told() -> None:
    scan = scan_of(numbered()).binned("5,7,1")
    assert scan.shape == (2, 2, 17)
    assert "12 x 14 x 17" in scan.notes[0]
    assert "2 along z" in scan.notes[0]
    assert " along y" not in scan.notes[0]


def cylinder(outside: float, dtype: type, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A scan whose circle touches the box, and which columns lie outside."""
    voxels = rng.uniform(100, 200, (20, 60, 60)).astype(dtype)
    y, x = np.indices((60, 60))
    beyond = np.hypot(y - 29.5, x - 29.5) > 30
    voxels[:, beyond] = outside
    return voxels, beyond


@pytest.mark.parametrize(("outside", "dtype"), [(0, np.uint8), (np.nan, np.float32), (-1000, np.int16)])
@pytest.mark.parametrize("crop", [":,:,:", "5:,10:,:", ":,31:,2:50", ":,:40,33:"])
def test_blocks_partly_outside_the_field_of_view_are_outside(
    outside: float, dtype: type, crop: str, rng: np.random.Generator
) -> None:
    voxels, beyond = cylinder(outside, dtype, rng)
    scan = scan_of(voxels).cropped(crop)
    part = scan.binned(2)
    grey = np.asarray(part.voxels)
    block = read_crop(crop, voxels.shape)
    _, ny, nx = part.shape
    cut = beyond[block[1:]][: 2 * ny, : 2 * nx].reshape(ny, 2, nx, 2).any(axis=(1, 3))
    assert cut.any()
    if np.isnan(outside):
        assert np.isnan(grey[:, cut]).all()
    else:
        assert (grey[:, cut] == outside).all()
    assert (grey[:, ~cut] > 99).all()


def test_a_block_with_a_voxel_that_is_no_number_is_none() -> None:
    voxels = np.ones((4, 4, 4))
    voxels[0, 0, 0], voxels[2, 2, 2], voxels[2, 2, 3] = np.nan, np.inf, -np.inf
    grey = np.asarray(scan_of(voxels).binned(2).voxels)
    assert np.argwhere(~np.isfinite(grey)).tolist() == [[0, 0, 0], [1, 1, 1]]


# Memory and files --------------------------------------------------------------------------------


def test_a_region_shares_what_is_in_memory_or_mapped(tmp_path: Path) -> None:
    voxels = numbered()
    assert np.shares_memory(scan_of(voxels).cropped("2:5,1:,:").voxels, voxels)
    voxels.tofile(tmp_path / "scan.raw")
    for crop, is_map in (("3:7", True), ("3:7,1:,:", False)):
        part = open_scan(tmp_path / "scan.raw", SIZE, shape=SHAPE, dtype="u2", crop=crop)
        assert part.is_memory_mapped
        assert isinstance(part.voxels, np.memmap) == is_map
        np.testing.assert_array_equal(part.voxels, voxels[read_crop(crop, SHAPE)])
    # A map of the slices alone says where these lie in the file: other processes open it there.
    mapped = open_scan(tmp_path / "scan.raw", SIZE, shape=SHAPE, dtype="u2", crop="3:7").voxels
    assert mapped.offset == 3 * SHAPE[1] * SHAPE[2] * 2


def _written(folder: Path, kind: str, voxels: np.ndarray) -> Path:
    if kind == "slices":
        path = folder / "slices"
        path.mkdir()
        for number, image in enumerate(voxels):
            tifffile.imwrite(path / f"{number:03}.tif", image, photometric="minisblack")
    elif kind == "tiff":
        path = folder / "packed.tif"
        tifffile.imwrite(path, voxels, photometric="minisblack", compression="zlib")
    elif kind == "zarr":
        path = folder / "packed.zarr"
        zarr.create_array(path, data=voxels, chunks=(2, 5, 5))
    else:
        path = folder / "packed.h5"
        with h5py.File(path, "w") as file:
            file.create_dataset("scan", data=voxels, chunks=(2, 5, 5), compression="gzip")
    return path


@pytest.mark.parametrize("kind", ["slices", "tiff", "hdf5", "zarr"])
@pytest.mark.parametrize("binning", [None, 2])
def test_only_the_slices_of_the_region_are_read_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, binning: int | None
) -> None:
    voxels = numbered()
    path = _written(tmp_path, kind, voxels)
    seen: list[int] = []
    if kind == "slices":
        read_image = slices._read_image
        monkeypatch.setattr(
            slices, "_read_image",
            lambda file, numbers: (seen.append(int(file.stem)), read_image(file, numbers))[1],
        )  # fmt: skip
    elif kind == "tiff":
        asarray = tifffile.TiffPage.asarray
        monkeypatch.setattr(
            tifffile.TiffPage, "asarray", lambda page: (seen.append(page.index), asarray(page))[1]
        )
        monkeypatch.setattr(tiff, "_decode_at_once", None)
    elif kind == "zarr":
        read = ZarrArray.read
        monkeypatch.setattr(
            ZarrArray, "read",
            lambda array, start, stop: (seen.extend(range(start[0], stop[0])), read(array, start, stop))[1],
        )  # fmt: skip
    else:
        monkeypatch.setattr(hdf5, "UNPACK_AT_ONCE_BYTES", 2**40)
    part = open_scan(path, SIZE, crop="4:8,2:12,:16", binning=binning)
    expected = scan_of(voxels).cropped("4:8,2:12,:16")
    with_bin = expected if binning is None else expected.binned(binning)
    assert isinstance(part.voxels, np.ndarray)
    assert part.voxels.base is None
    np.testing.assert_array_equal(part.voxels, np.asarray(with_bin.voxels))
    assert part.origin == pytest.approx(np.array(with_bin.origin) - ORIGIN)
    # The first slice is looked at for its type.
    assert set(seen) <= {0, 4, 5, 6, 7}


def test_hdf5_reads_turned_axes_in_blocks(tmp_path: Path) -> None:
    voxels = numbered()
    tags = '{"axes": [{"key": "x"}, {"key": "c"}, {"key": "z"}, {"key": "y"}]}'
    with h5py.File(tmp_path / "turned.h5", "w") as file:
        stored = file.create_dataset("exported_data", data=voxels.transpose(2, 0, 1)[:, None], chunks=True)
        stored.attrs["axistags"] = tags
    part = open_scan(tmp_path / "turned.h5", SIZE, crop="4:8,2:13,3:")
    np.testing.assert_array_equal(part.voxels, voxels[4:8, 2:13, 3:])


def test_opening_tells_what_a_bin_leaves_out(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", numbered())
    with pytest.warns(ScanWarning, match="scan.npy has 12 x 14 x 17 .*2 along z"):
        scan = open_scan(tmp_path / "scan.npy", SIZE, binning=(5, 1, 1))
    assert scan.voxel_size == VoxelSize(20, 3, 2, "um")
    assert scan.origin == (0, 0, 8)


def test_errors_of_a_part_name_the_scan_s_size(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", numbered())
    with pytest.raises(ScanError, match="12 x 14 x 17"):
        open_scan(tmp_path / "scan.npy", SIZE, crop="0:100")
    with pytest.raises(ScanError, match="12 x 14 x 17"):
        open_scan(tmp_path / "scan.npy", SIZE, binning=20)
