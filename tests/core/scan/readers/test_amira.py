"""AmiraMesh files of Amira and Avizo: scans and labels in every encoding, or refused with the cause.

The files are written here after the layout that Amira's manual and readers of others describe.
"""

from __future__ import annotations

import os
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from mbstudio.core.errors import GrainWarning, ScanError, UnitError
from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project
from mbstudio.core.scan import open_scan
from tests.fuzzing.harness import problems_of

KINDS = {
    "uint8": "byte",
    "int16": "short",
    "uint16": "ushort",
    "int32": "int",
    "float32": "float",
    "float64": "double",
}
BOX = "BoundingBox 1 1.1 2 2.06 3 3.08,"  # 11 x 7 x 5 voxels of 0.01, 0.01 and 0.02


@pytest.fixture
def volume(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 250, (5, 7, 11))


def rolled(content: bytes) -> bytes:
    """Pack bytes as HxByteRLE: runs of up to 127, and stretches without runs."""
    out, place = bytearray(), 0
    while place < len(content):
        run = 1
        while run < 127 and content[place : place + 1] == content[place + run : place + run + 1]:
            run += 1
        if run > 2:
            out += bytes([run, content[place]])
            place += run
            continue
        stretch = content[place : place + 5]
        out += bytes([0x80 | len(stretch)]) + stretch
        place += len(stretch)
    return bytes(out)


def amira(
    voxels: np.ndarray,
    order: str = "BINARY-LITTLE-ENDIAN",
    packing: str | None = None,
    name: str = "Data",
    more: str = "",
    box: str = BOX,
    units: str = 'Units {\n        Coordinates "mm"\n    }\n',
) -> bytes:
    """Return an AmiraMesh file of one field."""
    z, y, x = voxels.shape[:3]
    kind = KINDS[voxels.dtype.name] + (f"[{voxels.shape[3]}]" if voxels.ndim > 3 else "")
    plain = voxels.astype(voxels.dtype.newbyteorder("<" if "LITTLE" in order else ">")).tobytes()
    if order == "ASCII":
        plain = "\n".join(str(number) for number in voxels.ravel()).encode() + b"\n"
    packed = {"HxZip": zlib.compress, "HxByteRLE": rolled, None: lambda content: content}[packing](plain)
    said = f"({packing},{len(packed)})" if packing else ""
    head = (
        f"# AmiraMesh {order} 2.1\n\n\ndefine Lattice {x} {y} {z}\n\nParameters {{\n    {units}    {more}"
        f'    Content "{x}x{y}x{z} {kind}, uniform coordinates",\n    {box}\n    CoordType "uniform"\n}}\n\n'
        f"Lattice {{ {kind} {name} }} @1{said}\n\n# Data section follows\n@1\n"
    )
    return head.encode() + packed + b"\n"


def check(path: Path, voxels: np.ndarray) -> None:
    scan = open_scan(path)
    assert scan.voxels.dtype.newbyteorder("=") == voxels.dtype
    np.testing.assert_array_equal(np.asarray(scan.voxels), voxels)
    assert scan.voxel_size.to("mm").zyx == pytest.approx((0.02, 0.01, 0.01))
    assert scan.origin == pytest.approx((1, 2, 3))


# Scans -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", KINDS)
@pytest.mark.parametrize("order", ["BINARY-LITTLE-ENDIAN", "BINARY", "BINARY-BIG-ENDIAN", "ASCII"])
def test_plain_numbers(tmp_path: Path, volume: np.ndarray, dtype: str, order: str) -> None:
    path = tmp_path / "s.am"
    path.write_bytes(amira(volume.astype(dtype), order))
    check(path, volume.astype(dtype))
    assert open_scan(path).is_memory_mapped == (order != "ASCII")


