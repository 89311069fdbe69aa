"""How often the verdict on a segmentation is right: green where grains are, not green where they are not.

Run ``python benchmarks/segmentation_verdict.py [scans [folder]]``. Scans have known grains of many kinds,
sizes and packings, each degraded in one way; or the stones of a folder of meshes, each packing in all ways.
The limits of the verdict and the weights of the likely agreement were set on scans of other seeds and of
other stones. Scans that mbstudio refuses are counted apart: nobody
takes their grains for right.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cc3d
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import fft, ndimage
from scipy.spatial.transform import Rotation

import mbstudio as mb
from mbstudio.core.errors import MbstudioError, SegmentationWarning
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.grains.segmentation import SegmentationSettings
from mbstudio.core.grains.verdict import CRITERIA
from mbstudio.core.scan import Scan, make_phantom, sample_recipe
from mbstudio.core.units import VoxelSize

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tests.core.grains.degraded import CONTRAST, VOID, scanned, scattered

SIZE = VoxelSize(10, 10, 10, "um")
SCANS = 190
FIRST_SEED = 71_000
EDGE = 96
SMALLEST = SegmentationSettings().smallest_voxels
KINDS = (
    ("cobble",),
    ("angular",),
    ("cobble", "angular"),
    ("cobble", "angular", "elongated", "concave"),
    ("elongated", "cobble"),
    ("concave", "angular"),
)
WAYS = (
    "none", "noise", "blur", "cupping", "drift", "rings", "water", "bright", "faint", "splitting", "bin",
    "streaks", "motion", "bias", "impulses", "threshold", "porous", "correlated", "few greys",
)  # fmt: skip


def truth(rng: np.random.Generator, seed: int) -> np.ndarray:
    """Return labels of grains 10 to 40 voxels across, packed or scattered."""
    if rng.random() < 0.25:
        return scattered(float(rng.choice([0.002, 0.01, 0.05, 0.2, 0.35])), seed)
    recipe, scale = sample_recipe(), float(rng.choice([0.4, 0.55, 0.75, 0.75, 1.0]))
    kinds = {}
    for name in KINDS[rng.integers(len(KINDS))]:
        low, high = recipe.kinds[name].diameter
        kinds[name] = replace(recipe.kinds[name], diameter=(scale * low, scale * high))
    box = replace(recipe, shape=(EDGE, EDGE, EDGE), field_of_view_radius=None, kinds=kinds)
    return np.asarray(make_phantom(replace(box, bright_grains=0, inclusions=0), seed).labels)


def stones(folder: Path) -> list[np.ndarray]:
    """Return the bodies of every second mesh as masks of 40 voxels; the others set the limits."""
    grains = mb.Grain.from_meshes(folder, resolution=40, unit="mm")[::2]
    return [np.pad(grain.mask, 20) for grain in grains]


def packed_stones(shapes: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Return labels of stones pressed together: each where it touches most and overlaps least."""
    size = float(rng.choice([0.55, 0.75, 1.0]))
    labels = np.zeros((EDGE, EDGE, EDGE), np.int32)
    for number in range(1, 400):
        stamp = _turned(shapes[rng.integers(len(shapes))], size * rng.uniform(0.8, 1.2), rng)
        stamp = np.pad(stamp, [(0, EDGE - count) for count in stamp.shape])
        occupied = labels > 0
        touched = ndimage.binary_dilation(occupied) & ~occupied
        seen_from = np.conj(fft.rfftn(stamp))
        overlap, contact = (
            np.rint(fft.irfftn(fft.rfftn(mask.astype(float)) * seen_from, stamp.shape))
            for mask in (occupied, touched)
        )
        score = np.where(overlap <= 24, contact + rng.random(contact.shape), -1.0)
        if score.max() < 0:
            break
        # The box repeats itself, so that stones lie across its faces; there they are cut off.
        place = np.unravel_index(score.argmax(), score.shape)
        new = np.roll(stamp, place, axis=(0, 1, 2)) & ~occupied
        labels[new] = number
    # What a later stone or the box cuts off is no stone.
    pieces = cc3d.connected_components(labels, connectivity=26)
    small = np.bincount(pieces.ravel()) < SMALLEST
    return np.unique(np.where(small[pieces], 0, pieces), return_inverse=True)[1].reshape(labels.shape)


