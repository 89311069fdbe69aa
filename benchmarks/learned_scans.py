"""Grains found by a classifier learned from a few strokes, beside the automatic way, on degraded scans.

Run ``python benchmarks/learned_scans.py [--seeds 21,22,23]``. Strokes are simulated by a seed in four slices
of each scan: 30 of void and of grain, and 25 of borders, a slice, some 2,700 voxels of 885,000 in all. Seeds
are others than those on which features and forest were chosen. Each figure is the mean over the scans, with
the standard error of the mean.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import mbstudio as mb
from mbstudio.core.errors import MbstudioError, SegmentationWarning
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.units import VoxelSize

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tests.core.grains.classifying.simulated_strokes import paint_slices
from tests.core.grains.degraded import packed, scanned

SIZE = VoxelSize(10, 10, 10, "um")
ROWS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "rings 0.3": {"rings": 0.3},
    "rings 1": {"rings": 1.0},
    "cupping 0.4": {"cupping": 0.4},
    "cupping 0.8": {"cupping": 0.8},
    "half of the grains 3 times as bright": {"toned": (0.5, 3.0)},
    "half of the grains at half the contrast": {"toned": (0.5, 0.5)},
    "noise 1": {"noise": 1.0},
    "rings 0.3, cupping 0.4, 30 % at half the contrast": {"rings": 0.3, "cupping": 0.4, "toned": (0.3, 0.5)},
}


def score(
    scan: mb.Scan, truth: np.ndarray, classifier: mb.VoxelClassifier | None = None
) -> tuple[float, float]:
    """Return IoU and F1; 0 where the scan is refused."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SegmentationWarning)
        try:
            found = agreement(mb.segment(scan, classifier=classifier).labels, truth)
        except MbstudioError as error:
            print(error, file=sys.stderr)
            return 0.0, 0.0
    return found.foreground_iou, found.f1


def with_error(values: list[float]) -> str:
    """Return a mean and its standard error."""
    return f"{np.mean(values):.3f} ± {np.std(values, ddof=1) / np.sqrt(len(values)):.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="21,22,23")
    seeds = [int(word) for word in parser.parse_args().seeds.split(",")]
    table = Table("scan", "automatic: IoU", "F1", "learned: IoU", "F1", "painted voxels")
    for name, degraded in ROWS.items():
        automatic, learned, painted = [], [], []
        for seed in seeds:
            truth = packed(seed)
            scan = mb.Scan(scanned(truth, seed=seed, **degraded), SIZE)
            strokes = paint_slices(truth, seed, slices=4, strokes=30, borders=25)
            classifier = mb.VoxelClassifier.learned(scan, strokes)
            painted.append(sum(classifier.voxels))
            automatic.append(score(scan, truth))
            learned.append(score(scan, truth, classifier))
        columns = [
            with_error([one[place] for one in scores]) for scores in (automatic, learned) for place in (0, 1)
        ]
        table.add_row(name, *columns, f"{np.mean(painted):,.0f}")
        print(name, *columns, file=sys.stderr, flush=True)
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
