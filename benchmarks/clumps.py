"""How much of a grain avatars cover, and clumps of as many spheres; prints a Markdown table.

Usage: python benchmarks/clumps.py [--quick] [--n 10 40 100] [--grains 3] [--python PYTHON]

Needs the packages multisphere and clump-python, which mbstudio itself does not use: install the
extra `benchmark`, or give with --python the interpreter of an environment that holds them. They
run in a process of their own. IoU is the volume of the intersection over that of the union,
counted on the voxels of the grain. In favour of the clumps, each is moved by up to two voxels to
where its IoU is best, and of each package the best of several settings counts: `multisphere`
with least distances of centres of 2 and 4 voxels, without smallest radius; `CLUMP` (Euclidean
map) with overlaps of 0, 0.4, 0.6 and 0.8. `ours` is the sphere clump of mbstudio's export.
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
from grain_kinds import KnownGrain, synthetic

from mbstudio.core.dem.clump import sphere_clump
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit
from mbstudio.core.metaball import Avatar

PAD = 6

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
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "mask.npy", np.pad(np.asarray(grain.mask), 2).transpose(2, 1, 0))
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
        place = np.array([z, y, x]) + PAD
        low = np.clip(np.floor(place - r).astype(int), 0, mask.shape)
        high = np.clip(np.ceil(place + r).astype(int) + 1, 0, mask.shape)
        axes = [(np.arange(a, b) - c) ** 2 for a, b, c in zip(low, high, place, strict=True)]
        inside = axes[0][:, None, None] + axes[1][:, None] + axes[2] <= r * r
        covered[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] |= inside
    return float((covered & mask).sum() / (covered | mask).sum())


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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--n", type=int, nargs="*", default=[10, 40, 100])
    parser.add_argument("--quick", action="store_true", help="one grain of each kind")
    parser.add_argument("--side", type=int, default=100, help="voxels across")
    parser.add_argument("--grains", type=int, default=3, help="of each kind")
    parser.add_argument("--python", default=sys.executable, help="interpreter that has the clump packages")
    chosen = parser.parse_args()
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
