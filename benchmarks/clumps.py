"""Sphere clumps of mbstudio's export against those of two packages; prints Markdown tables.

Usage: python benchmarks/clumps.py [--n 10 40 100] [--python PYTHON]
       python benchmarks/clumps.py --avatars [--quick] [--grains 3] [--python PYTHON]

Needs the packages multisphere and clump-python, which mbstudio itself does not use: install the
extra `benchmark`, or give with --python the interpreter of an environment that holds them. They
run in a process of their own. Of each package the best of several settings counts: `multisphere`
with least distances of centres of 2 and 4 voxels, without smallest radius; `CLUMP` (Euclidean
map) with overlaps of 0, 0.4, 0.6 and 0.8. `ours` is the sphere clump of mbstudio's export.

The first form takes 20 real grains of ../shared/data. All three methods get the same body, the avatar
of the grain: ours as its control points, `multisphere` as voxels (100 along the longest side), `CLUMP`
as a mesh. All are judged by one count on voxels (150 along the longest side) with the centres of mass
laid together: IoU (intersection over union), error of the volume, and error of the inertia tensor at
equal mass (Frobenius norms). For each figure by itself the best setting of a package counts.

The second form says how much of a grain avatars cover, and clumps of as many spheres, on synthetic
grains. In favour of the clumps, each is moved by up to two voxels to where its IoU is best.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import trimesh
from grain_kinds import KnownGrain, synthetic

from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit
from mbstudio.core.metaball import Avatar

PAD = 6
DATA = Path(__file__).resolve().parent.parent / ".." / "shared" / "data"
REAL = (("aggregates", "mm", 4, 12), ("cement", "um", 4, 6), ("stones", "mm", 1, 2))
"""Folder, unit, every how manieth file, and how many grains of each kind."""
FIGURES = ("IoU", "volume", "inertia")

# Runs in the environment of the clump packages: voxels and mesh in, spheres of every method out.
WORK = """
import contextlib, io, sys, time
import numpy as np
folder, numbers = sys.argv[1], [int(word) for word in sys.argv[2:]]
mask = np.load(folder + "/mask.npy")  # [x, y, z], voxels of edge 1
found = {}

def keep(method, setting, n, spheres, begin):
    found[f"{method}|{setting}|{n}"] = np.array(spheres, dtype=float)
    found[f"{method}|{setting}|{n}|cpu"] = time.process_time() - begin

import multisphere
for distance in (2, 4):
    for n in numbers:
        begin = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            pack = multisphere.multisphere_from_voxels(
                multisphere.VoxelGrid(mask, voxel_size=1.0, origin=np.zeros(3)),
                min_radius_vox=1, min_center_distance_vox=distance, max_spheres=n,
            )
        keep("multisphere", distance, n, np.column_stack([pack.centers, pack.radii]), begin)

import trimesh
from CLUMP import GenerateClump_Euclidean_3D
middle = trimesh.load(folder + "/grain.stl").bounds.mean(axis=0)  # CLUMP works about it
for overlap in (0.0, 0.4, 0.6, 0.8):
    begin = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        clump = GenerateClump_Euclidean_3D(folder + "/grain.stl", max(numbers), 0.0, 60, overlap)[1]
    spheres = np.column_stack([clump.positions + middle, np.ravel(clump.radii)])
    for n in numbers:  # one sphere after the other: fewer are the first of many
        keep("CLUMP", overlap, n, spheres[:n], begin)