def _turned(mask: np.ndarray, scale: float, rng: np.random.Generator) -> np.ndarray:
    """Return a mask turned at random and scaled, without empty margins."""
    turn = Rotation.random(random_state=rng).as_matrix() / scale
    middle = (np.array(mask.shape) - 1) / 2
    turned = ndimage.affine_transform(mask.astype(float), turn, middle - turn @ middle, order=1) > 0.5
    rows = np.argwhere(turned)
    (a, b, c), (d, e, f) = rows.min(axis=0), rows.max(axis=0) + 1
    return turned[a:d, b:e, c:f]


def degraded(
    labels: np.ndarray, way: str, rng: np.random.Generator, seed: int
) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Return labels, grey values, and settings of the segmentation."""
    usual = {
        "noise": float(rng.choice([0.03, 0.07, 0.07, 0.15])),
        "blur": float(rng.choice([0.5, 0.7, 0.7, 1])),
    }
    settings: dict[str, Any] = {}
    share = float(rng.uniform(0.1, 0.6))
    how: dict[str, Callable[[], dict[str, Any]]] = {
        "noise": lambda: {"noise": rng.uniform(0.2, 0.95)},
        "blur": lambda: {"blur": rng.uniform(1, 4)},
        "cupping": lambda: {"cupping": rng.uniform(0.2, 1.4)},
        "drift": lambda: {"drift": rng.uniform(0.3, 1.8)},
        "rings": lambda: {"rings": rng.uniform(0.2, 2)},
        "water": lambda: {"water": rng.uniform(1, 6)},
        "bright": lambda: {"toned": (share, rng.uniform(1.5, 4))},
        "faint": lambda: {"toned": (share, rng.uniform(0.25, 0.7))},
    }
    if way == "splitting":
        settings["splitting"] = float(rng.choice([0, 0.3, 0.5, 0.6, 0.9, 0.95, 1.0]))
    if way == "threshold":
        settings["threshold"] = float(VOID + CONTRAST * rng.choice([0.1, 0.2, 0.3, 0.7, 0.8, 0.9]))
    if way == "bin":
        step = 2 if rng.random() < 0.6 else 3
        labels = labels[::step, ::step, ::step]
    solid = labels
    if way == "porous":
        field = ndimage.gaussian_filter(rng.standard_normal(labels.shape), rng.uniform(0.8, 2.5))
        solid = np.where(field < np.quantile(field, rng.uniform(0.05, 0.35)), 0, labels)
    grey = scanned(solid, seed=seed, **{**usual, **how.get(way, dict)()}).astype(float)
    return labels, np.clip(np.rint(spoilt(grey, way, rng)), 1, 65_535).astype(np.uint16), settings


def spoilt(grey: np.ndarray, way: str, rng: np.random.Generator) -> np.ndarray:
    """Return grey values with what the scan of degraded.py does not know."""
    shape = grey.shape
    if way == "streaks":
        z, (y, x) = np.arange(shape[0])[:, None, None], np.indices(shape[1:])
        streaks = np.zeros(shape)
        for _ in range(rng.integers(3, 25)):
            row, column, angle = rng.uniform(0, shape[1]), rng.uniform(0, shape[2]), rng.uniform(0, np.pi)
            away = (y - row) * np.cos(angle) + (x - column) * np.sin(angle)
            line = np.exp(-0.5 * (away / 1.5) ** 2)
            streaks += rng.choice([-1, 1]) * line * np.exp(-0.5 * ((z - rng.uniform(0, shape[0])) / 12) ** 2)
        return grey + CONTRAST * rng.uniform(0.2, 2) * streaks
    if way == "motion":
        step = 0.7 * rng.uniform(1, 7)
        return 0.5 * (grey + ndimage.shift(grey, (0, step, step), order=1, mode="nearest"))
    if way in ("bias", "correlated"):
        width = rng.uniform(8, 25) if way == "bias" else rng.uniform(0.7, 2)
        field = ndimage.gaussian_filter(rng.standard_normal(shape), width, mode="wrap")
        if way == "bias":
            return grey + CONTRAST * rng.uniform(0.3, 2) * field / np.abs(field).max()
        return grey + CONTRAST * rng.uniform(0.1, 0.6) * field / field.std()
    if way == "impulses":
        hit = rng.random(shape) < rng.uniform(0.005, 0.15)
        return np.where(hit, VOID + CONTRAST * rng.choice([-0.5, 1.5], size=shape), grey)
    if way == "few greys":
        step = CONTRAST * rng.uniform(0.2, 1.2)
        return np.rint(grey / step) * step
    return grey


def scenes(count: int, folder: Path | None) -> Iterator[tuple[str, np.ndarray, np.ndarray, dict[str, Any]]]:
    """Return ways, labels, grey values and settings."""
    ways = WAYS
    shapes = stones(folder) if folder is not None else []
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        rng = np.random.default_rng(seed)
        way = ways[seed % len(ways)]
        turn, first = divmod(seed - FIRST_SEED, len(ways))
        if shapes and first == 0:
            packing = packed_stones(shapes, np.random.default_rng([FIRST_SEED, turn]))
        labels = packing if shapes else truth(rng, seed)
        yield way, *degraded(labels, way, rng, seed)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else SCANS
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    rows: list[tuple[str, float, str]] = []
    refused = 0
    reasons: dict[str, list[int]] = {criterion.name: [0, 0] for criterion in CRITERIA}
    for way, labels, grey, settings in scenes(count, folder):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SegmentationWarning)
            try:
                found = mb.segment(Scan(grey, SIZE), **settings)
            except MbstudioError:
                refused += 1
                continue
        assert found.verdict is not None
        f1 = agreement(found.labels, labels).f1
        rows.append((way, f1, found.verdict.level))
        for criterion in found.verdict.doubts:
            if f1 < 0.8 or f1 > 0.95:
                reasons[criterion.name][f1 > 0.95] += 1
        print(f"{len(rows) + refused} {way}: F1 {f1:.3f}, {found.verdict.level}", file=sys.stderr, flush=True)
    console = Console(width=120)
    table = Table("scans", "F1 below 0.8: not green", "F1 above 0.95: green", "between: green, amber, red")
    bad, good = [row for row in rows if row[1] < 0.8], [row for row in rows if row[1] > 0.95]
    between = [row[2] for row in rows if 0.8 <= row[1] <= 0.95]
    table.add_row(
        str(len(rows)),
        rate(sum(row[2] != "green" for row in bad), len(bad)),
        rate(sum(row[2] == "green" for row in good), len(good)),
        ", ".join(str(between.count(level)) for level in ("green", "amber", "red")),
    )
    console.print(table)
    console.print(f"{refused} of {count} scans were refused.")
    missed = [f"{way} (F1 {f1:.2f})" for way, f1, level in rows if f1 < 0.8 and level == "green"]
    console.print(f"Green below 0.8: {', '.join(missed) or 'none'}.")
    doubts = Table("in doubt by", "of F1 below 0.8", "of F1 above 0.95")
    for name, (bad_count, good_count) in reasons.items():
        doubts.add_row(name, str(bad_count), str(good_count))
    console.print(doubts)


def rate(hits: int, total: int) -> str:
    """Return a rate and its standard error, for which half a hit and half a miss are added."""
    if not total:
        return "none"
    share = (hits + 0.5) / (total + 1)
    return (
        f"{hits} of {total} ({100 * hits / total:.0f} ± {100 * np.sqrt(share * (1 - share) / total):.0f} %)"
    )


if __name__ == "__main__":
    main()
