"""How well the suspicion score finds grains that are several, or parts of one.

Run ``python benchmarks/suspicion.py [scans]``. Scans have known grains of many kinds, sizes and packings,
noise and blur, and are segmented with many splittings, too weak and too strong ones among them. A grain that
was found is *merged* if it holds at least half of two true grains or more, *split* if it holds less than
three quarters of its true grain and another found grain an eighth of it or more. The score was calibrated
on scans of other seeds.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
from segmentation_verdict import SIZE, truth

import mbstudio as mb
from mbstudio.core.errors import MbstudioError, SegmentationWarning
from mbstudio.core.grains.suspicion.scoring import BORDERLINE
from mbstudio.core.scan import Scan

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tests.core.grains.degraded import scanned

SCANS = 27
FIRST_SEED = 72015
SPLITTINGS = (0.45, 0.6, 0.75, 0.75, 0.85, 0.93, 0.95, 0.98, 1.0)


def kinds_of(found: np.ndarray, true: np.ndarray) -> dict[int, str]:
    """Return of each found grain whether it is right, merged or split."""
    count, known = int(found.max()) + 1, int(true.max()) + 1
    pairs = np.bincount(found.ravel().astype(np.int64) * known + true.ravel(), minlength=count * known)
    shared = pairs.reshape(count, known)
    voxels, wanted = shared.sum(axis=1), shared.sum(axis=0)
    shared[:, 0] = 0
    kinds = {}
    for label in np.flatnonzero(voxels)[1:].tolist():
        row = shared[label]
        held = np.flatnonzero((row >= 0.5 * wanted) & (row >= 0.1 * voxels[label]) & (row > 0))
        best = int(row.argmax())
        others = np.delete(shared[1:, best], label - 1)
        parted = 0 < row[best] < 0.75 * wanted[best] and others.max(initial=0) >= 0.12 * wanted[best]
        kinds[label] = "merged" if len(held) > 1 else ("split" if parted else "right")
    return kinds


def main() -> None:
    scans = int(sys.argv[1]) if len(sys.argv) > 1 else SCANS
    rows: list[tuple[int, str, float]] = []
    for seed in range(FIRST_SEED, FIRST_SEED + scans):
        rng = np.random.default_rng(seed)
        true = truth(rng, seed)
        noise, blur = float(rng.uniform(0.05, 0.35)), float(rng.uniform(0.5, 1.4))
        scan = Scan(scanned(true, noise=noise, blur=blur, seed=seed), SIZE)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SegmentationWarning)
            try:
                grains = mb.segment(scan, splitting=float(rng.choice(SPLITTINGS)), smallest_voxels=100)
            except MbstudioError as error:
                print(f"seed {seed}: {error}")
                continue
        kinds, ranked = kinds_of(grains.labels, true), grains.suspicion(scan)
        rows += [
            (seed, kinds[int(label)], float(score))
            for label, score in zip(ranked["label"], ranked["score"], strict=True)
        ]
    report(rows)


def report(rows: list[tuple[int, str, float]]) -> None:
    """Print precision and recall, with their standard errors by drawing scans again."""
    seeds = np.array([row[0] for row in rows])
    kinds = np.array([row[1] for row in rows])
    wrong, found = kinds != "right", np.array([row[2] for row in rows]) >= BORDERLINE
    counts = np.array(
        [
            [(wrong & found)[seeds == s].sum(), found[seeds == s].sum(), wrong[seeds == s].sum()]
            for s in np.unique(seeds)
        ]
    )
    rng = np.random.default_rng(0)
    drawn = counts[rng.integers(len(counts), size=(1000, len(counts)))].sum(axis=1)
    hits, told, there = counts.sum(axis=0)
    errors = (drawn[:, 0] / np.maximum(drawn[:, 1:].T, 1)).std(axis=1)
    print(f"{len(rows)} grains of {len(counts)} scans, {there} merged or split, {told} suspicious")
    precision, recall = hits / max(told, 1), hits / max(there, 1)
    print(f"precision {precision:.2f} +- {errors[0]:.2f}, recall {recall:.2f} +- {errors[1]:.2f}")
    for kind in ("merged", "split"):
        print(f"{kind}: {(found & (kinds == kind)).sum()} of {(kinds == kind).sum()} found")
    first = np.argsort(-np.array([row[2] for row in rows]), kind="stable")[:100]
    print(f"of the first 100 of all, {int(wrong[first].sum())} are merged or split")


if __name__ == "__main__":
    main()