np.savez(folder + "/spheres.npz", **found)
"""


def clumps_of_others(grain: Grain, numbers: list[int], python: str) -> dict[str, np.ndarray]:
    """Return spheres (x, y, z, r) in voxels by ``method|setting|n``, and CPU seconds."""
    mesh = grain.surface_mesh().copy()
    mesh.apply_translation(-np.asarray(grain.origin))
    mesh.apply_scale(1 / grain.voxel_size.xyz[0])
    return spheres_of_others(np.asarray(grain.mask), mesh, numbers, python)


def spheres_of_others(
    mask: np.ndarray, mesh: trimesh.Trimesh, numbers: list[int], python: str
) -> dict[str, np.ndarray]:
    """Return the same of a mask [z, y, x] and the mesh of the same body, both in voxels."""
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "mask.npy", np.pad(mask, 2).transpose(2, 1, 0))
        mesh.export(Path(folder) / "grain.stl")
        subprocess.run(
            [python, "-W", "ignore", "-c", WORK, folder, *map(str, numbers)],
            check=True,
            env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        )
        with np.load(Path(folder) / "spheres.npz") as loaded:
            found = {key: loaded[key] for key in loaded.files}
    for key, value in found.items():
        if key.startswith("multisphere") and not key.endswith("cpu"):
            value[:, :3] -= 2  # the padding
    return found


def sphere_iou(mask: np.ndarray, spheres: np.ndarray, shift: np.ndarray | None = None) -> float:
    """Return the IoU of a padded mask [z, y, x] and spheres in voxels of the mask without padding."""
    covered = np.zeros(mask.shape, dtype=bool)
    for x, y, z, r in spheres + (0 if shift is None else np.append(shift, 0.0)):
        paint(covered, np.array([z, y, x]) + PAD, r)
    return float((covered & mask).sum() / (covered | mask).sum())


def paint(covered: np.ndarray, place: np.ndarray, radius: float) -> None:
    """Cover the voxels [z, y, x] of a sphere."""
    low = np.clip(np.floor(place - radius).astype(int), 0, covered.shape)
    high = np.clip(np.ceil(place + radius).astype(int) + 1, 0, covered.shape)
    axes = [(np.arange(a, b) - c) ** 2 for a, b, c in zip(low, high, place, strict=True)]
    inside = axes[0][:, None, None] + axes[1][:, None] + axes[2] <= radius**2
    covered[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] |= inside


def best_sphere_iou(mask: np.ndarray, spheres: np.ndarray) -> float:
    """Return the IoU at the best of shifts of up to two voxels along each axis."""
    shift, best = np.zeros(3), sphere_iou(mask, spheres)
    for step in (1.0, 0.5):
        for axis in range(3):
            for sign in (-1, 1):
                trial = shift.copy()
                trial[axis] = np.clip(trial[axis] + sign * step, -2, 2)
                found = sphere_iou(mask, spheres, trial)
                if found > best:
                    best, shift = found, trial
    return best


def avatar_iou(grain: Grain, mask: np.ndarray, avatar: Avatar) -> float:
    """Return the IoU of a padded mask and an avatar, at the centres of the voxels."""
    index = np.stack(np.meshgrid(*map(np.arange, mask.shape), indexing="ij"), axis=-1).reshape(-1, 3)
    points = (index[:, ::-1] - PAD) * grain.voxel_size.xyz + np.asarray(grain.origin)
    inside = avatar.contains(points).reshape(mask.shape)
    return float((inside & mask).sum() / (inside | mask).sum())


def compare(known: KnownGrain, numbers: list[int], python: str) -> list[dict[str, float]]:
    """Return IoU by method, and CPU seconds, for each number of control points or spheres."""
    grain = known.grain
    mask = np.pad(np.asarray(grain.mask), PAD)
    others = clumps_of_others(grain, numbers, python)
    full = fit(grain, 120).avatar
    rows = []
    for n in numbers:
        begin = time.process_time()
        avatar = fit(grain, n).avatar
        row = {"n": float(n), "cpu": time.process_time() - begin, "avatar": avatar_iou(grain, mask, avatar)}
        own = sphere_clump(full, n)
        places = (own.centers - np.asarray(grain.origin)) / grain.voxel_size.xyz
        row["ours"] = best_sphere_iou(mask, np.column_stack([places, own.radii / grain.voxel_size.xyz[0]]))
        for method in ("multisphere", "CLUMP"):
            keys = [key for key in others if key.startswith(method) and key.endswith(f"|{n}")]
            row[method] = max(best_sphere_iou(mask, others[key]) for key in keys)
            row[f"{method} cpu"] = min(float(others[f"{key}|cpu"]) for key in keys)
        rows.append(row)
    return rows


# ---- real grains ---------------------------------------------------------------------------------


def real_grains() -> list[tuple[str, Grain]]:
    """Return 20 real grains by name, as voxels."""
    found = []
    for folder, unit, every, count in REAL:
        closed = [
            (path, mesh)
            for path in sorted((DATA / folder).glob("*.ply"))[::every]
            if (mesh := trimesh.load(path)).is_watertight
        ]
        for path, mesh in closed[:count]:
            found.append((path.stem, Grain.from_mesh(mesh, 100, unit)))
    return found


class Judge:
    """Voxels of an avatar in the frame of the judging: the unit is a voxel of 100 along the longest side."""

    def __init__(self, avatar: Avatar) -> None:
        low, high = avatar.bounds()
        self.origin, self.voxel = low, float((high - low).max()) / 100
        self.avatar = avatar
        self.mask = self._inside(1.0)
        self.step = 100 / 150
        self.fine = self._inside(self.step, margin=12)
        self.low = -12 * self.step

    def _inside(self, step: float, margin: int = 0) -> np.ndarray:
        """Return whether the middles of voxels [z, y, x] of so many hundredths lie inside."""
        low, high = self.avatar.bounds()
        counts = np.ceil((high - low) / (step * self.voxel)).astype(int) + 1 + 2 * margin
        axes = [
            start + self.voxel * step * (np.arange(n) - margin) for start, n in zip(low, counts, strict=True)
        ]
        inside = np.empty(counts[::-1], dtype=bool)
        for layer, z in enumerate(axes[2]):
            y, x = np.meshgrid(axes[1], axes[0], indexing="ij")
            points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])
            inside[layer] = self.avatar.contains(points).reshape(x.shape)
        return inside

    def mesh(self) -> trimesh.Trimesh:
        """Return the avatar's surface in voxels."""
        mesh = self.avatar.mesh(cells=100).copy()
        mesh.apply_translation(-self.origin)
        mesh.apply_scale(1 / self.voxel)
        return mesh

    def rows(self, clump: Clump) -> np.ndarray:
        """Return x, y, z, r of a clump in voxels."""
        return np.column_stack([(clump.centers - self.origin) / self.voxel, clump.radii / self.voxel])

    def figures(self, spheres: np.ndarray) -> dict[str, float]:
        """Return IoU, error of volume and error of inertia of spheres in voxels."""
        volume, center, tensor = solid_moments(self.fine)
        ours, middle, _ = solid_moments(self._painted(spheres))
        shift = np.append((center - middle) * self.step, 0.0)
        covered = self._painted(spheres + shift)
        ours, _, own = solid_moments(covered)
        return {
            "IoU": float((covered & self.fine).sum() / (covered | self.fine).sum()),
            "volume": abs(ours / volume - 1),
            "inertia": float(np.linalg.norm(own / ours - tensor / volume) / np.linalg.norm(tensor / volume)),
        }

    def _painted(self, spheres: np.ndarray) -> np.ndarray:
        covered = np.zeros(self.fine.shape, dtype=bool)
        for x, y, z, r in (spheres - np.array([self.low] * 3 + [0.0])) / self.step:
            paint(covered, np.array([z, y, x]), r)
        return covered


