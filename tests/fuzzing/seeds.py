"""A few small whole files of every kind that mbstudio reads, for the harness to damage."""

from __future__ import annotations

import csv
import gzip
import io
import json
from collections.abc import Callable
from pathlib import Path

import h5py
import imageio.v3 as iio
import nibabel
import numpy as np
import tifffile
import trimesh
import zarr
from pydicom import uid

from mbstudio.core.metaball import Avatar
from tests.core.meshes.mesh_writing import binary_stl, gltf_of, write_3mf, write_obj
from tests.core.project.conftest import ANISOTROPIC, make_fit
from tests.core.scan.readers import (
    test_amira,
    test_dicom,
    test_ome_zarr,
    test_side_cars,
    test_vtk_image,
    test_xradia,
)
from tests.core.scan.readers.ole_writer import ole_file
from tests.core.vae.populations import population
from tests.fuzzing.harness import Case, cases_of_folder

LABELS = np.zeros((6, 9, 10), np.uint16)
LABELS[1:4, 1:4, 1:5], LABELS[2:5, 5:8, 5:9] = 1, 2


def _volume() -> np.ndarray:
    return np.random.default_rng(5).integers(0, 60_000, (5, 7, 11)).astype("<u2")


def tiff(voxels: np.ndarray, **options: object) -> bytes:
    """Return a TIFF file."""
    stream = io.BytesIO()
    tifffile.imwrite(stream, voxels, **options)
    return stream.getvalue()


def _tiff(_: Path) -> list[Case]:
    volume = _volume()
    imagej = {
        "imagej": True,
        "resolution": (0.1, 0.1),
        "metadata": {"unit": "um", "spacing": 2.0, "axes": "ZYX"},
    }
    return [
        ({"s.tif": tiff(volume, compression="zlib", predictor=True)}, ["s.tif"]),
        ({"s.tif": tiff(volume, **imagej)}, ["s.tif"]),
        ({"s.tif": tiff(volume, ome=True, metadata={"axes": "ZYX"})}, ["s.tif"]),
        ({f"z{i}.tif": tiff(image, compression="zlib") for i, image in enumerate(volume)}, ["."]),
    ]


def _pictures(_: Path) -> list[Case]:
    log = b"[Reconstruction]\nPixel Size (um)=14.1\n[Acquisition]\nImage Pixel Size (um)=12.0\n"
    volume = _volume().astype(np.uint8)
    cases: list[Case] = []
    for ending in (".png", ".bmp", ".jpg"):
        files = {
            f"z{i}{ending}": iio.imwrite("<bytes>", image, extension=ending) for i, image in enumerate(volume)
        }
        cases.append(({**files, "z.log": log}, ["."]))
    return cases


def _png(_: Path) -> list[Case]:
    """Slices of 8 and 16 bits; PNG has a checksum for each of its parts."""
    return [
        (
            {f"z{i}.png": iio.imwrite("<bytes>", image, extension=".png") for i, image in enumerate(volume)},
            ["."],
        )
        for volume in (_volume().astype(np.uint8), _volume())
    ]


def _arrays(_: Path) -> list[Case]:
    cases: list[Case] = []
    for voxels in (_volume(), _volume().astype(">f4"), np.asfortranarray(_volume())):
        plain = io.BytesIO()
        np.save(plain, voxels)
        cases.append(({"s.npy": plain.getvalue()}, ["s.npy"]))
    return cases


def _hdf5(folder: Path) -> list[Case]:
    cases: list[Case] = []
    for name, options in (("a.h5", {}), ("b.h5", {"compression": "gzip", "chunks": (2, 4, 4)})):
        with h5py.File(folder / name, "w") as file:
            file.create_dataset("exported_data", data=_volume(), **options)
        cases.append(({"s.h5": (folder / name).read_bytes()}, ["s.h5"]))
    with h5py.File(folder / "c.nxs", "w", libver="latest") as file:
        file.attrs["default"] = "entry"
        group = file.create_group("entry")
        group.attrs["signal"], group.attrs["axes"] = "data", ["z", "y", "x"]
        group.create_dataset("data", data=_volume(), chunks=(5, 7, 4), compression="gzip", shuffle=True)
        for axis, count in zip("zyx", _volume().shape, strict=True):
            group[axis] = np.arange(count) * 1e-5
            group[axis].attrs["units"] = "m"
    cases.append(({"s.nxs": (folder / "c.nxs").read_bytes()}, ["s.nxs"]))
    return cases


