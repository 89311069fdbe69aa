"""How true and how fast Metaball-Imaging is; prints Markdown tables.

Usage: python benchmarks/imaging.py [synthetic] [difficult] [real] [speed] [paper] [paper_all]
       [sand] [--quick]

Lengths are in percent of the nominal diameter D_n; CPU times are of one core, preparation
included, kernels compiled. `Chamfer` is the mean of the two mean distances (surface to surface),
`Hausdorff` the largest distance found.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import trimesh
from grain_kinds import KnownGrain, difficult, synthetic

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult, fit
from mbstudio.core.imaging.gradient_search import PaperFit, PaperOptions

DATA = Path(__file__).resolve().parent.parent / ".." / "shared" / "data"


def surface_distances(
    avatar: trimesh.Trimesh, truth: trimesh.Trimesh, points: int = 20_000
) -> tuple[float, float]:
    """Return Chamfer and Hausdorff distance of two closed meshes."""
    import pyvista as pv

    means, largest = [], []
    for source, target in ((avatar, truth), (truth, avatar)):
        sampled = np.asarray(trimesh.sample.sample_surface(source, points, seed=1)[0])
        _, nearest = pv.PolyData.from_regular_faces(target.vertices, target.faces).find_closest_cell(
            sampled, return_closest_point=True
        )
        distance = np.linalg.norm(sampled - nearest, axis=1)
        means.append(distance.mean())
        largest.append(distance.max())
    return float(np.mean(means)), float(max(largest))


def score(known: KnownGrain, result: FitResult, seconds: float) -> dict[str, float]:
    """Return the figures of one fit against the true surface."""
    mesh = result.avatar.mesh(cells=128)
    truth = known.truth
    dn = (6 * truth.volume / np.pi) ** (1 / 3)
    chamfer, hausdorff = surface_distances(mesh, truth)
    verdict = result.verdict
    return {
        "dV": 100 * (mesh.volume / truth.volume - 1), "dA": 100 * (mesh.area / truth.area - 1),
        "chamfer": 100 * chamfer / dn, "hausdorff": 100 * hausdorff / dn, "cpu": seconds,
        "pieces": verdict.pieces, "voids": verdict.voids, "outside": verdict.points_outside,
        "valid": verdict.valid,
        "genus_wrong": verdict.genus != round(1 - truth.euler_number / 2),
    }  # fmt: skip


def timed_fit(grain: Grain, n: int, **options: object) -> tuple[FitResult, float]:
    begin = time.process_time()
    result = fit(grain, n, **options)  # type: ignore[arg-type]
    return result, time.process_time() - begin


HEADER = (
    "| grain | n | abs dV % | dA % | Chamfer | Hausdorff (max) | pieces > 1 | voids "
    "| points outside | not valid | genus wrong | CPU s |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
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
        f"| {number('genus_wrong', 0)} | {middle('cpu'):.2f} |"
    )


def table(title: str, grains: list[KnownGrain], numbers: tuple[int, ...], **options: object) -> None:
    """Fit every grain at every n and print one row a kind and n."""
    print(f"\n### {title}\n\n{HEADER}")
    for kind in dict.fromkeys(known.kind for known in grains):
        for n in numbers:
            scores = []
            for known in grains:
                if known.kind == kind:
                    result, seconds = timed_fit(known.grain, n, **options)
                    scores.append(score(known, result, seconds))
            print(row(kind, n, scores), flush=True)


def real_meshes(folder: str, resolution: int = 120) -> list[KnownGrain]:
    """Return the closed meshes of a folder of real grains, voxelised."""
    found = []
    for path in sorted((DATA / folder).glob("*.ply")):
        mesh = trimesh.load(path)
        if mesh.is_watertight:
            found.append(
                KnownGrain(folder, path.stem, Grain.from_mesh(mesh, resolution=resolution, unit="mm"), mesh)
            )
    return found


def speed() -> None:
    """Print CPU time by size and n."""
    from grain_kinds import cobble, known_grain

    print("\n### CPU time of a fit, preparation included, one core\n\n| voxels | n | CPU s |\n|---|---|---|")
    for side in (32, 48, 200, 300):
        known = known_grain("cobble", "cobble", cobble(np.random.default_rng(7)), side)
        for n in (40, 120):
            times = [timed_fit(known.grain, n, seed=seed)[1] for seed in range(3)]
            print(f"| {known.grain.voxel_count:,} (side {side}) | {n} | {np.median(times):.3f} |", flush=True)


def sand(workers: int = 2) -> None:
    """Segment the real sand scan, fit every interior grain on some processes, print what came out."""
    import resource

    import mbstudio as mb
    from mbstudio.core.batch import fit_many

    grains = mb.segment(mb.open_scan(DATA / "sand_ct" / "sand_ct_14um.tif", voxel_size="14 um"))
    begin = time.perf_counter()
    items = list(fit_many(grains, grains.interior_labels, n=40, workers=workers))
    wall = time.perf_counter() - begin
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime
    verdicts = [item.result.verdict for item in items if item.result is not None]
    errors = np.abs([verdict.volume_error for verdict in verdicts])
    diameters = {grain.label: grain.nominal_diameter for grain in grains}
    rms = [item.result.verdict.rms / diameters[item.label] for item in items if item.result is not None]
    print(
        "\n### Real sand scan, every interior grain, n = 40\n\n"
        "| grains | fitted | pieces > 1 | voids | points outside | not valid "
        "| abs dV % median, 95th percentile "
        "| rms % of D_n median, 95th | wall s | CPU s | grains per CPU s | MiB a process, caller |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|\n"
        f"| {len(items)} | {len(verdicts)} | {sum(v.pieces > 1 for v in verdicts)} "
        f"| {sum(v.voids > 0 for v in verdicts)} | {sum(v.points_outside > 0 for v in verdicts)} "
        f"| {sum(not v.valid for v in verdicts)} "
        f"| {100 * np.median(errors):.3f}, {100 * np.percentile(errors, 95):.3f} "
        f"| {100 * np.median(rms):.2f}, {100 * np.percentile(rms, 95):.2f} | {wall:.0f} | {cpu:.0f} "
        f"| {len(items) / cpu:.1f} | {used.ru_maxrss / 1024:.0f}, "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} |"
    )


def converged_paper_fit(
    grain: Grain, n: int, most: int = 30_000, **options: object
) -> tuple[FitResult, float, int]:
    """Fit by the paper's method until its loss has converged; return also CPU seconds and generations.

    Adam at the paper's learning rate of 0.001 until the median loss of 500 generations is less
    than 2 % below that of the 500 before, then 500 generations of SGD.
    """
    begin = time.process_time()
    run = PaperFit(grain, n, 0, PaperOptions(generations=most, adam_share=1.0, **options))  # type: ignore[arg-type]
    losses: list[float] = []
    for step in run:
        if step.phase == "search":
            losses.append(step.loss)
            done = len(losses)
            if (
                done >= 1000
                and done % 500 == 0
                and np.median(losses[-500:]) > 0.98 * np.median(losses[-1000:-500])
            ):
                break
    run.options = replace(run.options, adam_share=0.0)
    run.more_generations(500)
    losses += [step.loss for step in run]
    return run.result(), time.process_time() - begin, len(losses)


def against_paper(title: str, grains: list[KnownGrain], n: int = 40, **options: object) -> None:
    """Print the paper's method, its loss converged, beside the fast one on the same grains."""
    print(
        f"\n### {title} and the fast method on the same grains, n = {n}\n\n"
        "| grain | generations | mean loss, paper / fast | abs dV %, paper / fast | dA %, paper / fast "
        "| Chamfer, paper / fast | Hausdorff, paper / fast | not sound, paper / fast "
        "| CPU s, paper / fast | CPU ratio |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    for known in grains:
        theirs, slow, generations = converged_paper_fit(known.grain, n, **options)
        ours, quick = timed_fit(known.grain, n)
        a, b = score(known, theirs, slow), score(known, ours, quick)
        unsound = [int(x["pieces"] > 1 or x["voids"] > 0 or x["outside"] > 0) for x in (a, b)]
        print(
            f"| {known.name} | {generations} | {theirs.history[-1]:.5f} / {ours.history[-1]:.5f} "
            f"| {abs(a['dV']):.3f} / {abs(b['dV']):.3f} | {a['dA']:+.2f} / {b['dA']:+.2f} "
            f"| {a['chamfer']:.3f} / {b['chamfer']:.3f} | {a['hausdorff']:.2f} / {b['hausdorff']:.2f} "
            f"| {unsound[0]} / {unsound[1]} | {slow:.1f} / {quick:.2f} | {slow / quick:.0f} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="*", default=["synthetic", "difficult", "real", "speed"])
    parser.add_argument(
        "--quick", action="store_true", help="two grains of a kind, two numbers of control points"
    )
    parser.add_argument("--n", type=int, nargs="*")
    chosen = parser.parse_args()
    numbers = tuple(chosen.n) if chosen.n else (40, 120) if chosen.quick else (10, 20, 40, 80, 120)
    fit(synthetic(32, 1)[0].grain, 10)  # compile
    if "synthetic" in chosen.tables:
        grains = synthetic(200, 2 if chosen.quick else 5)
        table("Synthetic grains of 200 cubed against their true surface", grains, numbers)
    if "difficult" in chosen.tables:
        for known in difficult():
            table(known.name, [known], tuple(n for n in numbers if n >= 20))
    if "real" in chosen.tables:
        for folder in ("aggregates", "cement", "stones"):
            grains = real_meshes(folder)
            table(
                f"Real grains: {folder}, 120 voxels across",
                grains[::6] if chosen.quick else grains,
                (40, 120),
            )
    if "speed" in chosen.tables:
        speed()
    if "sand" in chosen.tables:
        sand()
    if "paper" in chosen.tables:
        against_paper("The paper's method, its loss converged,", synthetic(200, 1 if chosen.quick else 2))
    if "paper_all" in chosen.tables:
        # As in the paper, no voxels averaged in blocks and no sample of the hull: minutes a grain.
        against_paper(
            "The paper's method on all hull points, its loss converged,", synthetic(200, 1)[:: 2],
            hull_points=10**9, working_side=10**6,
        )  # fmt: skip


if __name__ == "__main__":
    main()
