"""How far the shape factors of voxel grains and avatars are from the truth, and what they cost.

Prints markdown tables. Voxel grains: six solids with known answers in random rotation and sub-voxel shift
(benchmarks/known_solids.py). Other packages are measured in the same run where they are installed
(``pip install -e .[benchmark]``).

Run: ``python benchmarks/metrics.py [--quick] [section ...]``.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from known_solids import KINDS, Solid, ellipsoid, solid

from mbstudio.core.grains import Grain
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics import CORE_FACTORS, factor_intervals, mass_properties, measure
from mbstudio.core.metrics import bodies as bodies_module
from mbstudio.core.metrics.crofton import crofton_area
from mbstudio.core.metrics.surfaces import avatar_surface

RADII = (5, 8, 10, 15, 20, 30, 60)
ERRORS = ("V", "A", "A smoothed", "A 13 lines", "sphericity", "D_s", "circularity", "CSF", "inertia")
REAL_GRAINS = Path(__file__).resolve().parents[2] / "shared" / "data"


def errors_of(body: Solid, mask: np.ndarray) -> tuple[list[float], float]:
    """Return the relative errors in percent and the CPU seconds of measuring (surface included)."""
    grain = Grain.from_mask(mask, "1 um", keep="largest")
    start = time.process_time()
    found = measure(grain)
    seconds = time.process_time() - start
    properties = mass_properties(grain, 1000.0)
    moments = properties.principal / properties.mass / body.moments - 1
    ratios = [
        found.volume / body.volume,
        found.area / body.area,
        grain.surface_mesh().area / body.area,
        crofton_area(grain.mask, grain.voxel_size) / body.area,
        found.sphericity / body.sphericity,
        found.ds / body.ds,
        found.circularity / body.circularity,
        found.csf / body.csf,
        1 + moments[np.abs(moments).argmax()],
    ]
    return [100 * (ratio - 1) for ratio in ratios], seconds


def print_bias(quick: bool) -> None:
    """Print mean and standard deviation of the errors over random poses, by solid and radius."""
    print("\n### Mean error ± standard deviation over poses, percent (inertia: the worst of three moments)\n")
    print("| solid | radius (voxels) | " + " | ".join(ERRORS) + " | CPU ms |")
    print("|---" * (len(ERRORS) + 3) + "|")
    for kind in KINDS:
        rng = np.random.default_rng(1)
        for radius in RADII:
            rows, seconds = [], []
            for _ in range(3 if quick else 4 if radius > 40 else 24):
                body = solid(kind, radius, rng)
                errors, taken = errors_of(body, body.voxels(rng))
                rows.append(errors)
                seconds.append(taken)
            means, spreads = np.mean(rows, axis=0), np.std(rows, axis=0)
            cells = [f"{mean:+.2f} ± {spread:.2f}" for mean, spread in zip(means, spreads, strict=True)]
            print(
                f"| {kind} | {radius} | {' | '.join(cells)} | {1000 * np.median(seconds):.0f} |", flush=True
            )


def print_long_voxels(quick: bool) -> None:
    """Print the error of the area on voxels that are longer along z."""
    print("\n### Area on long voxels: mean error ± standard deviation over poses, percent\n")
    print("| voxel (z, y, x) | radius (short edges) | " + " | ".join(KINDS) + " |")
    print("|---" * (len(KINDS) + 2) + "|")
    for length in (2.0, 3.0):
        for radius in (15, 30):
            cells = []
            for kind in KINDS:
                rng = np.random.default_rng(4)
                found = []
                for _ in range(3 if quick else 12):
                    body = solid(kind, radius, rng)
                    mask = body.voxels(rng, (length, 1.0, 1.0))
                    grain = Grain.from_mask(mask, (length, 1.0, 1.0), unit="um", keep="largest")
                    found.append(
                        100
                        * (bodies_module.corrected_crofton_area(grain.mask, grain.voxel_size) / body.area - 1)
                    )
                cells.append(f"{np.mean(found):+.2f} ± {np.std(found):.2f}")
            print(f"| {length:g} : 1 : 1 | {radius} | {' | '.join(cells)} |", flush=True)


def print_avatars(quick: bool) -> None:
    """Print how far avatars measured at several resolutions are from 64 cells."""
    count = 2 if quick else 5
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
        bodies_module.avatar_surface = lambda avatar, cells=cells: avatar_surface(avatar, cells)
        measure(avatars[0])
        start = time.process_time()
        found = np.array([[getattr(measure(avatar), factor) for factor in factors] for avatar in avatars])
        seconds = (time.process_time() - start) / count
        if reference is None:
            reference = found
            continue
        worst = 100 * np.abs(found / reference - 1).max(axis=0)
        mark = " (used)" if cells == 32 else ""
        errors = " | ".join(f"{error:.4f}" for error in worst)
        print(f"| {cells}{mark} | {errors} | {1000 * seconds:.0f} |")
    bodies_module.avatar_surface = avatar_surface


def _small_grains() -> Iterator[Grain]:
    rng = np.random.default_rng(6)
    while True:
        yield Grain.from_mask(solid("ellipsoid", 15, rng).voxels(rng), "1 um")


def _measure_all(grains: list[Grain]) -> int:
    return sum(measure(grain).volume > 0 for grain in grains)


def print_speed(quick: bool) -> None:
    """Print the times of 1,000 grains 30 voxels across and of one of 8 million voxels."""
    print("\n### Time of all core factors\n")
    print("| what | processes | wall s | CPU s |")
    print("|---" * 4 + "|")
    grains = list(islice(_small_grains(), 100 if quick else 1000))
    measure(grains[0])
    wall, cpu = time.perf_counter(), time.process_time()
    _measure_all(grains)
    taken = time.perf_counter() - wall
    print(f"| {len(grains)} grains | 1 | {taken:.1f} | {time.process_time() - cpu:.1f} |", flush=True)
    fresh = [Grain(grain.mask, grain.voxel_size) for grain in grains]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        wall = time.perf_counter()
        list(pool.map(_measure_all, [fresh[start::20] for start in range(20)]))
        taken = time.perf_counter() - wall
    print(f"| {len(grains)} grains (start of the processes included) | 2 | {taken:.1f} | |", flush=True)
    rng = np.random.default_rng(7)
    for kind, body in (
        ("ellipsoid", ellipsoid(np.array([154.0, 124.0, 100.0]))),
        ("cube", solid("cube", 125.0)),
    ):
        grain = Grain.from_mask(body.voxels(rng), "1 um")
        wall, cpu = time.perf_counter(), time.process_time()
        measure(grain)
        taken = time.perf_counter() - wall
        print(
            f"| {kind} of {grain.voxel_count:,} voxels | 1 | {taken:.1f} | {time.process_time() - cpu:.1f} |",
            flush=True,
        )


def print_packages(quick: bool) -> None:
    """Print the sphericity that other packages find for the same voxels."""
    measures: dict[str, Callable[[np.ndarray], float]] = {
        "mbstudio": lambda mask: measure(Grain.from_mask(mask, "1 um", keep="largest")).sphericity
    }
    if importlib.util.find_spec("spam"):
        import spam.label

        measures["spam"] = lambda mask: float(spam.label.trueSphericity(np.pad(mask, 2).astype("<u4"))[1])
    if importlib.util.find_spec("porespy"):
        import porespy

        measures["porespy"] = lambda mask: float(
            porespy.metrics.regionprops_3D(np.pad(mask, 2).astype(int))[0].sphericity
        )
    missing = [name for name in ("spam", "porespy") if name not in measures]
    print(
        "\n### Wadell's sphericity of the same voxels: mean error ± standard deviation over poses, percent\n"
    )
    if missing:
        print(f"(not installed: {', '.join(missing)})\n")
    print("| solid | radius | exact | " + " | ".join(measures) + " |")
    print("|---" * (len(measures) + 3) + "|")
    for kind in KINDS:
        for radius in (10, 20, 30):
            rng = np.random.default_rng(8)
            errors: dict[str, list[float]] = {name: [] for name in measures}
            for _ in range(2 if quick else 6):
                body = solid(kind, radius, rng)
                mask = body.voxels(rng)
                for name, sphericity in measures.items():
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")
                        errors[name].append(100 * (sphericity(mask) / body.sphericity - 1))
            cells = [f"{np.mean(values):+.2f} ± {np.std(values):.2f}" for values in errors.values()]
            print(f"| {kind} | {radius} | {body.sphericity:.3f} | {' | '.join(cells)} |", flush=True)


def print_intervals(quick: bool) -> None:
    """Print how often the factors of real grains lie in the intervals of their voxels.

    Of the aggregates every second file, as the others set the widths; of the cement particles, which had no
    part in it, every third.
    """
    for folder, unit, start, stride in (("aggregates", "mm", 1, 2), ("cement", "um", 0, 3)):
        print(f"\n### Intervals, {folder}: share that hold the mesh's factor / median half width, percent\n")
        paths = sorted((REAL_GRAINS / folder).glob("*.ply"))[start::stride][: 3 if quick else None]
        if not paths:
            print(f"(skipped: {REAL_GRAINS / folder} is not there)")
            continue
        _print_coverage(paths, unit)


def _print_coverage(paths: list[Path], unit: str) -> None:
    import trimesh

    resolutions = (30, 60, 120)
    held = {name: {n: [] for n in resolutions} for name in CORE_FACTORS}
    widths = {name: {n: [] for n in resolutions} for name in CORE_FACTORS}
    for path in paths:
        mesh = trimesh.load_mesh(path)
        mesh.units = unit
        truth = measure(mesh)
        for n in resolutions:
            found = factor_intervals(Grain.from_mesh(mesh, n, unit))
            for name in CORE_FACTORS:
                low, high = found.intervals[name]
                true = getattr(truth, name)
                held[name][n].append(low <= true <= high)
                widths[name][n].append(50 * (high - low) / true)
    print("| factor | " + " | ".join(f"{n} across" for n in resolutions) + " | all |")
    print("|---" * (len(resolutions) + 2) + "|")
    total = []
    for name in CORE_FACTORS:
        cells = [
            f"{100 * np.mean(held[name][n]):.0f} / {np.median(widths[name][n]):.2f}" for n in resolutions
        ]
        together = [hit for n in resolutions for hit in held[name][n]]
        total += together
        print(f"| {name} | {' | '.join(cells)} | {100 * np.mean(together):.0f} |")
    print(f"\nAll factors together: {100 * np.mean(total):.1f} % of {len(total)}, from {len(paths)} grains.")


def print_segmented(quick: bool) -> None:
    """Print the areas of segmented grains over those of the true grains of synthetic scans."""
    from mbstudio.core.grains import segment
    from mbstudio.core.scan.phantom import make_phantom, sample_recipe

    ratios: list[tuple[float, float, float]] = []
    for seed in (3,) if quick else (3, 4, 5):
        phantom = make_phantom(sample_recipe(), seed)
        grains = segment(phantom.scan)
        for label in grains.interior_labels:
            mask = grains.labels == label
            true = phantom.labels == np.bincount(phantom.labels[mask])[1:].argmax() + 1
            if np.count_nonzero(mask & true) < 0.85 * np.count_nonzero(mask | true):
                continue
            truth = measure(Grain.from_mask(true, phantom.scan.voxel_size)).area
            grain = grains.grain(int(label))
            found = [measure(grain, surface=surface).area / truth for surface in ("crofton", "smoothed")]
            ratios.append((*found, np.count_nonzero(mask) / np.count_nonzero(true)))
    print(f"\n### Segmented grains over true grains of the sample recipe, {len(ratios)} grains\n")
    print("| | median | 5 % | 95 % |\n|---|---|---|---|")
    for name, column in zip(("area, crofton", "area, smoothed", "volume"), np.array(ratios).T, strict=True):
        cells = " | ".join(f"{np.percentile(column, share):.3f}" for share in (50, 5, 95))
        print(f"| {name} | {cells} |")


SECTIONS = {
    "segmented": print_segmented,
    "bias": print_bias,
    "long": print_long_voxels,
    "avatars": print_avatars,
    "speed": print_speed,
    "packages": print_packages,
    "intervals": print_intervals,
}


def main() -> None:
    """Print the chosen tables, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", choices=[*SECTIONS, []], help="which tables")
    parser.add_argument("--quick", action="store_true", help="few poses")
    options = parser.parse_args()
    for name in options.sections or SECTIONS:
        SECTIONS[name](options.quick)


if __name__ == "__main__":
    main()
