"""Avatars of many control points: all moved at once, against blocks of neighbours.

Usage: python benchmarks/many_control_points.py [--grains 6] [--numbers 120 200 300 400] [--most-at-once 300]

Grains of the sample scan and angular grains with known solids, one thread. Both searches lower the same sum
of squares from the same start, and relocate control points on the way. Times are those of the processor, with
the preparation, and their ratio is taken in one run.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from grain_kinds import angular, known_grain

from mbstudio import segment
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult, fit
from mbstudio.core.scan import sample_scan

AT_ONCE = 10**6


def timed(grains: Sequence[Grain], n: int, blocks_from: int) -> tuple[list[FitResult], float]:
    """Return a fit to each grain, and the processor seconds of one."""
    begun = time.process_time()
    found = [fit(grain, n, blocks_from=blocks_from) for grain in grains]
    return found, (time.process_time() - begun) / len(grains)


def told(grains: Sequence[Grain], found: Sequence[FitResult], seconds: float) -> str:
    """Return distance (with its standard error), volume error, valid avatars and time as cells."""
    rms = np.array([
        100 * fit.verdict.rms / nominal_diameter(grain.volume)
        for grain, fit in zip(grains, found, strict=True)
    ])  # fmt: skip
    error = rms.std(ddof=1) / np.sqrt(len(rms))
    volume = 100 * np.median([abs(fit.verdict.volume_error) for fit in found])
    valid = sum(fit.verdict.valid for fit in found)
    return f"{rms.mean():.3f} ± {error:.3f} | {volume:.2f} | {valid} of {len(found)} | {seconds:.2f}"


def main() -> None:
    """Print one table a kind of grain."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--grains", type=int, default=6)
    options.add_argument("--numbers", type=int, nargs="+", default=[120, 200, 300, 400])
    options.add_argument("--most-at-once", type=int, default=300)
    asked = options.parse_args()
    segmented = segment(sample_scan().scan)
    labels = segmented.interior_labels[: asked.grains]
    rng = np.random.default_rng(21)
    kinds = {
        "sample scan": [segmented.grain(int(label)) for label in labels],
        "angular, 120 voxels": [
            known_grain("angular", f"angular {place}", angular(rng), 120).grain
            for place in range(asked.grains)
        ],
    }
    fit(kinds["sample scan"][0], 200)  # compiles
    print("| grains | n | search | rms, % of D_n | volume error, median % | valid | CPU s |")
    print("|---|---|---|---|---|---|---|")
    for kind, grains in kinds.items():
        for n in asked.numbers:
            blocks = timed(grains, n, 1)
            print(f"| {kind} | {n} | blocks | {told(grains, *blocks)} |", flush=True)
            if n <= asked.most_at_once:
                at_once = timed(grains, n, AT_ONCE)
                ratio = at_once[1] / blocks[1]
                print(
                    f"| {kind} | {n} | all at once | {told(grains, *at_once)} ({ratio:.1f} times) |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
