"""How far the shape factors of voxel grains and avatars are from the truth, and what they cost.

Prints markdown tables. Voxel grains: ellipsoids (semi-axes 1 : 0.8 : 0.65, each varied by 10 %)
and cubes in random rotation and sub-voxel shift.

Run: ``OMP_NUM_THREADS=1 python benchmarks/metrics.py [--quick]``.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipkinc

from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import measure
from mbstudio.core.metrics import measuring as measuring_module
from mbstudio.core.metrics.crofton import crofton_area
from mbstudio.core.metrics.surfaces import avatar_surface

RADII = (5, 8, 10, 15, 20, 30, 60)
FACTORS = ("V", "A smoothed", "A Crofton", "sphericity", "circularity", "D_s", "CSF")


def true_ellipsoid(axes: np.ndarray) -> dict[str, float]:
    """Return the factors of an ellipsoid by Legendre's and the ellipse's formulas."""
    c, b, a = np.sort(axes)
    phi = np.arccos(c / a)
    k2 = a**2 * (b**2 - c**2) / (b**2 * (a**2 - c**2))
    bracket = ellipeinc(phi, k2) * np.sin(phi) ** 2 + ellipkinc(phi, k2) * np.cos(phi) ** 2
    area = 2 * np.pi * (c**2 + a * b / np.sin(phi) * bracket)
    volume = 4 / 3 * np.pi * a * b * c
    ds = 2 * np.sqrt(a * b)
    return {
        "V": volume,
        "A smoothed": area,
        "A Crofton": area,
        "sphericity": (36 * np.pi * volume**2) ** (1 / 3) / area,
        "circularity": np.pi * ds / (4 * a * ellipe(1 - (b / a) ** 2)),
        "D_s": ds,
        "CSF": c / np.sqrt(a * b),
    }


def true_cube(edge: float) -> dict[str, float]:
    """Return the factors of a cube: its largest projection is a regular hexagon."""
    ds = np.sqrt(4 * np.sqrt(3) * edge**2 / np.pi)
    return {
        "V": edge**3,
        "A smoothed": 6 * edge**2,
        "A Crofton": 6 * edge**2,
        "sphericity": (np.pi / 6) ** (1 / 3),
        "circularity": np.pi * ds / (6 * edge * np.sqrt(2 / 3)),
        "D_s": ds,
        "CSF": 1.0,
    }


def local_coordinates(reach: float, rng: np.random.Generator) -> np.ndarray:
    """Return the positions of voxel centres in a frame turned and shifted at random."""
    ticks = np.arange(-int(np.ceil(reach)) - 2, int(np.ceil(reach)) + 3)
    z, y, x = np.meshgrid(ticks, ticks, ticks, indexing="ij")
    return (np.stack([x, y, z], axis=-1) - rng.uniform(-0.5, 0.5, 3)) @ Rotation.random(rng=rng).as_matrix()


def errors_of(mask: np.ndarray, truth: dict[str, float]) -> tuple[list[float], float]:
    """Return the relative errors in percent and the CPU seconds of measuring (surface included)."""
    grain = Grain.from_mask(mask, "1 um")
    start = time.process_time()
    found = measure(grain)
    seconds = time.process_time() - start
    values = {
        "V": found.volume,
        "A smoothed": found.area,
        "A Crofton": crofton_area(grain.mask, grain.voxel_size),
        "sphericity": found.sphericity,
        "circularity": found.circularity,
        "D_s": found.ds,
        "CSF": found.csf,
    }
    return [100 * (values[factor] / truth[factor] - 1) for factor in FACTORS], seconds


def print_bias(kind: str, repeats: int) -> None:
    """Print mean and standard deviation of the errors over random poses, by radius."""
    print(f"\n### {kind}: mean error ± standard deviation over poses, percent\n")
    print("| radius (voxels) | " + " | ".join(FACTORS) + " | CPU ms a grain |")
    print("|---" * (len(FACTORS) + 2) + "|")
    rng = np.random.default_rng(1)
    for radius in RADII:
        rows, seconds = [], []
        for _ in range(repeats if radius < 40 else max(2, repeats // 4)):
            if kind == "ellipsoids":
                axes = radius * np.array([1, 0.8, 0.65]) * rng.uniform(0.9, 1.1, 3)
                mask = ((local_coordinates(axes.max(), rng) / axes) ** 2).sum(axis=-1) <= 1
                truth = true_ellipsoid(axes)
            else:
                edge = 2 * radius * rng.uniform(0.75, 0.85)
                mask = (np.abs(local_coordinates(edge * 0.87, rng)) <= edge / 2).all(axis=-1)
                truth = true_cube(edge)
            errors, taken = errors_of(mask, truth)
            rows.append(errors)
            seconds.append(taken)
        cells = [
            f"{m:+.2f} ± {s:.2f}" for m, s in zip(np.mean(rows, axis=0), np.std(rows, axis=0), strict=True)
        ]
        print(f"| {radius} | " + " | ".join(cells) + f" | {1000 * np.median(seconds):.0f} |", flush=True)


def print_avatars(count: int) -> None:
    """Print how far avatars measured at several resolutions are from 64 cells."""
    print("\n### Avatars: largest error against 64 cells over random avatars of 20 control points, percent\n")
    print("| cells | V | A | sphericity | circularity | D_s | CPU ms |")
    print("|---" * 7 + "|")
    rng = np.random.default_rng(2)
    avatars = [
        Avatar(rng.normal(size=(20, 3)) * [0.35, 0.25, 0.2], rng.uniform(0.2, 0.5, 20) ** 2 * 0.4, "mm")
        for _ in range(count)
    ]
    factors = ("volume", "area", "sphericity", "circularity", "ds")
    reference = None
    for cells in (64, 24, 32, 48):
        measuring_module.avatar_surface = lambda avatar, cells=cells: avatar_surface(avatar, cells)
        measure(avatars[0])
        start = time.process_time()
        found = np.array([[getattr(measure(avatar), factor) for factor in factors] for avatar in avatars])
        seconds = (time.process_time() - start) / count
        if reference is None:
            reference = found
            continue
        worst = 100 * np.abs(found / reference - 1).max(axis=0)
        mark = " (used)" if cells == 32 else ""
        print(
            f"| {cells}{mark} | "
            + " | ".join(f"{error:.4f}" for error in worst)
            + f" | {1000 * seconds:.0f} |"
        )
    measuring_module.avatar_surface = avatar_surface


def main() -> None:
    """Print every table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few poses")
    quick = parser.parse_args().quick
    for kind in ("ellipsoids", "cubes"):
        print_bias(kind, 3 if quick else 16)
    print_avatars(2 if quick else 5)


if __name__ == "__main__":
    main()
