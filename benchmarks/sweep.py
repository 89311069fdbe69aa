"""Fits to a target, and whether to go on with the points kept; prints Markdown tables.

Usage: python benchmarks/sweep.py [continued] [targets]

CPU times are of one core, kernels compiled.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult, fit, start_fit
from mbstudio.core.imaging.goals.likeness import Likeness
from mbstudio.scene.figures.paper_figures import KINDS, typical_grain

DATA = Path(__file__).resolve().parent.parent / ".." / "shared" / "data"
NUMBERS = (10, 20, 40, 80, 160)
TARGETS = (
    "volume 1 %",
    "sphericity 2 %",
    "iou 0.95",
    "hausdorff 3 %",
    "volume 0.5 % and hausdorff 2 % and csf 2 %",
)


def continued(diameter: float = 60.0, seeds: tuple[int, ...] = (7, 8)) -> None:
    """Compare a fresh fit with one that goes on from half as many points, at the same n."""
    ratios: dict[int, list[tuple[float, ...]]] = {n: [] for n in NUMBERS[1:]}
    for grain in (typical_grain(kind, diameter, seed) for kind in KINDS for seed in seeds):
        likeness, run = Likeness(grain), start_fit(grain, NUMBERS[0])
        for n in NUMBERS:
            fresh, fresh_seconds = _timed(lambda n=n, grain=grain: fit(grain, n))
            kept, kept_seconds = _timed(lambda n=n, run=run: _gone_on(run, n))
            if n in ratios:
                ratios[n].append(
                    (
                        kept.verdict.rms / fresh.verdict.rms,
                        likeness.hausdorff(kept.avatar) / likeness.hausdorff(fresh.avatar),
                        kept_seconds / fresh_seconds,
                    )
                )
    print(f"\n### Gone on with, over fresh: median (least, largest) of {len(KINDS) * len(seeds)} grains\n")
    print("| n | rms | Hausdorff | CPU time |\n|---|---|---|---|")
    for n, found in ratios.items():
        cells = [f"{np.median(one):.2f} ({min(one):.2f}, {max(one):.2f})" for one in zip(*found, strict=True)]
        print(f"| {n} | {' | '.join(cells)} |", flush=True)


def _gone_on(run: object, n: int) -> FitResult:
    run.change_control_points(n)  # type: ignore[attr-defined]
    for _ in run:  # type: ignore[attr-defined]
        pass
    return run.result()  # type: ignore[attr-defined]


def _timed(work: Callable[[], FitResult]) -> tuple[FitResult, float]:
    begun = time.process_time()
    return work(), time.process_time() - begun


def targets(resolution: int = 80, every: int = 4) -> None:
    """Print how many control points real aggregates need for some targets."""
    files = sorted((DATA / "aggregates").glob("*.ply"))[::every]
    grains = [Grain.from_mesh(path, resolution=resolution, unit="mm") for path in files]
    print(f"\n### Targets, {len(grains)} aggregates at {resolution} voxels across\n")
    print("| target | n: median (least, largest) | not reached | fits tried | CPU s |\n|---|---|---|---|---|")
    for words in TARGETS:
        found, tried, seconds = [], [], []
        for grain in grains:
            numbers: set[str] = set()
            begun = time.process_time()
            result = fit(
                grain, target=words, on_step=lambda step, seen=numbers: seen.add(step.note.partition(";")[0])
            )
            seconds.append(time.process_time() - begun)
            found.append((result.n, any("was not reached" in told for told in result.verdict.warnings)))
            tried.append(len(numbers))
        numbers_found = [n for n, missed in found if not missed]
        middle = (
            f"{np.median(numbers_found):g} ({min(numbers_found)}, {max(numbers_found)})"
            if numbers_found
            else "–"
        )
        missed = sum(one for _, one in found)
        print(
            f"| {words} | {middle} | {missed} | {np.median(tried):g} | {np.median(seconds):.1f} |", flush=True
        )


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["continued", "targets"]
    if "continued" in chosen:
        continued()
    if "targets" in chosen:
        targets()
