"""How well the default segmentation finds grains: on the real sand scan and on synthetic scans.

Run ``python benchmarks/segmentation.py [--scan FILE --labels FILE --voxel-size "14 um"]``. Foreground
IoU and instance F1 (pairs of IoU above one half) are taken over all labelled slices, against
hand labels on the real scan and against the truth on synthetic ones.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import mbstudio as mb
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.scan import PhantomRecipe, make_phantom, sample_recipe

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "sand_ct"


def synthetic_recipes() -> dict[str, tuple[PhantomRecipe, int]]:
    """Return recipes and seeds that vary what makes segmentation hard."""
    sample = sample_recipe()
    small = {
        name: replace(kind, diameter=(0.55 * kind.diameter[0], 0.6 * kind.diameter[1]))
        for name, kind in sample.kinds.items()
    }
    return {
        "sample": (sample, 0),
        "sample, another seed": (sample, 1),
        "noisier and more blurred": (replace(sample, noise=0.1, blur=1.0), 2),
        "pressed together": (replace(sample, contact_overlap=150), 3),
        "no field of view": (replace(sample, field_of_view_radius=None, shape=(110, 140, 130)), 4),
        "grains half as large": (
            replace(sample, kinds=small, shape=(90, 120, 120), field_of_view_radius=58.0),
            5,
        ),
    }


def peak_memory() -> float:
    """Return this process's largest memory so far in GB."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scan", type=Path, default=DATA / "sand_ct_14um.tif")
    parser.add_argument("--labels", type=Path, default=DATA / "hand_labels_slice000.tif")
    parser.add_argument("--slice", type=int, default=0, help="the slice that the hand labels show")
    parser.add_argument("--voxel-size", default="14 um")
    arguments = parser.parse_args()

    table = Table("scan", "voxels", "grains", "truth", "IoU", "F1", "seconds", "peak GB")
    if arguments.scan.exists() and arguments.labels.exists():
        import tifffile

        scan = mb.open_scan(arguments.scan, arguments.voxel_size)
        start = time.perf_counter()
        grains = mb.segment(scan)
        seconds = time.perf_counter() - start
        hand = tifffile.imread(arguments.labels)
        score = agreement(grains.labels[arguments.slice], hand)
        table.add_row(
            f"{arguments.scan.name}, slice {arguments.slice}", f"{np.prod(scan.shape):,}", str(len(grains)),
            str(score.true), f"{score.foreground_iou:.3f}", f"{score.f1:.3f}", f"{seconds:.1f}",
            f"{peak_memory():.2f}",
        )  # fmt: skip
    else:
        print(
            f"The real scan is not there, only synthetic ones are scored: {arguments.scan}", file=sys.stderr
        )
    for name, (recipe, seed) in synthetic_recipes().items():
        phantom = make_phantom(recipe, seed)
        start = time.perf_counter()
        grains = mb.segment(phantom.scan)
        seconds = time.perf_counter() - start
        score = agreement(grains.labels, phantom.labels)
        table.add_row(
            name, f"{phantom.labels.size:,}", str(len(grains)), str(score.true),
            f"{score.foreground_iou:.3f}", f"{score.f1:.3f}", f"{seconds:.1f}", "",
        )  # fmt: skip
    Console().print(table)


if __name__ == "__main__":
    main()