def _headers(_: Path) -> list[Case]:
    volume = _volume()
    raw, packed = volume.tobytes(), gzip.compress(volume.tobytes())
    said = "ElementSpacing = 0.01 0.01 0.02\nOffset = 1 2 3\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n"
    head = "ObjectType = Image\nNDims = 3\nDimSize = 11 7 5\nElementType = MET_USHORT\n" + said
    slices = {f"z{i + 1:03d}.raw": image.tobytes() for i, image in enumerate(volume)}
    nrrd = "NRRD0004\ntype: uint16\nendian: little\ndimension: 3\nsizes: 11 7 5\n"
    text = 'encoding: ascii\nspacings: 1 1 2\nunits: "um" "um" "um"\n\n'
    return [
        ({"s.mha": (head + "ElementDataFile = LOCAL\n").encode() + raw}, ["s.mha"]),
        ({"s.mhd": (head + "ElementDataFile = z%03d.raw 1 5 1\n").encode(), **slices}, ["s.mhd"]),
        ({"s.nrrd": (nrrd + text).encode() + " ".join(map(str, volume.ravel())).encode()}, ["s.nrrd"]),
        ({"s.nrrd": (nrrd + "encoding: gzip\n\n").encode() + packed}, ["s.nrrd"]),
        ({"s.nhdr": (nrrd + "encoding: raw\ndata file: z%03d.raw 1 5 1\n\n").encode(), **slices}, ["s.nhdr"]),
    ]


def _gzip(folder: Path) -> list[Case]:
    """Scans that are packed as a whole: gzip has a checksum."""
    for name, kind in (("a.nii.gz", nibabel.Nifti1Image), ("b.nii.gz", nibabel.Nifti2Image)):
        image = kind(_volume().T.astype(np.int16), np.diag([0.1, 0.1, 0.1, 1]))
        image.header.set_xyzt_units("mm")
        image.to_filename(folder / name)
    return cases_of_folder(folder)


def _nifti(folder: Path) -> list[Case]:
    for name, kind in (
        ("a.nii", nibabel.Nifti1Image),
        ("b.nii.gz", nibabel.Nifti1Image),
        ("c.nii", nibabel.Nifti2Image),
    ):
        image = kind(_volume().T.astype(np.int16), np.diag([0.1, 0.1, 0.1, 1]))
        image.header.set_xyzt_units("mm")
        image.to_filename(folder / name)
    return cases_of_folder(folder)


def _dicom(folder: Path) -> list[Case]:
    volume = _volume()
    test_dicom.write_series(folder / "a", volume[:3])
    test_dicom.write_series(
        folder / "b", volume[:2], change=lambda k, one: test_dicom.pack(one, volume[k], uid.JPEGLSLossless)
    )
    test_dicom.write_series(
        folder / "c", volume[:2], change=lambda k, one: test_dicom.pack(one, volume[k], uid.RLELossless)
    )
    test_dicom.save(test_dicom.enhanced(volume, range(5)), folder / "d.dcm")
    return cases_of_folder(folder)


def _vtk(folder: Path) -> list[Case]:
    for mode, packer in (
        ("Ascii", "None"),
        ("Raw", "None"),
        ("Raw", "LZ4"),
        ("Binary", "LZMA"),
        ("Appended", "ZLib"),
    ):
        test_vtk_image.write(
            folder / f"{mode}{packer}.vti", {"grey": _volume()}, mode=mode, packer=packer, block=256
        )
    return cases_of_folder(folder)


def _zarr(folder: Path) -> list[Case]:
    test_ome_zarr.write_image(folder / "b.zarr", _volume(), 3, chunks=(4, 4, 4), shards=(8, 8, 12))
    test_ome_zarr.write_image(
        folder / "c.zarr", _volume(), 2, compressors=test_ome_zarr.numcodecs.GZip(), chunks=(9, 7, 11)
    )
    test_ome_zarr.shutil.make_archive(str(folder / "d.zarr"), "zip", folder / "b.zarr")
    zarr.open_group(folder / "b.zarr", mode="r")
    return cases_of_folder(folder)


def _xradia(_: Path) -> list[Case]:
    voxels = np.random.default_rng(5).integers(0, 60_000, (6, 40, 50)).astype(np.uint16)
    return [
        ({"s.txm": ole_file(test_xradia.txm(voxels[:3]), 2)}, ["s.txm"]),
        ({"s.txm": ole_file(test_xradia.txm(voxels[:3, :5, :7]))}, ["s.txm"]),
    ]


