"""How true and how fast Metaball-Imaging is; prints Markdown tables.

Usage: python benchmarks/imaging.py [synthetic] [real] [speed] [paper] [paper_all] [floor] [plain]
       [sand [--grains N] [--seed S]] [--quick]

Lengths are in percent of the nominal diameter D_n; CPU times are of one core, preparation
included, kernels compiled. `Chamfer` is the mean of the two mean distances (surface to surface),
`Hausdorff` the largest distance found.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import trimesh
from grain_kinds import KnownGrain, synthetic
from imaging_factors import factor_table
from imaging_floor import against_plain, floor
from imaging_paper import against_paper
from imaging_scores import score, timed_fit
from imaging_speed import sand, speed

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult, fit

DATA = Path(__file__).resolve().parent.parent / ".." / "shared" / "data"


HEADER = (
    "| grain | n | abs dV % | dA % | Chamfer | Hausdorff (max) | pieces > 1 | voids "
    "| points outside | not valid | handles wrong: of voxels (of truth) | CPU s |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def row(name: str, n: int, scores: list[dict[str, float]]) -> str:
    """Return a table row of medians and counts."""

    def middle(key: str) -> float:
        return float(np.median([one[key] for one in scores]))

    def number(test: str, above: float) -> int:
        return sum(one[test] > above for one in scores)

    dv = float(np.median([abs(one["dV"]) for one in scores]))
    return (
        f"| {name} ({len(scores)}) | {n} | {dv:.3f} | {middle('dA'):+.2f} | {middle('chamfer'):.3f} "
        f"| {middle('hausdorff'):.2f} ({max(one['hausdorff'] for one in scores):.1f}) "
        f"| {number('pieces', 1)} | {number('voids', 0)} | {number('outside', 0)} "
        f"| {sum(not one['valid'] for one in scores)} "
        f"| {number('genus_wrong', 0)} ({number('truth_missed', 0)}) | {middle('cpu'):.2f} |"
    )


def table(
    title: str, grains: list[KnownGrain], numbers: tuple[int, ...], **options: object
) -> list[tuple[KnownGrain, int, FitResult]]:
    """Fit every grain at every n, print one row a kind and n, and return the fits with their n."""
    fits = []
    print(f"\n### {title}\n\n{HEADER}")
    for kind in dict.fromkeys(known.kind for known in grains):
        for n in numbers:
            scores = []
            for known in grains:
                if known.kind == kind:
                    result, seconds = timed_fit(known.grain, n, **options)
                    scores.append(score(known, result, seconds))
                    fits.append((known, n, result))
            print(row(kind, n, scores), flush=True)
    return fits


def real_meshes(folder: str, resolution: int = 120) -> list[KnownGrain]:
    """Return the closed meshes of a folder of real grains, voxelised; say which are open."""
    found, opened = [], []
    for path in sorted((DATA / folder).glob("*.ply")):
        mesh = trimesh.load(path)
        if not mesh.is_watertight:
            opened.append(path.stem)
        else:
            found.append(
                KnownGrain(folder, path.stem, Grain.from_mesh(mesh, resolution=resolution, unit="mm"), mesh)
            )
    if opened:
        print(f"\nLeft out of {folder}, not closed: {', '.join(opened)}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="*", default=["synthetic", "real", "speed"])
    parser.add_argument(
        "--quick", action="store_true", help="two grains of a kind, two numbers of control points"
    )
    parser.add_argument("--n", type=int, nargs="*")
    parser.add_argument("--grains", type=int, help="only so many grains of the sand, chosen by --seed")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    numbers = tuple(chosen.n) if chosen.n else (40, 120) if chosen.quick else (10, 20, 40, 80, 120)
    fit(synthetic(32, 1)[0].grain, 10)  # compile
    if "synthetic" in chosen.tables:
        grains = synthetic(200, 2 if chosen.quick else 5)
        table("Synthetic grains of 200 cubed against their true surface", grains, numbers)
    if "real" in chosen.tables:
        for folder in ("aggregates", "cement", "stones"):
            grains = real_meshes(folder)
            title = f"Real grains: {folder}, 120 voxels across"
            fits = table(title, grains[::6] if chosen.quick else grains, (40, 120))
            factor_table(title, fits)
    if "speed" in chosen.tables:
        speed(chosen.quick)
    if "sand" in chosen.tables:
        sand(DATA, count=chosen.grains, seed=chosen.seed)
    side, most = (64, 1500) if chosen.quick else (200, 30_000)
    if "paper" in chosen.tables:
        grains = synthetic(side, 1 if chosen.quick else 5)
        # Two of each kind, five of those that the two methods are judged on.
        taken = [known for known in grains if known.kind in ("cobble", "concave") or known.name[-1] in "01"]
        against_paper("The paper's method, its loss converged,", taken, most=most)
    if "paper_all" in chosen.tables:
        # As in the paper, no voxels averaged in blocks and no sample of the hull: minutes a grain.
        against_paper(
            "The paper's method on all hull points, its loss converged,",
            [known for known in synthetic(side, 1) if known.kind in ("cobble", "concave", "craggy")],
            most=most, hull_points=10**9, working_side=10**6,
        )  # fmt: skip
    if "floor" in chosen.tables:
        grains = synthetic(side, 2)
        floor([known for known in grains if known.kind in ("cobble", "concave")])
        floor([known for known in grains if known.kind == "angular"], n=120, starts=10)
    if "plain" in chosen.tables:
        against_plain([known for known in synthetic(side) if known.kind == "angular"])


if __name__ == "__main__":
    main()