def solid_moments(mask: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return volume, centre (x, y, z) and inertia tensor about it of voxels [z, y, x] of edge 1."""
    places = np.argwhere(mask)[:, ::-1].astype(float)
    center = places.mean(axis=0)
    second = (places - center).T @ (places - center)
    return float(len(places)), center, np.trace(second) * np.eye(3) - second


def compare_real(grain: Grain, numbers: list[int], python: str) -> list[dict[str, dict[str, float]]]:
    """Return the figures of each method, for each number of spheres."""
    judge = Judge(fit(grain, 120).avatar)
    others = spheres_of_others(judge.mask, judge.mesh(), numbers, python)
    rows = []
    for n in numbers:
        row = {"ours": judge.figures(judge.rows(sphere_clump(judge.avatar, n)))}
        for method in ("multisphere", "CLUMP"):
            keys = [key for key in others if key.startswith(method) and key.endswith(f"|{n}")]
            found = [judge.figures(others[key]) for key in keys]
            row[method] = {
                name: (max if name == "IoU" else min)(one[name] for one in found) for name in FIGURES
            }
        rows.append(row)
    return rows


def print_real(numbers: list[int], python: str) -> None:
    """Print the comparison on real grains: a row for each grain and number, and the medians."""
    print(
        "### Clumps fitted to the avatars of 20 real grains\n\n"
        "| grain | spheres | IoU: ours | multisphere | CLUMP | volume error %: ours | multisphere | CLUMP "
        "| inertia error %: ours | multisphere | CLUMP | ahead in all |\n" + "|---" * 12 + "|"
    )
    table: dict[int, list[dict[str, dict[str, float]]]] = {n: [] for n in numbers}
    for name, grain in real_grains():
        for n, row in zip(numbers, compare_real(grain, numbers, python), strict=True):
            table[n].append(row)
            print(f"| {name} | {n} | {told(row)} | {'yes' if is_ahead(row) else 'NO'} |", flush=True)
    for n, rows in table.items():
        medians = {
            method: {name: float(np.median([row[method][name] for row in rows])) for name in FIGURES}
            for method in rows[0]
        }
        print(f"| **median** | {n} | {told(medians)} | {sum(map(is_ahead, rows))} of {len(rows)} |")


def told(row: dict[str, dict[str, float]]) -> str:
    cells = [f"{row[method]['IoU']:.4f}" for method in row]
    cells += [f"{100 * row[method][name]:.2f}" for name in FIGURES[1:] for method in row]
    return " | ".join(cells)


def is_ahead(row: dict[str, dict[str, float]]) -> bool:
    """Return whether ours is ahead of both packages in all figures."""
    ours = row["ours"]
    return all(
        ours["IoU"] > other["IoU"] and all(ours[name] < other[name] for name in FIGURES[1:])
        for method, other in row.items()
        if method != "ours"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--n", type=int, nargs="*", default=[10, 40, 100])
    parser.add_argument("--quick", action="store_true", help="one grain of each kind")
    parser.add_argument("--side", type=int, default=100, help="voxels across")
    parser.add_argument("--grains", type=int, default=3, help="of each kind")
    parser.add_argument("--python", default=sys.executable, help="interpreter that has the clump packages")
    parser.add_argument("--avatars", action="store_true", help="avatars and clumps, on synthetic grains")
    chosen = parser.parse_args()
    if not chosen.avatars:
        print_real(chosen.n, chosen.python)
        return
    grains = synthetic(chosen.side, 1 if chosen.quick else chosen.grains)
    fit(grains[0].grain, 10)  # compile
    print(
        "### IoU with the grain at equal numbers of control points and spheres\n\n"
        "| grain | n | avatar | multisphere | CLUMP | ours (spheres) | avatar ahead of both packages "
        "| CPU s: avatar, multisphere |\n|---|---|---|---|---|---|---|---|"
    )
    ahead = total = 0
    for known in grains:
        for row in compare(known, chosen.n, chosen.python):
            wins = row["avatar"] > max(row["multisphere"], row["CLUMP"])
            ahead, total = ahead + wins, total + 1
            print(
                f"| {known.name} | {row['n']:.0f} | {row['avatar']:.4f} | {row['multisphere']:.4f} "
                f"| {row['CLUMP']:.4f} | {row['ours']:.4f} | {'yes' if wins else 'no'} "
                f"| {row['cpu']:.2f}, {row['multisphere cpu']:.2f} |",
                flush=True,
            )
    print(f"\nThe avatar is ahead of both packages in {ahead} of {total}.")


if __name__ == "__main__":
    main()
