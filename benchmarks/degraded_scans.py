"""What each degradation of a scan does to the grains that are found, beside Otsu's threshold.

Run ``python benchmarks/degraded_scans.py``. Each row is the mean of three scans of other seeds than those
that the method was chosen on, with the standard error of the mean. Truth: the labels that the scans were made
of.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import mbstudio as mb
from mbstudio.core.errors import MbstudioError, SegmentationWarning
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tests.core.grains.degraded import packed, scanned, scattered

SEEDS = (11, 12, 13)
SIZE = VoxelSize(10, 10, 10, "um")


def rows() -> Iterator[tuple[str, float | None, dict[str, Any]]]:
    """Return names, the solid share of scattered grains (None: packed ones), and what degrades the scan."""
    yield "packed, as it is", None, {}
    for noise in (0.25, 0.5, 1.0):
        yield f"packed, noise {noise:g}", None, {"noise": noise}
    for share in (0.0005, 0.002, 0.01, 0.05, 0.2):
        yield f"{100 * share:g} % solid", share, {}
        yield f"{100 * share:g} % solid, noise 0.25", share, {"noise": 0.25}
    yield "dark grains, packed", None, {"dark": True}
    yield "dark grains, 5 % solid", 0.05, {"dark": True}
    for film in (2.0, 3.0, 5.0):
        yield f"water film of {film:g} voxels", None, {"water": film}
    for share in (0.3, 0.5):
        yield f"{100 * share:g} % of the grains 3 times as bright", None, {"toned": (share, 3.0)}
        yield f"{100 * share:g} % of the grains at half the contrast", None, {"toned": (share, 0.5)}
    for size in (0.2, 0.4, 0.6, 0.8):
        yield f"cupping {size:g}", None, {"cupping": size}
    for size in (0.3, 0.6, 1.0):
        yield f"drift {size:g}", None, {"drift": size}
    for size in (0.1, 0.3, 0.5, 1.0):
        yield f"rings {size:g}", None, {"rings": size}


def score(grey: np.ndarray, truth: np.ndarray, **settings: Any) -> tuple[float, float, bool]:
    """Return IoU and F1 (0 where the scan is refused), and whether a warning or the verdict told a doubt."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SegmentationWarning)
        try:
            grains = mb.segment(Scan(grey, SIZE), **settings)
        except MbstudioError:
            return 0.0, 0.0, True
    scored = agreement(grains.labels, truth)
    warned = any(one.category is SegmentationWarning for one in caught)
    assert grains.verdict is not None
    return scored.foreground_iou, scored.f1, warned or grains.verdict.level != "green"


def with_error(values: list[float]) -> str:
    """Return a mean and its standard error."""
    return f"{np.mean(values):.3f} ± {np.std(values, ddof=1) / np.sqrt(len(values)):.3f}"


def main() -> None:
    from skimage.filters import threshold_otsu

    table = Table("scan", "Otsu: IoU", "F1", "found: IoU", "F1", "told")
    for name, share, degraded in rows():
        plain, found = [], []
        for seed in SEEDS:
            truth = packed(seed) if share is None else scattered(share, seed)
            grey = scanned(truth, seed=seed, **degraded)
            plain.append(score(grey, truth, threshold=float(threshold_otsu(grey))))
            found.append(score(grey, truth))
        columns = [
            with_error([one[place] for one in scores]) for scores in (plain, found) for place in (0, 1)
        ]
        table.add_row(name, *columns, f"{sum(one[2] for one in found)} of {len(SEEDS)}")
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