def _side_cars(_: Path) -> list[Case]:
    volume, texts = _volume(), test_side_cars
    cases = [
        ({"s.vol": "<u2", "s.vgi": texts.VGI}, ["s.vol", "s.vgi"]),
        ({"s.vol": "<f4", "s.xtekct": texts.XTEK}, ["s.vol", "s.xtekct"]),
        ({"s.vol": "<u2", "s.pcr": texts.PCR}, ["s.vol", "s.pcr"]),
        ({"s.vol": "<f4", "s.vol.info": texts.INFO}, ["s.vol"]),
        ({"s.raw": "<u2", "s.hdr": texts.ENVI}, ["s.raw"]),
        ({"s.raw": "<u2", "s.dat": texts.VOREEN}, ["s.raw", "s.dat"]),
    ]
    return [
        ({n: volume.astype(w).tobytes() if w[0] == "<" else w.encode() for n, w in files.items()}, opened)
        for files, opened in cases
    ]


def _amira(_: Path) -> list[Case]:
    volume = _volume()
    more = test_amira.materials("Exterior", "Grain1", "Grain2")
    files = [
        test_amira.amira(volume),
        test_amira.amira(volume.astype(np.float32), "ASCII"),
        test_amira.amira(volume, packing="HxZip"),
        test_amira.amira(LABELS.astype(np.uint8), packing="HxByteRLE", name="Labels", more=more),
    ]
    return [({"s.am": content}, ["s.am"]) for content in files]


def _label_images(_: Path) -> list[Case]:
    plain = io.BytesIO()
    np.save(plain, LABELS)
    return [
        ({"l.tif": tiff(LABELS, compression="zlib")}, ["l.tif"]),
        ({"l.tif": tiff(LABELS.astype("f4"))}, ["l.tif"]),
        ({"l.npy": plain.getvalue()}, ["l.npy"]),
    ]


def _meshes(folder: Path) -> list[Case]:
    ball = trimesh.creation.icosphere(1)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    (folder / "a.stl").write_bytes(binary_stl(vertices[faces]))
    (folder / "b.stl").write_text(trimesh.exchange.stl.export_stl_ascii(ball))
    write_obj(folder / "c.obj", vertices, faces)
    for name, options in (("d.ply", {}), ("e.ply", {"encoding": "ascii"}), ("f.off", {}), ("g.glb", {})):
        ball.export(folder / name, **options)
    write_3mf(folder / "h.3mf", [(vertices, faces)])
    cases = cases_of_folder(folder)
    text, buffer = gltf_of(vertices, faces, "g.bin")
    return [*cases, ({"i.gltf": text.encode(), "g.bin": buffer}, ["i.gltf"])]


def _old_projects(_: Path) -> list[Case]:
    formats = Path(__file__).resolve().parents[1] / "core" / "project" / "formats"
    return [
        ({"p.mbs": gzip.decompress((formats / f"{name}.mbs.gz").read_bytes())}, ["p.mbs"])
        for name in ("format-1", "format-2", "format-3", "format-4")
    ]


def _projects(_: Path) -> list[Case]:
    formats = Path(__file__).resolve().parents[1] / "core" / "project" / "formats"
    return [
        ({"p.mbs": gzip.decompress((formats / f"{name}.mbs.gz").read_bytes())}, ["p.mbs"])
        for name in ("format-3-sealed", "format-5")
    ]


def _journals(folder: Path) -> list[Case]:
    from mbstudio.core.project.fit_journal import FitJournal, Origin

    rng = np.random.default_rng(1)
    journal = FitJournal(folder / "p.mbs.journal", Origin("", "0" * 64), {2: make_fit(2, 3, rng)}, {})
    for label in (3, 4):
        journal.keep(label, make_fit(label, 4, rng))
    journal.close()
    return [({"p.mbs.journal": (folder / "p.mbs.journal").read_bytes()}, ["p.mbs.journal"])]


def _styles(folder: Path) -> list[Case]:
    from mbstudio.core.vae.models.training import learn

    for preset, options in (
        ("pca", {}),
        ("aligned", {"steps": 4, "record_every": 2, "batch": 8, "latents": 6}),
    ):
        learn(population(12), preset, **options).save(folder / preset)
    return cases_of_folder(folder)


def _unsealed_styles(folder: Path) -> list[Case]:
    return _without_seals(_styles(folder))


