"""Files for a random hand: sound ones of every kind, and broken ones of strangers."""

from __future__ import annotations

import shutil
from pathlib import Path
from random import Random

import h5py
import numpy as np
import tifffile
import trimesh

from mbstudio.core.grains import load_labels
from mbstudio.core.imaging import fit
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.core.vae.models.training import learn
from tests.core.vae.boxes import boxes

SIDE = 40


def _labels(side: int = SIDE) -> np.ndarray:
    z, y, x = np.ogrid[:side, :side, :side]
    labels = np.zeros((side,) * 3, np.int32)
    places = ((11, 11, 11), (11, 29, 28), (29, 12, 28), (29, 28, 11), (37, 38, 37))
    for number, (k, j, i) in enumerate(places, 1):
        labels[((z - k) / 8) ** 2 + ((y - j) / 9) ** 2 + ((x - i) / 7) ** 2 <= 1] = number
    return labels


class Files:
    """A folder with files to open, and one to write to.

    Attributes
    ----------
    sound, broken : list of list of Path
        What is opened together.
    project : Path
        A project with a scan, grains, avatars and a style.
    out : Path
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder = folder
        self.out = folder / "out"
        for part in (folder, self.out):
            part.mkdir(parents=True, exist_ok=True)
        self.sound: list[list[Path]] = []
        self.broken: list[list[Path]] = []
        self.project = self._project()
        self._whole = self.project.read_bytes()
        self._scans()
        self._meshes()
        self.style = folder / "style"
        learn(boxes(12, np.random.default_rng(2)), preset="pca", seed=0).save(self.style)
        self._broken(Random(seed))

    def _project(self) -> Path:
        labels = _labels()
        noise = np.random.default_rng(3).normal(0, 500, labels.shape)
        self._grey = (np.where(labels, 30_000, 9_000) + noise).astype(np.uint16)
        self.scan = self._folder / "grains.tif"
        tifffile.imwrite(self.scan, self._grey)
        grains = load_labels(labels, voxel_size="14 um")
        project = Project.new(Scan(self._grey, VoxelSize.parse("14 um"), path=self.scan))
        project.change("Load labels", grains=grains)
        project.add_fits({label: fit(grains.grain(label), 8, seed=0) for label in (1, 2, 3)})
        path = project.save(self._folder / "grains.mbs")
        project.close()
        plain = Project(ProjectState(grains=grains))
        other = plain.save(self._folder / "without-scan.mbs")
        plain.close()
        self.sound += [[path], [path], [other]]
        return path

    def _scans(self) -> None:
        labels = self._folder / "labels.tif"
        tifffile.imwrite(labels, _labels().astype(np.uint16))
        self.labels = labels
        np.save(self._folder / "grains.npy", self._grey)
        self._grey.tofile(self._folder / "grains_40x40x40_14um.raw")
        with h5py.File(self._folder / "two.h5", "w") as file:
            for name in ("a", "b"):
                file.create_dataset(name, data=self._grey, compression="gzip", chunks=(8, 40, 40))
        with h5py.File(self._folder / "one.h5", "w") as file:
            one = file.create_dataset("exported_data", data=self._grey, compression="gzip")
            one.attrs["element_size_um"] = (14.0, 14.0, 14.0)
        slices = self._folder / "slices"
        slices.mkdir(exist_ok=True)
        for number, picture in enumerate(self._grey):
            tifffile.imwrite(slices / f"s_{number:03d}.tif", picture)
        names = (
            "grains.tif",
            "labels.tif",
            "grains.npy",
            "grains_40x40x40_14um.raw",
            "two.h5",
            "one.h5",
            "slices",
        )
        self.sound += [[self._folder / name] for name in names]

    def _meshes(self) -> None:
        found = []
        for number in range(3):
            body = trimesh.creation.icosphere(subdivisions=2, radius=100.0)
            body.apply_scale((1.0, 0.8, 0.6 + 0.1 * number))
            path = self._folder / f"stone_{number}.stl"
            body.export(path)
            found.append(path)
        self.meshes = found
        self.sound += [found, found[:1]]

    def _broken(self, random: Random) -> None:
        """Cut, flip and mix up copies of the sound files; add what no program writes."""
        folder = self._folder / "broken"
        folder.mkdir(exist_ok=True)
        for paths in [*self.sound]:
            for path in paths:
                if path.is_dir():
                    continue
                content = bytearray(path.read_bytes())
                cut = folder / f"cut-{path.name}"
                cut.write_bytes(content[: random.randrange(1, len(content))])
                for _ in range(3):
                    content[random.randrange(len(content))] ^= 1 << random.randrange(8)
                flipped = folder / f"flipped-{path.name}"
                flipped.write_bytes(content)
                noise = folder / f"noise-{path.name}"
                noise.write_bytes(random.randbytes(5000))
                self.broken += [[cut], [flipped], [noise]]
        for name in ("empty.tif", "empty.mbs", "empty.stl", "empty.h5", "empty.raw"):
            (folder / name).touch()
            self.broken.append([folder / name])
        (folder / "empty folder").mkdir(exist_ok=True)
        self.broken += [
            [folder / "empty folder"],
            [folder / "nowhere.tif"],
            [folder / "nowhere.mbs"],
            [self.scan, self.project],
            [*self.meshes, self.scan],
            [folder],
        ]
        broken_style = folder / "style"
        shutil.copytree(self.style, broken_style, dirs_exist_ok=True)
        for path in broken_style.iterdir():
            content = bytearray(path.read_bytes())
            content[random.randrange(len(content))] ^= 4
            path.write_bytes(content)
        self.broken_style = broken_style

    def restore(self) -> Path:
        """Return the project as it was at first: a window may have saved over it."""
        if self.project.read_bytes() != self._whole:
            self.project.write_bytes(self._whole)
        return self.project

    # ---- answers to dialogs ----------------------------------------------------------------------

    def some(self, random: Random) -> list[Path]:
        """Return files to open, broken ones now and then."""
        return random.choice(self.broken if random.random() < 0.35 else self.sound)

    def some_folder(self, random: Random) -> str:
        """Return a folder, as a dialog answers; nothing when it is cancelled."""
        new = self.out / f"folder {random.randrange(20)}"
        given = (
            self.style,
            self.style,
            self.broken_style,
            self._folder / "slices",
            new,
            self.out,
            self._folder / "nowhere",
            self.scan,
        )
        return "" if random.random() < 0.15 else str(random.choice(given))

    def some_target(self, random: Random, suggested: str) -> str:
        """Return a file to write to, as a dialog answers; some cannot be written."""
        name = Path(suggested).name or "file"
        stem, ending = Path(name).stem, Path(name).suffix
        given = (
            self.out / name,
            self.out / f"{stem} {random.randrange(5)}{ending}",
            self.out / stem,
            self.out / f"{stem}.xyz",
            self._folder / "nowhere" / name,
            self.out,
        )
        return "" if random.random() < 0.15 else str(random.choice(given))