@pytest.mark.parametrize(
    ("packing", "dtype"),
    [("HxZip", "uint8"), ("HxZip", "uint16"), ("HxZip", "float32"), ("HxByteRLE", "uint8")],
)
def test_packed_numbers(tmp_path: Path, volume: np.ndarray, packing: str, dtype: str) -> None:
    voxels = (volume // 100).astype(dtype)  # so that there are runs
    for order in ("BINARY-LITTLE-ENDIAN", "BINARY"):
        (tmp_path / "s.am").write_bytes(amira(voxels, order, packing))
        check(tmp_path / "s.am", voxels)


def test_first_lines_endings_and_writings(tmp_path: Path, volume: np.ndarray) -> None:
    voxels = volume.astype(np.uint16)
    content = amira(voxels)
    (tmp_path / "a.am").write_bytes(content.replace(b"# AmiraMesh", b"# Avizo"))
    (tmp_path / "b.am").write_bytes(content.replace(b"# AmiraMesh", b"# AmiraMesh 3D"))
    (tmp_path / "c.grey").write_bytes(content)  # known by its first line
    (tmp_path / "d.am").write_bytes(content.replace(b"Data } @1", b"Data } = @1"))
    (tmp_path / "e.am").write_bytes(content.replace(b"Parameters {", b"Parameters\n{"))
    (tmp_path / "f.am").write_bytes(content.replace(b"Data } @1", b"Data } = Linear(@1)"))
    (tmp_path / "g.am").write_bytes(
        content.replace(b"BoundingBox 1 1.1", b'A { B "}{" }\n  BoundingBox 1 1.1')
    )
    for path in tmp_path.iterdir():
        check(path, voxels)


@pytest.mark.parametrize("word", ["µm", "microns", "um"])
def test_units(tmp_path: Path, volume: np.ndarray, word: str) -> None:
    voxels = volume.astype(np.uint8)
    path = tmp_path / "s.am"
    box = "BoundingBox 0 100 0 60 0 80,"
    path.write_bytes(amira(voxels, box=box, units=f'Units {{ Coordinates "{word}" }}\n'))
    assert open_scan(path).voxel_size.to("mm").zyx == pytest.approx((0.02, 0.01, 0.01))
    path.write_bytes(amira(voxels, box=box, units=""))
    with pytest.raises(UnitError, match=r"20 x 10 x 10 \(z, y, x\) without a unit"):
        open_scan(path)
    path.write_bytes(amira(voxels, box=box, units='Units { Coordinates "furlong" }\n'))
    with pytest.raises(UnitError, match="'furlong'"):
        open_scan(path)
    path.write_bytes(amira(voxels, box=box))
    with pytest.raises(UnitError, match="outside the range of scans"):
        open_scan(path)


@pytest.mark.parametrize(
    "box", ["", "BoundingBox 0 0 0 0 0 0,", "BoundingBox 1 0 0 1 0 1,", "BoundingBox 0 nan 0 1 0 1,"]
)
def test_a_file_without_a_box_asks_for_the_voxel_size(tmp_path: Path, volume: np.ndarray, box: str) -> None:
    path = tmp_path / "s.am"
    path.write_bytes(amira(volume.astype(np.uint8), box=box))
    with pytest.raises(UnitError, match=r"s\.am"):
        open_scan(path)
    assert open_scan(path, "10 um").voxel_size.x == 10


def test_a_transformation_moves_and_turns(tmp_path: Path, volume: np.ndarray) -> None:
    path, voxels = tmp_path / "s.am", volume.astype(np.uint8)
    path.write_bytes(amira(voxels, more="TransformationMatrix 1 0 0 0 0 1 0 0 0 0 1 0 10 20 30 1,\n"))
    assert open_scan(path).origin == pytest.approx((11, 22, 33))
    path.write_bytes(amira(voxels, more="TransformationMatrix -2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1,\n"))
    scan = open_scan(path)
    np.testing.assert_array_equal(np.asarray(scan.voxels), voxels[:, :, ::-1])
    assert scan.voxel_size.x == pytest.approx(0.02)


def test_colours(tmp_path: Path, volume: np.ndarray) -> None:
    grey = np.repeat(volume.astype(np.uint8)[..., None], 3, axis=-1)
    (tmp_path / "s.am").write_bytes(amira(grey))
    check(tmp_path / "s.am", volume.astype(np.uint8))
    grey[..., 1] += 5
    (tmp_path / "s.am").write_bytes(amira(grey))
    with pytest.raises(ScanError, match="colour"):
        open_scan(tmp_path / "s.am")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [(b"# AmiraMesh", b"# Mesh", "not an AmiraMesh file"), (b"BINARY-LITTLE-ENDIAN", b"BYTES", "first line"),
     (b"Lattice 11 7 5", b"Lattice 11 7", "2 axes"), (b"Lattice 11 7 5", b"Lattice 11 7 6", "cut off"),
     (b"Lattice 11 7 5", b"Lattice 11 0 5", "contains no voxels"), (b"\n@1\n", b"\n", "no line '@1'"),
     (b"define Lattice", b"define Vertices", r"holds no voxels .* but Vertices"),
     (b'"uniform"', b'"stacked"', "stacked"),
     (b"Lattice { ushort Data } @1", b"", "declares no values"),
     (b"ushort Data", b"complex Data", "type complex"),
     (b"Data } @1", b"Data } @1\nLattice { byte Other } @2", r"2 values .*\(Data \(ushort\), Other"),
     (b"Data } @1", b"Data } @1(HxMagic,30)", "HxMagic"),
     (b"Data } @1", b"Data } @1(HxByteRLE,30)", "HxByteRLE"),
     (b"Data } @1", b"Data } @1(HxZip,30)", "damaged: its packed")],
)  # fmt: skip
def test_what_a_file_says_wrongly(
    tmp_path: Path, volume: np.ndarray, old: bytes, new: bytes, says: str
) -> None:
    content = amira(volume.astype(np.uint16))
    assert old in content
    (tmp_path / "s.am").write_bytes(content.replace(old, new))
    with pytest.raises(ScanError, match=rf"(?s)s\.am.*{says}"):
        open_scan(tmp_path / "s.am", "10 um")