def _without_seals(cases: list[Case]) -> list[Case]:
    for files, _ in cases:
        for name, content in files.items():
            if name.endswith(".json"):
                entries = json.loads(content)
                del entries["seal"]
                files[name] = json.dumps(entries).encode()
    return cases


def _surface_styles(folder: Path) -> list[Case]:
    from mbstudio.core.cloning.parent_avatars import fit_parents
    from mbstudio.core.cloning.surface_style import learn_surfaces
    from mbstudio.core.cloning.surface_style_file import save_surface_style
    from tests.core.cloning.conftest import make_stone

    save_surface_style(
        fit_parents(learn_surfaces([make_stone(0, 2), make_stone(1, 2)]), 3), folder / "stones"
    )
    return cases_of_folder(folder)


def _unsealed_surface_styles(folder: Path) -> list[Case]:
    return _without_seals(_surface_styles(folder))


def _serializations(folder: Path) -> list[Case]:
    from mbstudio.core.vae.serialize.serialization import save_serialization

    save_serialization(population(5), folder / "parents.npz")
    return cases_of_folder(folder)


def _recipe_files(_: Path) -> list[Case]:
    from mbstudio.core.vae.shaping.latent_recipe import Operation, Recipe

    steps = (
        Operation("begin", {"parent": "p0-1"}, "p0-1"),
        Operation("component", {"component": 2, "to": 0.5}, "z3"),
    )
    recipes = [Recipe(name, (0.1, -0.25, 1e-3), steps, "abc").as_record() for name in ("one", "two")]
    return [({"recipes.json": json.dumps(recipes, indent=1).encode()}, ["recipes.json"])]


def _latent_tables(_: Path) -> list[Case]:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow(["name", "dn_mm", "csf", "recipe", "z1", "z2", "z3"])
    for number in range(4):
        writer.writerow([f"moved_{number}", 0.4, 0.6, "a morph, in steps", 0.1 * number, -0.2, 1e-5])
    return [({"latents.csv": stream.getvalue().encode()}, ["latents.csv"])]


def _sweeps(folder: Path) -> list[Case]:
    from mbstudio.core.imaging.sweep import SweepRow, write_sweep

    rows = [
        SweepRow(
            1,
            "grain 1",
            n,
            "fast",
            0,
            0.1,
            0.02,
            0.01,
            0.9,
            0.1,
            {"csf": 0.01},
            True,
            2.0,
            "",
            {"hull": "mesh"},
        )
        for n in (10, 20)
    ]
    write_sweep(folder / "sweep.csv", rows)
    return cases_of_folder(folder)


def _avatar() -> Avatar:
    rng = np.random.default_rng(3)
    return Avatar(rng.normal(size=(6, 3)) * 0.3, rng.uniform(0.1, 0.2, 6), "mm", label=3, name="pebble")


def _avatars(folder: Path) -> list[Case]:
    from mbstudio.core.dem import export

    export([_avatar()], "metaball", folder / "out", density=2650.0)
    files = {path.name: path.read_bytes() for path in sorted((folder / "out").glob("pebble*"))}
    names = [name for name in files if name.endswith((".json", ".csv"))]
    return [(files, names)]


def _exports(folder: Path) -> list[Case]:
    from mbstudio.core.dem import export, targets

    for target in targets():
        export([_avatar()], target, folder / target, density=2650.0)
    return cases_of_folder(folder)


def _autosaves(folder: Path) -> list[Case]:
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.grains.labelling import build_grain_set
    from mbstudio.core.project import ProjectState
    from mbstudio.core.project.autosave import Autosave

    grains: GrainSet = build_grain_set(LABELS.astype(np.int32), ANISOTROPIC, (0.0, 0.0, 0.0))
    saved = Autosave.begin(folder)
    fits = {2: make_fit(2, 3, np.random.default_rng(1))}
    saved.write(ProjectState(grains=grains).with_fits(fits))
    saved.release()
    files = {f"root/work/{path.name}": path.read_bytes() for path in saved.folder.iterdir()}
    return [(files, ["root/work"])]