@pytest.mark.parametrize("packing", ["HxZip", "HxByteRLE", None])
@pytest.mark.parametrize("cut", [1, 3, 40])
def test_cut_off_files(tmp_path: Path, volume: np.ndarray, packing: str | None, cut: int) -> None:
    content = amira((volume // 100).astype(np.uint8), packing=packing)
    (tmp_path / "s.am").write_bytes(content[: -cut - 1])
    with pytest.raises(ScanError, match=r"s\.am.*cut off"):
        open_scan(tmp_path / "s.am", "10 um")


@pytest.mark.parametrize("more", [1, 200])
@pytest.mark.parametrize("packing", ["HxZip", "HxByteRLE"])
def test_more_and_fewer_packed_voxels_than_stated(
    tmp_path: Path, volume: np.ndarray, packing: str, more: int
) -> None:
    voxels = (volume // 100).astype(np.uint8)
    packed = {"HxZip": zlib.compress, "HxByteRLE": rolled}[packing]
    head = amira(voxels, packing=packing).partition(b"@1\n")[0]
    for content, says in ((voxels.tobytes() + bytes(more), "more"), (voxels.tobytes()[:-more], "fewer")):
        parts = packed(content)
        start = head.partition(f"({packing}".encode())[0] + f"({packing},{len(parts)})\n\n".encode()
        (tmp_path / "s.am").write_bytes(start + b"# Data section follows\n@1\n" + parts + b"\n")
        with pytest.raises(ScanError, match=f"{says} packed voxels"):
            open_scan(tmp_path / "s.am", "10 um")


def test_every_flipped_bit_of_a_zipped_volume_is_noticed(tmp_path: Path, volume: np.ndarray) -> None:
    voxels = volume.astype(np.uint8)
    content = amira(voxels, packing="HxZip")
    start = content.index(b"@1\n") + 3
    path = tmp_path / "s.am"
    for bit in range(start * 8, (len(content) - 1) * 8, 5):
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        try:
            got = np.asarray(open_scan(path).voxels)
        except ScanError:
            continue
        np.testing.assert_array_equal(got, voxels)  # a bit that no voxel depends on


def test_sizes_are_checked_before_memory_is_taken(tmp_path: Path, volume: np.ndarray) -> None:
    for packing in ("HxZip", "HxByteRLE"):
        content = amira(volume.astype(np.uint8), packing=packing)
        (tmp_path / "s.am").write_bytes(content.replace(b"Lattice 11 7 5", b"Lattice 30000 30000 30000"))
        with pytest.raises(ScanError, match=r"s\.am (states|needs)"):
            open_scan(tmp_path / "s.am", "10 um")


# Labels ----------------------------------------------------------------------------------------


def materials(*names: str) -> str:
    lines = "".join(f"        {name} {{\n            Color 1 0 0,\n            Id {i}\n        }}\n"
                    for i, name in enumerate(names, 1))  # fmt: skip
    return f"Materials {{\n{lines}    }}\n"


@pytest.fixture
def labels() -> np.ndarray:
    image = np.zeros((5, 7, 11), np.uint8)
    image[1:3, 1:4, 1:4], image[1:3, 1:4, 6:9] = 1, 2
    return image


@pytest.mark.parametrize("packing", ["HxByteRLE", "HxZip", None])
def test_labels_of_single_grains(tmp_path: Path, labels: np.ndarray, packing: str | None) -> None:
    path = tmp_path / "l.am"
    for more in (
        "",
        materials("Exterior", "Grain1", "Grain2"),
        materials("Exterior", "Material_1", "material 2"),
    ):
        path.write_bytes(amira(labels, packing=packing, name="Labels", more=more))
        grains = load_labels(path)
        assert grains.table["voxels"].tolist() == [18, 18]
        assert grains.voxel_size.to("mm").x == pytest.approx(0.01)


@pytest.mark.parametrize(
    "names", [("Sand", "Water"), ("Inside", "Pore space"), ("Quartz", "Calcite", "Clay3")]
)
def test_classes_are_refused_by_name(tmp_path: Path, labels: np.ndarray, names: tuple[str, ...]) -> None:
    path = tmp_path / "l.am"
    path.write_bytes(amira(labels, name="Labels", more=materials("Exterior", *names)))
    with pytest.raises(ScanError, match=f"classes of material.*{names[0]}.*no single grains"):
        load_labels(path)
    assert open_scan(path).shape == labels.shape  # as the scan itself it opens
    path.write_bytes(amira((labels > 0).astype(np.uint8), name="Labels", more=materials("Exterior", "Sand")))
    assert len(load_labels(path).table) == 2  # a mask


@pytest.mark.parametrize("order", ["BINARY-LITTLE-ENDIAN", "ASCII"])
def test_labels_beside_their_probabilities(tmp_path: Path, labels: np.ndarray, order: str) -> None:
    content = amira(labels, order, name="Labels").replace(
        b"Labels } @1", b"Labels } @1\nLattice { byte Probability } @2"
    )
    path = tmp_path / "l.am"
    second = amira(labels * 0 + 7, order).partition(b"follows\n@1\n")[2]
    path.write_bytes(content + b"\n@2\n" + second)
    assert load_labels(path).table["voxels"].tolist() == [18, 18]
    content = content.replace(b"byte Labels } @1", b"byte Probability } @1")
    path.write_bytes(content.replace(b"byte Probability } @2", b"byte Labels } @2") + b"\n@2\n" + second)
    np.testing.assert_array_equal(np.asarray(open_scan(path).voxels), labels * 0 + 7)


def test_labels_of_a_part_lie_where_the_box_says(tmp_path: Path, rng: np.random.Generator) -> None:
    grey = ndimage.gaussian_filter(rng.standard_normal((12, 14, 16)), 2)
    whole = (grey > np.quantile(grey, 0.7)).astype(np.uint8)
    scan = (100 * whole + 50).astype(np.uint8)
    (tmp_path / "s.am").write_bytes(amira(scan, box="BoundingBox 0 0.15 0 0.13 0 0.11,"))
    part = whole[3:11, 4:13, 5:15]
    (tmp_path / "l.am").write_bytes(
        amira(part, name="Labels", box="BoundingBox 0.05 0.14 0.04 0.12 0.03 0.1,")
    )
    with pytest.warns(GrainWarning, match=r"from voxel \(3, 4, 5\)"):
        grains = load_labels(tmp_path / "l.am", open_scan(tmp_path / "s.am"))
    laid = np.zeros_like(whole)
    laid[3:11, 4:13, 5:15] = part
    np.testing.assert_array_equal(grains.labels > 0, laid > 0)


def test_a_project_finds_such_a_scan_again(tmp_path: Path, volume: np.ndarray) -> None:
    for packing in (None, "HxZip"):
        (tmp_path / "s.am").write_bytes(amira(volume.astype(np.uint16), packing=packing))
        Project.new(open_scan(tmp_path / "s.am")).save(tmp_path / "p.mbs")
        again = Project.open(tmp_path / "p.mbs").scan
        assert again is not None
        np.testing.assert_array_equal(np.asarray(again.voxels), volume)


def test_what_compiles_is_not_imported_before_it_is_needed() -> None:
    code = "import sys, mbstudio.core.scan.readers; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.skipif(os.name != "posix", reason="memory is bounded by a call of POSIX")
def test_mutated_files_are_read_or_refused(tmp_path: Path, volume: np.ndarray, labels: np.ndarray) -> None:
    more = materials("Exterior", "Grain1", "Grain2")
    files = [
        amira(volume.astype(np.uint16)), amira(volume.astype(np.float32), "ASCII"),
        amira(volume.astype(np.uint16), packing="HxZip"),
        amira(labels, packing="HxByteRLE", name="Labels", more=more),
    ]  # fmt: skip
    assert problems_of(tmp_path, [({"s.am": content}, ["s.am"]) for content in files], 200) == []


def test_a_declaration_of_one_long_word_is_refused_at_once(tmp_path: Path, volume: np.ndarray) -> None:
    """In a process with 10 s of processor: each letter once began a search of its own, for minutes."""
    content = amira(volume.astype("uint16"))
    (tmp_path / "s.am").write_bytes(content.replace(b"Lattice {", b"Lattice {" + b"N" * 400_000, 1))
    program = (
        "import resource, sys\nresource.setrlimit(resource.RLIMIT_CPU, (10, 10))\n"
        "from mbstudio.core.errors import ScanError\nfrom mbstudio.core.scan import open_scan\n"
        "try: open_scan(sys.argv[1])\nexcept ScanError as error: print(error)"
    )
    run = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "s.am")], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert "s.am" in run.stdout


def test_memory_that_runs_out_is_told_with_the_file(
    tmp_path: Path, volume: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "s.npy"
    np.save(path, volume)

    def run_out(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(np, "load", run_out)
    with pytest.raises(ScanError, match=r"s\.npy asks for more memory than there is"):
        open_scan(path, voxel_size="1 um")