def _classifiers(folder: Path) -> list[Case]:
    from mbstudio.core.grains.classifying import Stroke, VoxelClassifier
    from mbstudio.core.scan.scan import Scan
    from mbstudio.core.units import VoxelSize

    rng = np.random.default_rng(8)
    inside = np.square(np.indices((8, 20, 20)) - np.array([4, 10, 10])[:, None, None, None]).sum(0) < 16
    scan = Scan(
        (1000 + 3000 * inside + rng.normal(0, 100, inside.shape)).astype(np.uint16), VoxelSize(1, 1, 1, "um")
    )
    strokes = [Stroke("grain", ((4, 10, 8), (4, 10, 12)), 1.0), Stroke("void", ((4, 2, 2), (4, 2, 17)), 1.0)]
    VoxelClassifier.learned(scan, strokes, trees=3).save(folder / "sand.mbclf")
    return cases_of_folder(folder)


def _clumps(folder: Path) -> list[Case]:
    from mbstudio.core.dem import export

    export([_avatar()], "liggghts", folder / "out", density=2650.0)
    rows = {path.name: path.read_bytes() for path in sorted((folder / "out").glob("*.multisphere"))}
    return [(rows, sorted(rows))]


def _dumps(folder: Path) -> list[Case]:
    rng = np.random.default_rng(9)

    def frame(step: int, columns: str, bounds: str) -> str:
        rows = [
            f"{number} 1 {' '.join(f'{x:.6g}' for x in rng.normal(size=3))}"
            for number in rng.permutation(12) + 1
        ]
        box = "\n".join(["-1.0 1.0"] * 3)
        return (
            f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{len(rows)}\n{bounds}\n{box}\n"
            f"ITEM: ATOMS id type {columns}\n" + "\n".join(rows) + "\n"
        )

    cases = []
    for name, columns, bounds in (
        ("unwrapped", "xu yu zu", "ITEM: BOX BOUNDS ff ff ff"),
        ("periodic", "x y z", "ITEM: BOX BOUNDS pp pp ff"),
        ("old", "x y z", "ITEM: BOX BOUNDS"),
    ):
        text = frame(0, columns, bounds) + frame(1000, columns, bounds)
        cases.append(({f"{name}.lammpstrj": text.encode()}, [f"{name}.lammpstrj"]))
    return cases


def _poses(folder: Path) -> list[Case]:
    text = "avatar,scale,x,y,z,qw,qx,qy,qz\nball,1,0,0,0,1,0,0,0\nstone,0.5,1,2,3,0.5,0.5,0.5,0.5\n"
    return [({"poses.csv": text.encode()}, ["poses.csv"])]


Seeds = Callable[[Path], list[Case]]
SEEDS: dict[str, tuple[str, Seeds]] = {
    "tiff": ("scan", _tiff),
    "pictures": ("scan", _pictures),
    "png": ("scan", _png),
    "gzip": ("scan", _gzip),
    "npy": ("scan", _arrays),
    "hdf5": ("hdf5", _hdf5),
    "metaimage-nrrd": ("scan", _headers),
    "nifti": ("scan", _nifti),
    "dicom": ("scan", _dicom),
    "vtk": ("scan", _vtk),
    "zarr": ("scan", _zarr),
    "xradia": ("scan", _xradia),
    "side-cars": ("scan", _side_cars),
    "amira": ("scan", _amira),
    "labels": ("labels", _label_images),
    "meshes": ("mesh", _meshes),
    "projects": ("project", _projects),
    "old-projects": ("project", _old_projects),
    "journals": ("journal", _journals),
    "styles": ("style", _styles),
    "unsealed-styles": ("style", _unsealed_styles),
    "surface-styles": ("surface style", _surface_styles),
    "unsealed-surface-styles": ("surface style", _unsealed_surface_styles),
    "old-projects-here": ("project read here", _old_projects),
    "serializations": ("serialization", _serializations),
    "recipes": ("recipes", _recipe_files),
    "latents": ("latents", _latent_tables),
    "sweeps": ("sweep", _sweeps),
    "avatars": ("avatar", _avatars),
    "exports": ("export", _exports),
    "autosaves": ("autosave", _autosaves),
    "classifiers": ("classifier", _classifiers),
    "unsealed-classifiers": ("classifier sealed anew", _classifiers),
    "clumps": ("clump", _clumps),
    "dumps": ("dump", _dumps),
    "poses": ("poses", _poses),
}
"""What is attacked: the reader of each kind of file, and what makes whole files of it."""

CHECKSUMMED = (
    "projects",
    "styles",
    "surface-styles",
    "serializations",
    "autosaves",
    "classifiers",
    "gzip",
    "png",
)
"""Kinds of file in which no flipped bit may pass unseen."""
